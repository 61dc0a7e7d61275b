import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from math import inf

import numpy as np
import pytest
import shapely
from scenes import scene
from shipped_cases import shipped_windows
from two_car_scenes import TIME, crossroads, moving

from regents_cosim.evaluation.drives.crash_verdict import CrashCounts
from regents_cosim.evaluation.drives.driving import (
    COLUMNS,
    COUNTS,
    drive_each,
    driving_row,
    driving_rows,
    failed_drive,
    judged,
    score,
)
from regents_cosim.evaluation.drives.ego_drive import infraction_score, route_completion, share_of_way
from regents_cosim.evaluation.drives.metrics import COMPARED, METRICS
from regents_cosim.evaluation.statistics import mean_interval
from regents_cosim.evaluation.suites.ranking import rank_rows
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.scenario.scenario import Signal

ROAD = scene((0, 0, 10.0))
ROUTE = np.array([[0.0, 0.0], [50.0, 0.0], [50.0, 50.0]])


def test_half_way_is_half_the_route():
    assert route_completion(ROUTE, np.array([[0.0, 0.0], [30.0, 1.0], [50.0, 0.0]])) == pytest.approx(0.5)


def test_the_end_is_all_of_it_and_beyond_is_no_more():
    assert route_completion(ROUTE, np.array([[50.0, 50.0], [50.0, 53.0]])) == pytest.approx(1.0)


def test_another_road_counts_nothing():
    assert route_completion(ROUTE, np.array([[10.0, 0.0], [90.0, 0.0]])) == pytest.approx(0.1)


def test_a_route_without_length_is_complete():
    assert route_completion(np.zeros((3, 2)), np.zeros((1, 2))) == 1.0


def test_shares_are_weighed_by_the_way():
    driven = np.array([[0.0, 0.0], [6.0, 0.0], [10.0, 0.0], [10.0, 0.0]])
    assert share_of_way(driven, np.array([True, False, True, True])) == pytest.approx(0.4)
    assert share_of_way(np.zeros((4, 2)), np.ones(4, bool)) == 0.0


@pytest.mark.parametrize(
    ("hit", "outside", "red_lights", "score"),
    [
        (None, 0.0, 0, 1.0), ("car", 0.0, 0, 0.6), ("pedestrian", 0.0, 0, 0.5), ("bicycle", 0.5, 0, 0.25),
        (None, 0.2, 0, 0.8), (None, 0.0, 1, 0.7), ("car", 0.5, 2, 0.6 * 0.5 * 0.49),
    ],
)  # fmt: skip
def test_infractions_multiply(hit, outside, red_lights, score):
    assert infraction_score(hit, outside, red_lights) == pytest.approx(score)


@pytest.mark.parametrize(("letters", "run"), [("r", 1), ("G", 0), ("y", 0), ("g", 0)])
def test_a_light_that_is_run_costs_three_tenths(letters, run):
    made = crossroads(west=letters)
    made = moving(made, 1, y=np.full(81, -30.0), speed=np.zeros(81))
    drive = score(made, made.tracks)
    assert (drive.red_lights, drive.score) == (run, pytest.approx(0.7**run))
    stands = moving(made, 0, x=np.full(81, -30.0), speed=np.zeros(81))
    assert score(made, stands.tracks).red_lights == 0
    begun_beyond = moving(made, 0, x=-7.0 + 10.0 * TIME)  # the front is past the line at the first step
    assert score(made, begun_beyond.tracks).red_lights == 0


def test_lights_that_a_log_may_have_left_out_are_not_known():
    made = scene((0, 0, 10.0))
    drive = score(made, made.tracks)
    assert (drive.red_lights, drive.score) == (None, 1.0)
    (row,) = driving_rows([drive])
    assert (row.red_lights, row.red_light_cases, row.lights_known) == (0, 0, 0)


