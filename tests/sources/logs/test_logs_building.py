"""From tracks and map features to 10 Hz, a drivable area and windows."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from regents_cosim.checks.work import Work
from regents_cosim.errors import LogError
from regents_cosim.geometry.frames import from_front, from_image_corner, from_lat_lon
from regents_cosim.scenario.scenario import Agent
from regents_cosim.sources.logs.cut import LogWindows, cut, without_jumps
from regents_cosim.sources.logs.missing_headings import heading_from_motion
from regents_cosim.sources.logs.planned_ego import EgoGoal, EgoStart, planned_track
from regents_cosim.sources.logs.readers.waymo import crc32c
from regents_cosim.sources.logs.resample import sample
from regents_cosim.sources.logs.roads.edges import area_inside
from regents_cosim.sources.logs.roads.road import build_road, lanelet
from regents_cosim.sources.logs.rows import steps_of
from regents_cosim.sources.logs.scene import LoggedLane, LoggedMap, LoggedScene, RoadEdge, Track, joined
from regents_cosim.sources.windows import RecordingOrigin, Windows

CAR = Agent("a", "car", 4.5, 1.8)


def track(x, y=0.0, yaw=0.0, step=None, name="a", z=None):
    x = np.asarray(x, float)
    step = np.arange(len(x)) if step is None else np.asarray(step)
    rows = [np.zeros(len(x)) + values for values in (y, yaw)]
    return Track(replace(CAR, id=name), step, x, *rows, None if z is None else np.zeros(len(x)) + z)


# --- crc, projection ----------------------------------------------------------------------------


def test_crc32c_of_published_vectors():
    assert crc32c(b"123456789") == 0xE3069283
    assert crc32c(bytes(32)) == 0x8A9136AA  # RFC 3720, B.4
    assert crc32c(b"\xff" * 32) == 0x62A8AB43
    assert crc32c(bytes(range(32))) == 0x46DD794E


def test_utm_of_known_places():
    assert from_lat_lon(0.0, 0.0, 31) == pytest.approx((166021.4431, 0.0), abs=1e-3)
    assert from_lat_lon(0.0, 3.0, 31) == pytest.approx((500000.0, 0.0), abs=1e-6)
    # Toronto's CN Tower, 43 38 33.24 N 79 23 13.7 W, is at 17T 630084 4833438 (published to a metre).
    assert from_lat_lon(43 + 38 / 60 + 33.24 / 3600, -(79 + 23 / 60 + 13.7 / 3600), 17) == pytest.approx(
        (630084, 4833438), abs=1.0
    )


def test_utm_is_no_plain_scaling_of_degrees():
    x0, y0 = from_lat_lon(0.0, 0.0, 31)
    x, y = from_lat_lon(0.009, 0.009, 31)
    assert np.hypot(x - x0 - 0.009 * 111319.49, y - y0 - 0.009 * 111319.49) > 5.0


def test_image_corners_and_front_bumpers():
    assert from_image_corner(10.0, 20.0, 4.0, 2.0) == (12.0, -21.0)
    pose = from_front(10.0, 0.0, np.pi / 2, 4.0)
    assert (pose.x, pose.y) == pytest.approx((10.0, -2.0))


# --- 10 Hz ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("dt", [0.04, 0.1, 0.2, 1 / 30])
def test_a_curve_at_any_rate(dt):
    time = np.arange(0.0, 8.01, dt)
    yaw = 3.0 + 0.3 * time  # passes pi
    x, y = 20.0 * np.sin(yaw), -20.0 * np.cos(yaw)
    one = Track(CAR, np.arange(len(time)), x, y, np.mod(yaw + np.pi, 2 * np.pi) - np.pi)
    found = sample(one, dt, 0.0, 80)
    at = 3.0 + 0.03 * np.arange(80)
    assert found.valid.all()
    inner = slice(5, -5)
    np.testing.assert_allclose(found.x[inner], 20.0 * np.sin(at)[inner], atol=0.005)
    np.testing.assert_allclose(found.y[inner], -20.0 * np.cos(at)[inner], atol=0.005)
    np.testing.assert_allclose(np.exp(1j * found.yaw), np.exp(1j * at), atol=1e-3)


def test_samples_at_ten_hertz_stay_as_they_are():
    x = np.cumsum(np.random.default_rng(0).normal(1.0, 0.3, 50))
    np.testing.assert_array_equal(sample(track(x), 0.1, 7.0, 20).x, x[7:27])


def test_nothing_is_invented_in_gaps_and_beyond_the_ends():
    one = track(np.arange(10.0), step=[2, 3, 4, 5, 9, 10, 11, 12, 13, 14])
    found = sample(one, 0.2, 0.0, 32)  # steps of 0.2 s: instant k is at step k / 2
    assert np.flatnonzero(found.valid).tolist() == [*range(4, 11), *range(18, 29)]
    assert not found.x[~found.valid].any()


def test_a_jump_becomes_a_gap_and_what_lies_between_jumps_goes():
    x = np.arange(30.0)
    x[0] = 0.9  # a box that is cut off where the vehicle enters
    x[15] += 5.0  # a detection that leaps
    found = without_jumps(track(x), 0.1)
    assert not {0, 15} & set(found.step.tolist())
    assert {*range(2, 15), *range(17, 30)} <= set(found.step.tolist())
    straight = track(np.arange(30.0))
    assert without_jumps(straight, 0.1) is straight
    assert len(without_jumps(track([1.0]), 0.1).step) == 1


def test_a_stop_does_not_ring():
    x = np.concatenate([np.arange(0.0, 10.0), np.full(10, 10.0)])
    assert sample(track(x), 0.2, 0.0, 38).x.max() <= 10.0 + 1e-9


def test_headings_follow_the_motion_and_hold_while_standing():
    x = np.concatenate([np.zeros(20), np.arange(0.0, 5.0, 0.5), np.full(20, 4.5)])
    heading = heading_from_motion(x, x)
    np.testing.assert_allclose(heading, np.pi / 4, atol=1e-9)


def test_times_become_steps():
    step, _, dt, begin = steps_of(np.array([10.0, 10.04, 10.0801, 10.2, 10.0]))
    assert (step.tolist(), dt, begin) == ([0, 1, 2, 5, 0], 0.0401, 10.0) or step.tolist() == [0, 1, 2, 5, 0]
    with pytest.raises(LogError, match="not a number"):
        steps_of(np.array([0.0, np.nan]))


# --- road -----------------------------------------------------------------------------------------


def edge(*points, z=None):
    points = np.array(points, float)
    return RoadEdge(points, None if z is None else np.full(len(points), float(z)))


def lane(*points, z=None, name="l", **more):
    points = np.array(points, float)
    return LoggedLane(name, points, z=None if z is None else np.full(len(points), float(z)), **more)


def scene(road, *tracks):
    return LoggedScene("s", 0.1, tracks or (track([0.0, 1.0]),), road)


STREET = (edge((0, -4), (100, -4)), edge((100, 4), (0, 4)))


def test_the_left_of_kerbs_is_the_road_and_an_island_is_not():
    island = edge((40, 1), (60, 1), (60, -1), (40, -1), (40, 1))  # clockwise: its outside is on the left
    road = build_road(scene(LoggedMap((), (*STREET, island))))
    inside = road.contains(np.array([[20.0, 0.0], [50.0, 3.0], [50.0, 0.0], [50.0, 5.0], [50.0, -5.0]]))
    assert inside.tolist() == [True, True, False, False, False]
    assert road.drivable.area == pytest.approx(8 * 100 - 40, abs=1.0)


def test_the_end_of_the_map_is_no_kerb_but_a_dead_end_is():
    lanes = (lane((0, 0), (100, 0), width=4.0),)
    road = build_road(scene(LoggedMap(lanes, STREET)))
    assert road.contains(np.array([[125.0, 0.0], [-25.0, 0.0]])).all()
    closed = (*STREET, edge((100, -4), (100, 4)))
    road = build_road(scene(LoggedMap(lanes, closed)))
    assert road.contains(np.array([[125.0, 0.0], [-25.0, 0.0]])).tolist() == [False, True]


def test_a_bridge_and_the_road_below_are_both_roads():
    below = [edge((-50, -4), (50, -4), z=0), edge((50, 4), (-50, 4), z=0)]
    above = [edge((4, -50), (4, 50), z=6), edge((-4, 50), (-4, -50), z=6)]
    lanes = [lane((-50, 0), (50, 0), z=0, name="b"), lane((0, -50), (0, 50), z=6, name="a")]
    found = build_road(scene(LoggedMap(tuple(lanes), tuple(below + above))))
    on = [[x, 0.0] for x in (-30, -3, 0, 3, 30)] + [[0.0, y] for y in (-30, -6, 6, 30)]
    assert found.contains(np.array(on, float)).all()
    assert not found.contains(np.array([[20.0, 20.0], [-20.0, 6.0]])).any()


def test_vehicles_on_a_bridge_do_not_come_along():
    ego = track(np.arange(0, 100, 1.0), z=0.0, name="ego")
    bridge = track(np.full(100, 50.0), y=np.linspace(-50, 50, 100), z=6.0, name="bridge")
    beside = track(np.arange(10, 110, 1.0), y=3.5, z=0.5, name="beside")
    one = replace(scene(LoggedMap((), STREET), ego, bridge, beside), ego="ego")
    (found,) = cut(one, LogWindows(Windows(horizon_s=8.0)), RecordingOrigin("x", "x", "x"), Counter())
    assert [agent.id for agent in found.agents] == ["ego", "beside"]
    assert [(one.reason, one.ids) for one in found.provenance.left_out] == [("level", ("bridge",))]


def test_without_a_map_the_road_is_where_vehicles_drove():
    road = build_road(scene(LoggedMap(), track(np.arange(50.0))))
    assert road.contains(np.array([[25.0, 1.9], [25.0, 2.1]])).tolist() == [True, False]
    walker = Track(Agent("w", "pedestrian", 0.6, 0.6), np.arange(2), np.zeros(2), np.zeros(2), np.zeros(2))
    with pytest.raises(LogError, match="neither a road nor a moving vehicle"):
        build_road(scene(LoggedMap(), walker))


def test_bounds_that_run_backwards():
    left, right = np.array([[0.0, 2.0], [10.0, 2.0]]), np.array([[0.0, -2.0], [10.0, -2.0]])
    assert lanelet(left, right).area == lanelet(left, right[::-1]).area == pytest.approx(40.0)


def test_lanes_that_meet_continue_each_other():
    lanes = joined(
        [lane((0, 0), (10, 0), name="a"), lane((10.3, 0), (20, 0), name="b"), lane((0, 5), (9, 5), name="c")], Work(0)
    )
    assert [(one.exits, one.open_start, one.open_end) for one in lanes] == [
        (("b",), True, False), ((), False, True), ((), True, True),
    ]  # fmt: skip


def test_a_lane_that_ends_where_it_begins_does_not_continue_itself():
    (ring,) = joined([lane((0, 0), (10, 0), (10, 10), (0.2, 0))], Work(0))
    assert ring.exits == ()
    assert joined([], Work(0)) == ()


@given(st.lists(st.tuples(st.floats(-80, 80), st.floats(-80, 80)), min_size=2, max_size=6))
def test_any_kerbs_give_an_area_or_none(points):
    area = area_inside((edge(*points),), ())
    assert area.is_empty or area.is_valid


# --- egos without a track -------------------------------------------------------------------------


def test_a_planned_ego_keeps_to_its_lanes_and_arrives_in_time():
    bend = np.array([(50 + 20 * np.sin(a), 20 - 20 * np.cos(a)) for a in np.linspace(0, np.pi / 2, 30)])
    lanes = (
        lane((0, 0), (50, 0), name="a", exits=("b",)),
        LoggedLane("b", bend, exits=("c",)),
        lane((70, 20), (70, 80), name="c"),
    )
    start, goal = EgoStart(5.0, 1.0, 0.0, 10.0), EgoGoal((70.0, 60.0), None, 9.0, 12.0)
    x, y, yaw = planned_track(start, goal, lanes, 0.1)
    assert (x[0], y[0]) == pytest.approx((5.0, 1.0))
    distance = np.hypot(x - 70.0, y - 60.0)
    assert distance.min() < 0.6
    assert 9.0 <= 0.1 * distance.argmin() <= 12.1
    on_bend = (x > 55) & (y < 15)
    np.testing.assert_allclose(np.hypot(x - 50, y - 20)[on_bend], 20.0, atol=0.5)
    assert np.abs(np.diff(np.unwrap(yaw))).max() < 0.2


def test_a_planned_ego_without_lanes_goes_straight_to_its_goal():
    x, y, _ = planned_track(EgoStart(0.0, 0.0, 0.0, 10.0), EgoGoal((60.0, 0.0), 0.0, 5.0, 7.0), (), 0.1)
    assert abs(y).max() < 1e-6
    assert x[60] == pytest.approx(60.0, abs=0.5)


# --- what a scene may be --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"x": np.array([0.0, np.nan])}, "NaN"),
        ({"x": np.array([0.0, 1e9])}, "beyond"),
        ({"step": np.array([3, 3])}, "does not increase"),
        ({"step": np.array([-1, 3])}, "out of range"),
        ({"agent": Agent("a", "car", 400.0, 2.0)}, "400 m long"),
        ({"yaw": np.zeros(3)}, "different lengths|axis|shape|size"),
    ],
)
def test_numbers_that_no_recording_holds(changes, said):
    with pytest.raises(Exception, match=said):
        replace(track([0.0, 1.0]), **changes)


def test_two_road_users_of_one_name():
    with pytest.raises(LogError, match="same id"):
        scene(LoggedMap(), track([0.0, 1.0]), track([5.0, 6.0]))
