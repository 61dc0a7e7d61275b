"""`Scene.route`: what the map tells of the way to the target, and nothing of what the log's driver did."""

import inspect
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from scenes import scene, straight_road
from shipped_cases import shipped_window, shipped_windows
from two_car_scenes import crossroads

from regents_cosim.maps.right_of_way import priorities
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.planners.idm import IDM
from regents_cosim.planners.interface import Observation, Others, Scene
from regents_cosim.routes.route import route_into_gaps, route_of
from regents_cosim.scenario.scenario import Tracks

NETWORKS = ("crossing", "signals", "merge", "multilane", "roundabout", "grid")


def scene_of(scenario):
    return Scene.of(scenario, 6.0, 0.3)


def seen(scenario, step=0, before=None):
    tracks, told = scenario.tracks, scene_of(scenario)
    x, y, yaw, speed, valid, z = (
        values[:, step] for values in (tracks.x, tracks.y, tracks.yaw, tracks.speed, tracks.valid, tracks.z)
    )
    ego = replace(told.ego, x=float(x[0]), y=float(y[0]), yaw=float(yaw[0]), speed=float(speed[0]))
    others = Others(told.others, x[1:], y[1:], yaw[1:], speed[1:], valid[1:], z[1:])
    return Observation(told, step, ego, others, before)


def another_future(scenario):
    """The scenario with another log from the second step on, with the same target."""
    tracks = scenario.tracks

    def changed(values):
        return np.concatenate([values[:, :1], values[:, 1:] + 7.0 * scenario.tracks.valid[:, 1:]], axis=1)

    moved = Tracks(changed(tracks.x), changed(tracks.y), tracks.yaw, tracks.speed, tracks.valid, z=tracks.z)
    return replace(scenario, tracks=moved)


@pytest.mark.parametrize("network", ["crossing", "merge", "multilane"])
def test_the_log_of_the_ego_does_not_tell_the_route(network):
    made = shipped_window(network)
    other = another_future(made)
    assert np.array_equal(route_of(made).points, route_of(other).points)
    assert np.array_equal(route_into_gaps(made).points, route_into_gaps(other).points)
    memories = [IDM().on_route(one, np.zeros(2)) for one in (made, other)]
    assert np.array_equal(memories[0].x, memories[1].x)
    assert np.array_equal(memories[0].speed, memories[1].speed)


def shipped():
    return [window for network in NETWORKS for window in shipped_windows(network)]


def test_every_route_leads_from_the_start_to_the_target_on_the_road():
    for window in shipped():
        route = route_of(window)
        start, line = [window.tracks.x[0, 0], window.tracks.y[0, 0]], shapely.LineString(route.points)
        assert np.hypot(*(route.points[0] - start)) < 0.01, window.id
        assert line.distance(shapely.Point(window.target)) < 3.0, window.id
        on_lanes = route.points[: int(route.target_m)]
        assert window.road.contains(on_lanes).all(), window.id
        assert np.hypot(*np.diff(route.points, axis=0).T) == pytest.approx(1.0, abs=0.1), window.id
        assert np.isfinite(route.curvature).all()


def test_its_lanes_are_in_order_and_continue_each_other():
    for window in shipped():
        route, road = route_of(window), window.road
        ends = [one.end_m for one in route.lanes[:-1]]
        assert ends == [one.begin_m for one in route.lanes[1:]]
        assert ends == sorted(ends)
        for one, after in zip(route.lanes, route.lanes[1:], strict=False):
            lane = road.lane[one.lane]
            beside = after.lane in (lane.left, lane.right)
            assert beside == (one.leaves_to is not None)
            assert beside or any(link.target == after.lane for link in road.exits[one.lane]), window.id


def test_a_light_is_where_its_lane_ends():
    found = 0
    for window in shipped_windows("signals"):
        route = route_of(window)
        for light in route.lights:
            end = window.road.lane[light.lane].centre[-1]
            assert float(route.project(*end).along) == pytest.approx(light.distance_m, abs=0.6)
            assert light.shows(window.signals, 0) in "rygGuOos"
            found += 1
    assert found


@pytest.mark.parametrize("before_m", [0.1, 2.0, 30.0])
def test_a_light_is_on_the_route_wherever_the_ego_begins_before_it(before_m):
    window = next(one for one in shipped_windows("signals") if route_of(one).lights)
    light = route_of(window).lights[0]
    lane = shapely.LineString(window.road.lane[light.lane].centre)
    at, ahead = (lane.interpolate(lane.length - metres) for metres in (before_m, before_m - 0.1))
    yaw = np.arctan2(ahead.y - at.y, ahead.x - at.x)
    tracks = window.tracks
    moved = {
        name: np.concatenate([np.full((1, 1), value), getattr(tracks, name)[:1, 1:]], axis=1)
        for name, value in (("x", at.x), ("y", at.y), ("yaw", yaw))
    }
    rows = {name: np.concatenate([row, getattr(tracks, name)[1:]]) for name, row in moved.items()}
    route = route_of(replace(window, tracks=replace(tracks, **rows)))
    assert route.lights[0].distance_m == pytest.approx(before_m, abs=0.6)


