"""Made tracks have the intended tags, wherever they lie, and traffic without an adversary has none."""

from dataclasses import replace

import crossing_scenes
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from places import ROOT
from scenes import DT, TIME, absent, scene
from two_car_scenes import transformed

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case, load_header
from regents_cosim.cases.suite import load_suite
from regents_cosim.errors import RegentsError
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.saving import save_unlisted
from regents_cosim.scenario.collisions import first_contact
from regents_cosim.scenario.scenario import Tracks
from regents_cosim.tags.table import MANOEUVRES, TAGS, require_tags, tags_of

LANE_M = 3.2


def moving(*cars):
    """A scene of cars (x, y, speed, yaw), each an array over time or a number."""
    rows = [[np.broadcast_to(np.asarray(value, float), TIME.shape) for value in car] for car in cars]
    x, y, speed, yaw = (np.stack(values) for values in zip(*rows, strict=True))
    made = scene(*((0.0, LANE_M * i, 10.0) for i in range(len(cars))))
    return replace(made, tracks=Tracks(x, y, yaw, speed, np.ones(x.shape, bool)))


def aside(begin_s, lasting_s, shift_m):
    """How far a road user has moved sideways by each instant [m]."""
    done = np.clip((TIME - begin_s) / lasting_s, 0.0, 1.0)
    return shift_m * (1.0 - np.cos(np.pi * done)) / 2.0


def along(x, speed):
    """A car that drives along x: its place, speed and heading."""
    return x + np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * DT)])


def steady(x, y, speed):
    return x + speed * TIME, y, speed, 0.0


def of_adversary(case):
    assert first_contact(case.agents, case.tracks), "the two never touch"
    return {tag for tag in tags_of(case) if tag in MANOEUVRES}


def cut_in(ego_m_s, slower_m_s, begin_s, side):
    """A slower car, ahead in the lane beside, comes over in front of the ego."""
    other_m_s = ego_m_s - slower_m_s
    ahead_m = 9.0 + slower_m_s * (begin_s + 2.0)
    y = LANE_M + side * (LANE_M - aside(begin_s, 2.0, LANE_M))
    yaw = np.arctan2(np.gradient(y, DT), other_m_s)
    return moving(steady(0.0, LANE_M, ego_m_s), (ahead_m + other_m_s * TIME, y, other_m_s, yaw))


def braking(ego_m_s, hard, begin_s, gap_m):
    """The car ahead in the ego's lane brakes so hard until it stands, and the ego drives on."""
    speed = np.maximum(ego_m_s - hard * np.maximum(TIME - begin_s, 0.0), 0.0)
    return moving(steady(0.0, 0.0, ego_m_s), (along(gap_m, speed), 0.0, speed, 0.0))


def drift(speed, ahead_m, begin_s, side):
    """A car beside the ego, as fast, comes over into its side."""
    y = LANE_M + side * (LANE_M - aside(begin_s, 3.0, LANE_M))
    yaw = np.arctan2(np.gradient(y, DT), speed)
    return moving(steady(0.0, LANE_M, speed), (ahead_m + speed * TIME, y, speed, yaw))


SPEED_M_S, BEGIN_S, SIDE = st.floats(9.0, 14.0), st.floats(0.5, 1.5), st.sampled_from([-1, 1])
CUT_IN = st.tuples(SPEED_M_S, st.floats(3.0, 5.0), BEGIN_S, SIDE)
HARD = st.tuples(SPEED_M_S, st.floats(3.6, 8.0), BEGIN_S, st.floats(8.0, 14.0))
GENTLE = st.tuples(SPEED_M_S, st.floats(1.5, 3.4), BEGIN_S, st.floats(8.0, 12.0))
DRIFT = st.tuples(SPEED_M_S, st.floats(-3.0, 1.5), st.floats(0.5, 3.0), SIDE)


@settings(max_examples=6)
@given(CUT_IN)
def test_who_comes_over_ahead_cuts_in(numbers):
    assert of_adversary(cut_in(*numbers)) == {"cut_in"}


@settings(max_examples=6)
@given(HARD)
def test_who_brakes_hard_ahead_is_a_hard_brake(numbers):
    assert of_adversary(braking(*numbers)) == {"hard_brake"}


@settings(max_examples=6)
@given(GENTLE)
def test_who_brakes_gently_is_none(numbers):
    assert of_adversary(braking(*numbers)) == set()


def test_how_hard_one_brakes_does_not_depend_on_the_length_of_a_step():
    case = braking(10.0, 3.9, 1.0, 8.0)
    rows = (getattr(case.tracks, name)[:, ::2] for name in ("x", "y", "yaw", "speed", "valid"))
    assert of_adversary(replace(case, dt=2.0 * DT, tracks=Tracks(*rows))) == {"hard_brake"}


def test_who_brakes_gently_unseen_is_none():
    case = braking(12.0, 2.5, 0.5, 8.0)
    assert of_adversary(case) == set()
    assert of_adversary(absent(case, (1, slice(11, 18)))) == set()


@settings(max_examples=6)
@given(DRIFT)
def test_who_comes_over_beside_drifts(numbers):
    assert of_adversary(drift(*numbers)) == {"lane_drift"}


def test_the_ego_that_comes_over_is_not_cut_in_upon():
    y = LANE_M - aside(0.5, 2.0, LANE_M)
    ego = (12.0 * TIME, y, 12.0, np.arctan2(np.gradient(y, DT), 12.0))
    case = moving(ego, steady(16.0, 0.0, 7.0))
    assert of_adversary(case) == set()
    assert "ego_changes_lane" in tags_of(case)


