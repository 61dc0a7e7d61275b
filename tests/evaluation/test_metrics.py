from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from math import inf

import numpy as np
import pytest
from scenes import scene

from regents_cosim.evaluation.drives.driving import drive_each, driving_rows
from regents_cosim.evaluation.drives.metrics import driving_score, infraction_score, off_road_share, route_completion
from regents_cosim.evaluation.statistics import mean_interval

ROUTE = np.array([[0.0, 0.0], [50.0, 0.0], [50.0, 50.0]])


def test_half_way_is_half_the_route():
    assert route_completion(ROUTE, np.array([[0.0, 0.0], [30.0, 1.0], [50.0, 0.0]])) == pytest.approx(0.5)


def test_the_end_is_all_of_it_and_beyond_is_no_more():
    assert route_completion(ROUTE, np.array([[50.0, 50.0], [50.0, 53.0]])) == pytest.approx(1.0)


def test_another_road_counts_nothing():
    assert route_completion(ROUTE, np.array([[10.0, 0.0], [90.0, 0.0]])) == pytest.approx(0.1)


def test_a_route_without_length_is_complete():
    assert route_completion(np.zeros((3, 2)), np.zeros((1, 2))) == 1.0


def test_off_road_is_weighed_by_the_way():
    driven = np.array([[0.0, 0.0], [6.0, 0.0], [10.0, 0.0], [10.0, 0.0]])
    assert off_road_share(driven, np.array([True, False, True, True])) == pytest.approx(0.4)
    assert off_road_share(np.zeros((4, 2)), np.ones(4, bool)) == 0.0


@pytest.mark.parametrize(
    ("hit", "off_road", "score"),
    [(None, 0.0, 1.0), ("car", 0.0, 0.6), ("pedestrian", 0.0, 0.5), ("bicycle", 0.5, 0.25), (None, 0.2, 0.8)],
)
def test_infractions_multiply(hit, off_road, score):
    assert infraction_score(hit, off_road) == pytest.approx(score)
    assert driving_score(0.5, infraction_score(hit, off_road)) == pytest.approx(0.5 * score)


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