@given(st.floats(0.0, 200.0), st.floats(-2.0, 2.0))
def test_a_place_beside_the_route_is_found_again(along, left):
    route = route_of(shipped_window("crossing"))
    pose = route.at(along)
    x, y = pose.x - left * np.sin(pose.yaw), pose.y + left * np.cos(pose.yaw)
    found = route.project(x, y)
    again = route.at(float(found.along))
    assert float(np.hypot(again.x - x, again.y - y)) <= abs(left) + 0.05
    assert abs(float(found.left)) <= abs(left) + 0.2


def test_a_change_of_lanes_has_a_place_and_a_limit():
    made = scene((0, 0, 10), (60, 3.2, 10), target=(150.0, 3.2))
    route = route_of(made)
    (change,) = route.changes
    assert (change.lane, change.to_lane) == ("lane0", "lane1")
    assert change.from_m == pytest.approx(0.0, abs=0.1)
    assert change.until_m == pytest.approx(600.0)
    assert change.end_m == pytest.approx(150.0, abs=2.0)
    assert route.lanes[0].leaves_to == "left"
    assert route.may_change_left[10]
    assert not route.may_change_right[10]
    early = route.changing_at(5.0)
    assert early.changes[0].begin_m == pytest.approx(5.0, abs=0.1)
    assert early.at(early.changes[0].end_m + 1.0).y == pytest.approx(3.2, abs=0.05)
    assert np.abs(early.curvature).max() < 0.03


def test_a_change_of_lanes_keeps_clear_of_the_others():
    beside = [(float(x), 3.2, 10.0) for x in (-20, -10, 0, 10, 20)]  # a gap opens only behind them
    made = scene((0, 0, 10), *beside, target=(80.0, 3.2), steps=81)
    slower = scene((0, 0, 10), *[(x, y, 4.0) for x, y, _ in beside], target=(80.0, 3.2), steps=81)
    assert route_into_gaps(slower).changes[0].begin_m > 30.0, "they fall behind"
    assert route_into_gaps(made).changes[0].begin_m > 30.0, "it waits for as long as it can"


def test_the_way_of_others_and_who_yields_is_known_where_the_network_tells_it():
    crossings = [one for window in shipped_windows("crossing") for one in route_of(window).meetings]
    assert {one.kind for one in crossings} >= {"crossing", "merge"}
    assert any(one.ego_yields for one in crossings)
    assert any(one.they_yield for one in crossings)
    assert not any(one.ego_yields and one.they_yield for one in crossings)
    assert all(one.begin_m <= one.end_m for one in crossings)


def test_without_a_table_signs_and_turns_tell_who_yields():
    made = crossroads()
    said = {"west": "yields", "south": "priority"}
    for signs, expected in (({}, (None, None)), (said, (True, False))):
        lanes = tuple(replace(lane, approach=signs.get(lane.id)) for lane in made.road.lanes)
        unlit = tuple(replace(link, signal=None) for link in made.road.connections)
        signed = replace(made, road=replace(made.road, lanes=lanes, connections=unlit))
        (met,) = route_of(signed).meetings
        assert (met.other, met.ego_yields, met.they_yield) == ("sn", *expected)
    lit = replace(signed, road=replace(signed.road, connections=made.road.connections))
    assert [one.ego_yields for one in route_of(lit).meetings] == [None]
    turning = np.array([[10.0, 3.4], [0.0, 3.4], [-2.0, 0.0], [-2.0, -10.0]])  # comes towards the ego and turns left
    left = Lane("left", turning, 3.4, 14.0, junction=True)
    both = replace(made.road, lanes=(*made.road.lanes, left))  # a light does not tell of turns
    met = {one.other: one for one in route_of(replace(made, road=both)).meetings}["left"]
    assert (met.ego_yields, met.they_yield) == (False, True)


def test_without_lanes_it_is_a_curve_to_the_target():
    bare = RoadMap((), (), straight_road().drivable)
    route = route_of(scene((0, 0, 10), road=bare, target=(60.0, 20.0)))
    assert route.lanes == route.lights == route.changes == route.meetings == ()
    assert route.at(float(route.target_m))[:2] == pytest.approx((60.0, 20.0), abs=0.7)
    assert np.isnan(route.width).all()
    standing = route_of(scene((0, 0, 0), road=bare))
    assert np.isfinite(standing.points).all()
    assert standing.length > 50.0


def test_pure_pursuit_follows_it():
    window = next(one for one in shipped_windows("crossing") if np.ptp(one.tracks.yaw[0]) > 1.0)
    route = route_of(window)
    x, y, yaw = (float(values[0, 0]) for values in (window.tracks.x, window.tracks.y, window.tracks.yaw))
    away = []
    for _ in range(int(route.target_m / 0.5)):
        curvature = route.pure_pursuit(x, y, yaw, 5.0)
        yaw += 0.5 * curvature
        x, y = x + 0.5 * np.cos(yaw), y + 0.5 * np.sin(yaw)
        away.append(abs(float(route.project(x, y).left)))
    assert max(away) < 1.0