@pytest.mark.parametrize(("ahead_m", "tags"), [(55.0, {"cut_out"}), (70.0, set())])
def test_a_lead_that_uncovers_a_standing_car_lately_cuts_out(ahead_m, tags):
    y = LANE_M + aside(1.0, 1.5, LANE_M)
    lead = (15.0 + 12.0 * TIME, y, 12.0, np.arctan2(np.gradient(y, DT), 12.0))
    case = moving(steady(0.0, LANE_M, 12.0), steady(ahead_m, LANE_M, 0.0), lead)
    assert of_adversary(case) == tags


# --- where ways cross -----------------------------------------------------------------------------


def crossing(*cars):
    return crossing_scenes.scenario(crossing_scenes.straight("ego", -12.0, crossing_scenes.LANE_Y, 0.0, 10.0), *cars)


def test_who_crosses_straight_on_is_a_crossing_path():
    case = crossing(crossing_scenes.straight("other", 1.7, -14.0, np.pi / 2, 9.0))
    assert "crossing_path" in of_adversary(case)
    assert not {"turn_across_path", "turn_into_path", "cut_in", "hard_brake"} & of_adversary(case)
    assert "junction" in tags_of(case)


def test_who_comes_from_ahead_and_turns_left_turns_across():
    case = crossing(crossing_scenes.turning("other", 12.0, 1.7, np.pi, 5.0, 0.12))
    assert "turn_across_path" in of_adversary(case)
    assert not {"crossing_path", "turn_into_path", "cut_in"} & of_adversary(case)


def test_only_a_vehicle_goes_the_wrong_way():
    crashes = [case for case in load_suite(ROOT / "scenarios/on_foot") if case.collision]
    assert not any("wrong_way" in tags_of(case) for case in crashes)
    assert any("wrong_way" in tags_of(_by_car(case)) for case in crashes)


def _by_car(case):
    agents = list(case.agents)
    agents[case.adversary] = replace(agents[case.adversary], kind="car")
    return replace(case, agents=tuple(agents))


# --- whatever the scene -----------------------------------------------------------------------------


@pytest.mark.slow
@settings(max_examples=4)
@given(
    cut=CUT_IN,
    drifts=DRIFT,
    angle=st.floats(-3.0, 3.0),
    to=st.tuples(st.floats(-500.0, 500.0), st.floats(-500.0, 500.0)),
)
def test_tags_do_not_depend_on_where_a_scene_lies(cut, drifts, angle, to):
    for case in (cut_in(*cut), drift(*drifts)):
        assert tags_of(transformed(case, angle, *to, 1)) == tags_of(case)


def test_recorded_traffic_has_no_adversary():
    tags = tags_of(moving(steady(0.0, 0.0, 10.0), steady(30.0, 0.0, 10.0)))
    assert tags == ("ego_goes_straight", "straight", "sparse")


def ring(radius_m: float) -> RoadMap:
    """A ring of four lanes."""
    quarters = np.linspace(0.0, 2.0 * np.pi, 33).reshape(-1)
    points = radius_m * np.stack([np.cos(quarters), np.sin(quarters)], axis=-1)
    lanes = tuple(Lane(f"q{i}", points[8 * i : 8 * i + 9], LANE_M, 10.0) for i in range(4))
    links = tuple(crossing_scenes.road().connections[0].__class__(f"q{i}", f"q{(i + 1) % 4}") for i in range(4))
    return RoadMap(lanes, links, shapely.Point(0, 0).buffer(radius_m + 5.0))


@pytest.mark.parametrize(("radius_m", "place"), [(15.0, "roundabout"), (35.0, "roundabout"), (60.0, "curve")])
def test_a_small_ring_is_a_roundabout_and_a_large_one_a_bend(radius_m, place):
    speed = 8.0
    turn = speed / radius_m * TIME
    x, y = radius_m * np.cos(turn), radius_m * np.sin(turn)
    case = moving((x, y, speed, turn + np.pi / 2), (1.3 * x, 1.3 * y, 1.3 * speed, turn + np.pi / 2))
    assert place in tags_of(replace(case, road=ring(radius_m)))


# --- on disk ----------------------------------------------------------------------------------------


def test_a_case_on_disk_says_its_tags_which_are_no_part_of_its_hash(tmp_path):
    case = moving(steady(0.0, 0.0, 10.0), steady(30.0, 0.0, 10.0))
    folder = save_unlisted(case, tmp_path)
    assert load_header(folder).tags == tags_of(case)
    text = (folder / "scenario.json").read_text()
    (folder / "scenario.json").write_text(text.replace('"ego_goes_straight"', '"ego_stops"'))
    assert content_hash(load_case(folder)) == content_hash(case)


def test_an_unknown_tag_is_told_the_nearest_names():
    require_tags(["cut_in", "junction"])
    with pytest.raises(RegentsError, match="unknown tag 'cutin': did you mean cut_in"):
        require_tags(["cutin"])
    with pytest.raises(RegentsError, match="expected one of cut_in, cut_out"):
        require_tags(["qqqq"])


def test_every_tag_is_in_the_documentation_with_its_definition_and_source():
    page = (ROOT / "docs" / "tags.md").read_text()
    for tag in TAGS.values():
        assert f"| `{tag.name}` | {tag.says} | {tag.source} |" in page