def test_the_way_driven_against_the_direction_counts_as_off_the_road_does():
    right, left = np.array([[-200.0, 0.0], [600.0, 0.0]]), np.array([[600.0, 3.2], [-200.0, 3.2]])
    lanes = (Lane("there", right, 3.2, 15.0), Lane("back", left, 3.2, 15.0))
    made = scene((0, 0, 10.0), road=RoadMap(lanes, (), shapely.box(-200, -1.6, 600, 4.8)))
    overtakes = moving(made, 0, y=np.where((TIME > 2.0) & (TIME <= 4.0), 3.2, 0.0)).tracks
    drive = score(made, overtakes)
    assert drive.off_road == 0.0
    assert drive.against_direction == pytest.approx(0.25, abs=0.02)  # to the side and back it goes a little further
    assert drive.score == pytest.approx(1.0 - drive.against_direction)
    assert score(made, made.tracks).against_direction == 0.0
    without = replace(made, road=RoadMap((), (), made.road.drivable))
    assert score(without, overtakes).against_direction is None


def test_on_a_shipped_network_the_lights_decide():
    windows = shipped_windows("signals")
    assert all(score(window, window.tracks).red_lights == 0 for window in windows)  # SUMO's own traffic keeps to them
    for letter, some in (("r", True), ("G", False)):
        lit = [
            replace(w, signals=tuple(Signal(s.id, ((0, letter * len(s.letters(0))),)) for s in w.signals))
            for w in windows
        ]
        assert any(score(window, window.tracks).red_lights for window in lit) == some


def test_the_interval_of_a_mean():
    low, high = mean_interval([1.0, 2.0, 3.0])  # deviation 1, so 1.96 / sqrt(3) on either side
    assert (low, high) == pytest.approx((2.0 - 1.1316, 2.0 + 1.1316), abs=1e-3)
    assert mean_interval([1.0]) == (-inf, inf)


def test_a_drive_ends_at_its_collision():
    made = scene((0, 0, 10.0), (45.1, 0, 0.0))  # 40.5 m between the bumpers, 80 m of route
    (drive,) = drive_each([made], "constant_velocity")
    assert drive.hits == "car01"
    assert drive.step == 41
    assert drive.completion == pytest.approx(41 / 80, abs=1e-3)
    assert drive.score == pytest.approx(0.6 * 41 / 80, abs=1e-3)


def test_agents_of_highway_env_are_scored_there(tmp_path):
    made = scene((0, 0, 10.0), (45.1, 0, 0.0))
    (tmp_path / "bold.py").write_text("def keeps_its_speed(observation):\n    return [0.0, 0.0]\n")
    (bold,) = drive_each([made], f"highway:{tmp_path / 'bold.py'}:keeps_its_speed", where="highway")
    assert (bold.hits, bold.step) == ("car01", 41)
    assert bold.score == pytest.approx(0.6 * 41 / 80, abs=4e-3)  # highway-env pushes it back a little
    (careful,) = drive_each([made], "highway:idm", where="highway")
    assert careful.hits is None
    assert 0.3 < careful.completion < 0.6  # it stops behind the one that stands


def test_simulators_that_cannot_drive_a_case_say_why():
    with ThreadPoolExecutor(1) as pool:
        (drive,) = drive_each([scene((0, 0, 10.0))], "sumo", where="sumo", executor=pool)
    assert "needs a case recorded in SUMO" in drive.error
    assert drive.completion == 0.0


def test_scores_over_sources():
    made = scene((0, 0, 10.0), (45.1, 0, 0.0))
    free = replace(scene((0, 0, 10.0), name="free"), provenance=replace(made.provenance, file="elsewhere"))
    rows = driving_rows(list(drive_each([made, free], "constant_velocity")))
    assert [(row.source, row.n, row.collisions) for row in rows] == [
        ("elsewhere", 1, 0), ("made by hand", 1, 1), ("all", 2, 1),
    ]  # fmt: skip
    assert rows[-1].route_completion_percent == pytest.approx(75.0, abs=1.0)
    assert rows[-1].collision_rate_percent == 50.0