def test_what_is_ahead_is_told_along_the_route():
    now = seen(scene((0, 0, 10), (40, 0, 5), (20, 3.2, 5), (-20, 0, 5), (70, 0, 5)))
    assert now.leader.agent.id == "car01"
    assert now.leader.gap == pytest.approx(40.0 - 4.6, abs=0.1)
    assert float(now.on_route.left) == pytest.approx(0.0, abs=1e-6)
    assert seen(scene((0, 0, 10), (20, 3.2, 5))).leader is None
    stretch = now.scene.route.ahead(10.0, 20.0)
    assert stretch.along.tolist() == list(range(10, 31))
    assert stretch.speed_limit == pytest.approx(15.0)


@pytest.mark.parametrize("stretch", [(np.nan, 3.0), (0.0, np.inf)])
def test_a_stretch_that_is_none_is_refused(stretch):
    with pytest.raises(ValueError, match=r"ahead\(.*\): expected two finite numbers \[m\]"):
        scene_of(scene((0, 0, 10))).route.ahead(*stretch)


def test_a_place_that_is_none_is_refused():
    route = scene_of(scene((0, 0, 10))).route
    unchecked = inspect.unwrap(type(route).project)  # as in the user's process
    with pytest.raises(ValueError, match=r"project\('a', 1\): expected two numbers, or arrays of one shape \[m\]"):
        unchecked(route, "a", 1)


def test_the_ego_s_own_motion_is_told_from_the_second_step_on():
    window = next(one for one in shipped_windows("crossing") if np.ptp(one.tracks.yaw[0]) > 1.0)
    turning = int(np.argmax(np.abs(np.diff(np.unwrap(window.tracks.yaw[0]))))) + 1
    before = seen(window, turning - 1)
    assert (seen(window).acceleration, seen(window).yaw_rate, seen(window).steering) == (0.0, 0.0, 0.0)
    now = seen(window, turning, before.ego)
    assert now.acceleration == pytest.approx((now.ego.speed - before.ego.speed) / window.dt)
    assert abs(now.yaw_rate) > 0.1
    assert np.sign(now.steering) == np.sign(now.yaw_rate)


def test_lights_ahead_are_those_of_the_route():
    window = next(one for one in shipped_windows("signals") if route_of(one).lights)
    (light, *_) = seen(window).lights_ahead
    assert light.gap == pytest.approx(route_of(window).lights[0].distance_m - 0.5 * window.ego.length, abs=0.1)
    assert light.shows in {one.shows for one in seen(window).lights if one.lane == light.lane}


def test_our_planners_and_those_of_others_see_the_same_route():
    for window in shipped():
        assert route_of(window).by_lanes, window.id
    bare = scene((0, 0, 10), road=RoadMap((), (), straight_road().drivable), target=(60.0, 20.0))
    assert not route_of(bare).by_lanes
    assert np.array_equal(route_into_gaps(bare).points, scene_of(bare).route.points)


@given(st.floats(-6.0, 6.0), st.floats(-np.pi, np.pi))
def test_pure_pursuit_keeps_to_what_a_control_may_ask_for(left, yaw):
    told = scene_of(shipped_window("merge"))
    for route in (told.route, told.route.changing_at(20.0)):
        assert abs(route.pure_pursuit(told.ego.x, told.ego.y + left, yaw, 0.0)) <= told.max_curvature


def test_a_route_round_a_ring_meets_those_on_the_ring_where_it_enters():
    """It goes on beyond its target until it would enter a lane again: the lane before that one has priority."""
    entered = 0
    for window in shipped_windows("roundabout"):
        route, table = route_of(window), priorities(window.road)
        met = {(one.lane, one.other): one for one in route.meetings}
        for before, after in pairwise(route.lanes):
            for link in window.road.entries[after.lane]:
                pair = before.lane, link.source
                if link.source != before.lane and table.must_yield(*pair):
                    assert met[pair].ego_yields
                    assert before.begin_m - 1.0 <= met[pair].begin_m <= met[pair].end_m <= before.end_m + 1.0
                    entered += 1
    assert entered


def test_who_gives_way_now_is_told_under_the_lights():
    turning = 0
    for window in shipped_windows("signals"):
        told = seen(window)
        shown = {one.to_lane: one.shows for one in told.lights}
        assert not any(one.ego_yields and one.they_yield for one in told.scene.route.meetings)
        for one in told.meetings_ahead:
            mine, theirs = shown.get(one.lane), shown.get(one.other)
            if {mine, theirs} in ({"G", "r"}, {"g", "r"}, {"G", "g"}):
                assert one.ego_yields == (mine == "r" or theirs == "G"), (window.id, one)
                assert one.they_yield != one.ego_yields
                turning += 1
    assert turning