def test_a_follower_that_replays_its_log_into_the_ego_is_no_collision_and_counted_apart():
    made = scene((0, 0, 10), (-15, 0, 10))
    stopping = np.concatenate([made.tracks.x[:1] * 0.2, made.tracks.x[1:]])
    drive = judged(made, "mine", replace(made.tracks, x=stopping))
    assert (drive.rear_ended, drive.hits, drive.collision, drive.infraction) == (True, "car01", False, 1.0)
    assert (drive.verdict, drive.ending) == (None, f"rear-ended by car01 at step {drive.step}")
    row, rank = driving_row("all", [drive]), rank_rows([("mine", [drive])])[0]
    assert (row.collisions, row.rear_ended, rank.crashes, rank.rear_ended) == (0, 1, 0, 1)
    elsewhere = np.concatenate([stopping[:1], made.tracks.x[1:] + 0.5])
    assert not score(made, replace(made.tracks, x=elsewhere)).rear_ended, "it does not replay its log"
    attacks = replace(made, agents=(made.agents[0], replace(made.agents[1], role="adversary")))
    assert not score(attacks, replace(made.tracks, x=stopping)).rear_ended
    ahead = scene((0, 0, 10), (15, 0, 2))
    assert not score(ahead, ahead.tracks).rear_ended, "the ego drives into it"


def test_the_count_of_failures_says_why_the_first_was_one():
    counts = CrashCounts.of(failed_drive(ROAD, why).end for why in ("ValueError: first\nlong story", "second"))
    assert str(counts) == "0 of 2 crash, in 2 the planner failed (ValueError: first)"


def test_a_rank_counts_crashes_by_fault_and_how_far_a_planner_gets_where_nobody_attacks():
    cases = [replace(scene((0, 0, 10), (15, 0, 2)), id=name) for name in ("first", "second")]
    (hits, also), free = drive_each(cases, "constant_velocity"), scene((0, 0, 10), (0, 50, 10))
    (passes,) = drive_each([free], "constant_velocity")
    attacked = replace(also, ordinary=False, verdict=replace(also.verdict, at_fault="adversary"))
    (row,) = rank_rows([("mine", [hits, attacked, passes])])
    assert (hits.verdict.at_fault, row.ego_at_fault, row.other_at_fault) == ("ego", 1, 1)
    assert (row.crashes, row.ordinary_crashes) == (2, 1)
    assert row.ordinary_completion_percent == pytest.approx(50.0 * (hits.completion + passes.completion), abs=0.1)
    (row,) = rank_rows([("mine", [attacked])])
    assert row.ordinary_completion_percent is None


def test_every_metric_says_what_it_is_and_no_two_share_a_name():
    assert all(one.meaning and hasattr(score(ROAD, ROAD.tracks), one.field) for one in METRICS)
    assert len(COMPARED) == sum(one.name is not None for one in METRICS)
    assert len({column.name for column in COLUMNS}) == len(COLUMNS)
    assert all(column.meaning for column in COUNTS)


def test_a_column_is_computed_of_known_values_alone():
    row = driving_row("all", [failed_drive(ROAD, "it failed")])
    nothing = [
        column for one in METRICS if getattr(failed_drive(ROAD, ""), one.field) is None for column in one.columns
    ]
    assert {"min_ttc_p5_s", "red_lights", "against_direction_percent"} <= {column.name for column in nothing}
    assert all(row.columns[column.name] == column.unknown for column in nothing)
    assert (row.min_ttc_p5_s, row.red_lights, row.collisions) == (None, 0, 0)


def test_a_row_has_its_columns_as_attributes_and_survives_a_copy():
    row = driving_row("all", [score(ROAD, ROAD.tracks)])
    assert list(row.row()) == ["source", "n", *(column.name for column in COLUMNS)]
    assert all(getattr(row, name) == value for name, value in row.row().items())
    assert pickle.loads(pickle.dumps(row)) == row
    with pytest.raises(AttributeError, match="no 'nothing'"):
        _ = row.nothing
