"""Cases in highway-env: roads, scripted vehicles, the verdict."""

import itertools
import json
from dataclasses import replace

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from command import regents
from highway_env.road.lane import CircularLane, StraightLane
from hypothesis import given
from hypothesis import strategies as st
from scenes import absent, platoon, scene
from shipped_cases import crash_on, shipped_window

from regents_cosim.cases.files import load_case
from regents_cosim.errors import PlannerError, RegentsError
from regents_cosim.geometry.frames import Pose, points_to_highway
from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.highway_bicycle import roll_out
from regents_cosim.mirror.world import scene_origin, to_tracks
from regents_cosim.replays.highway.gym import network_of
from regents_cosim.replays.highway.replay import drive_in_highway, replay_in_highway
from regents_cosim.replays.replay import replay
from regents_cosim.routes.to_target import way_to_target
from regents_cosim.simulators.highway.agents import find_agent
from regents_cosim.simulators.highway.environments import environments
from regents_cosim.simulators.highway.net import to_road_map
from regents_cosim.simulators.highway.road import CentreLine, beside_lane, build_network, route_along

# --- roads ------------------------------------------------------------------------------------


def bend() -> CentreLine:
    angles = np.linspace(0.0, 1.5, 20)
    arc = 30.0 * np.stack([np.sin(angles), 1.0 - np.cos(angles)], axis=-1)
    return CentreLine(np.concatenate([[[-20.0, 0.0]], arc]), 3.2, None, 10.0)


@given(st.floats(-30.0, 90.0), st.floats(-4.0, 4.0))
def test_a_lane_finds_its_own_points(along, across):
    lane = bend()
    point = lane.position(along, across)
    longitudinal, lateral = lane.local_coordinates(point)
    np.testing.assert_allclose(lane.position(longitudinal, lateral), point, atol=1e-9)
    assert lateral == pytest.approx(across, abs=0.02)  # between two pieces of the polyline


@given(st.floats(-50, 50), st.floats(-50, 50))
def test_a_lane_of_two_points_is_highway_env_s_straight_one(x, y):
    ends = np.array([[-10.0, 3.0], [25.0, -8.0]])
    mine, theirs = CentreLine(ends, 3.2, None, 10.0), StraightLane(ends[0], ends[1])
    assert mine.local_coordinates(np.array([x, y])) == pytest.approx(theirs.local_coordinates(np.array([x, y])))
    assert mine.heading_at(5.0) == pytest.approx(theirs.heading_at(5.0))


def test_the_leftmost_lane_comes_first():
    network = network_of(platoon())
    (lanes,) = (found for onward in network.graph.values() for found in onward.values())
    assert [lane.start[1] for lane in lanes] == pytest.approx([-6.4, -3.2, 0.0])  # y south: the northernmost first


def test_a_network_of_highway_env_survives_the_way_there_and_back():
    """merge-v1 has a ramp that one may leave and not enter, and curved lanes."""
    environments()
    before = gymnasium.make("merge-v1", disable_env_checker=True).unwrapped.road.network
    road = to_road_map(before)
    after = build_network(road, np.concatenate([lane.centre for lane in road.lanes]))
    assert len(after.lanes_list()) == len(before.lanes_list()) == 9
    for lane in before.lanes_list():
        spots = [lane.position(along, 0.0) for along in np.linspace(2.0, lane.length - 2.0, 5)]
        index = after.get_closest_lane_index(spots[2], lane.heading_at(lane.length / 2))
        twin = after.get_lane(index)
        assert twin.forbidden == lane.forbidden or len(after.all_side_lanes(index)) == 1
        assert max(twin.distance(spot) for spot in spots) < 0.1


def test_distances_along_an_arc_of_highway_env_are_the_same_in_a_replay():
    """Far from the arc too, as highway-env orders by them what an agent sees."""
    environments()
    before = gymnasium.make("roundabout-v1", disable_env_checker=True).unwrapped.road.network
    road = to_road_map(before)
    after = build_network(road, np.concatenate([lane.centre for lane in road.lanes]))
    places = np.array([[30.0, 40.0], [-25.0, 3.0], [0.0, -21.0], [5.0, 5.0]])
    arcs = [lane for lane in before.lanes_list() if isinstance(lane, CircularLane)]
    assert len(arcs) == 16
    for lane in arcs:
        middle = 0.5 * lane.length
        twin = after.get_lane(after.get_closest_lane_index(lane.position(middle, 0.0), lane.heading_at(middle)))
        expected = np.array([lane.local_coordinates(place) for place in places])
        np.testing.assert_allclose([twin.local_coordinates(place) for place in places], expected, atol=1e-6)
        np.testing.assert_allclose(np.stack(beside_lane(twin, places), axis=-1), expected, atol=1e-6)


@pytest.mark.parametrize("name", ["roundabout", "crossing", "multilane", "grid"])
def test_everybody_is_on_a_lane_that_the_case_has_there(name):
    """Cropped, mirrored and regrouped, the network still has the nearest lane of the map under each vehicle."""
    case = shipped_window(name)
    network = network_of(case)
    assert len(network.lanes_list()) <= len(case.road.lanes)
    spots = np.stack([case.tracks.x, case.tracks.y], axis=-1)[case.tracks.valid][::20]
    for spot in spots:
        mine = min(lane.distance(points_to_highway(spot)) for lane in network.lanes_list())
        lines = case.road.centre_lines
        theirs = lines.geometries[lines.nearest(shapely.Point(spot))].distance(shapely.Point(spot))
        assert mine == pytest.approx(theirs, abs=0.1)


def test_routes_are_connected():
    case = shipped_window("crossing")
    network = network_of(case)
    start = Pose(*(float(values[0, 0]) for values in (case.tracks.x, case.tracks.y, case.tracks.yaw)))
    route = route_along(network, way_to_target(case.road, start, 0.0, case.target))
    assert len(route) >= 2
    assert all(before[1] == after[0] for before, after in itertools.pairwise(route))
    assert all(network.get_lane(index) for index in route)


# --- replays ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["multilane", "merge", "roundabout"])
def test_on_tracks_the_same_crash_happens_and_nobody_is_off(name):
    result = replay(load_case(crash_on(name)), "highway")
    assert result.verified, result.reason
    assert result.position_error_m.max() == 0.0
    assert result.yaw_error_deg.max() < 1e-9
    assert result.found is None or result.reports_same_pair


def test_a_crash_throws_nobody_off_its_track():
    """The ego drives through a slower vehicle, highway-env says crashed at every such step."""
    case = scene((0.0, 0.0, 20.0), (30.0, 0.0, 5.0), (30.0, 3.2, 5.0))
    for mode in ("track", "actions"):
        result = replay(case, "highway", mode=mode)
        assert result.found == ("car01", result.expected[1])
        assert result.position_error_m.max() < 1e-6
        assert {hit.victim for hit in result.own_collisions} == {"car01"}
        assert len(result.own_collisions) > 5


def driven_by_the_twin():
    """A case whose tracks are a roll-out of the twin; every second vehicle brakes to a stand."""
    recorded = replace(platoon(4), provenance=replace(platoon().provenance, source="highway"))
    start, steps = jax.tree.map(lambda values: values[:, 0], from_tracks(recorded)), recorded.tracks.steps - 1
    row, time = np.arange(4)[:, None], np.arange(steps)
    accel, curvature = -1.5 * (row % 2) + np.sin(0.1 * time + row), 0.03 * np.cos(0.15 * time + row)
    controls = ControlArrays(*(jnp.asarray(values, jnp.float32) for values in (accel, curvature)))
    half = jnp.array([0.5 * agent.length for agent in recorded.agents], jnp.float32)
    return replace(
        recorded,
        tracks=to_tracks(roll_out(start, controls, jnp.ones((4, steps), bool), half, recorded.dt), controls, recorded),
    )


def from_tracks(scenario):
    """Its motion in the device's coordinates."""
    t, (east, north) = scenario.tracks, scene_origin(scenario)
    return Motion(*(jnp.asarray(values, jnp.float32) for values in (t.x - east, t.y - north, t.yaw, t.speed)))


def test_by_its_actions_highway_env_reproduces_the_twin():
    case = driven_by_the_twin()
    assert np.abs(np.diff(case.tracks.yaw, axis=1)).max() > 0.01
    assert case.tracks.speed.min() == 0.0
    result = replay(case, "highway", mode="actions")
    assert result.verified, result.reason
    assert result.position_error_m.max() < 2e-4
    assert result.yaw_error_deg.max() < 1e-6


@pytest.mark.slow
def test_tracks_of_another_model_are_followed_closely_by_actions():
    result = replay(load_case(crash_on("merge")), "highway", mode="actions")
    assert result.found == result.expected
    assert 1e-4 < result.position_error_m.max() < 0.1


def test_a_late_agent_comes_and_goes():
    made = absent(platoon(4), (2, slice(20)), (2, slice(60, None)))
    for mode in ("track", "actions"):
        seen = replay_in_highway(made, mode=mode).tracks
        np.testing.assert_array_equal(seen.valid, made.tracks.valid)
        np.testing.assert_allclose(seen.x, made.tracks.x, atol=1e-6)


def test_a_planner_of_the_mirror_drives_among_them():
    case = scene((0.0, 0.0, 12.0), (40.0, 0.0, 4.0))
    tracks = replace(case.tracks, x=np.where([[True], [False]], 0.0 * case.tracks.x, case.tracks.x))
    result = replay(replace(case, tracks=tracks), "highway", planner="constant_velocity")
    assert result.expected is None  # by its track the ego stands
    assert result.found == ("car01", 45)
    assert result.position_error_m[1:].max() == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("agent", ["idm", "random"])
def test_agents_of_highway_env_drive_the_ego(agent):
    case = scene((0.0, 0.0, 12.0), (40.0, 0.0, 4.0), (60.0, 3.2, 12.0))
    seen = drive_in_highway(case, agent)
    assert seen.tracks.steps == case.tracks.steps
    np.testing.assert_array_equal(seen.tracks.x[1:], case.tracks.x[1:])
    assert np.abs(seen.tracks.x[0] - case.tracks.x[0]).max() > 1.0
    again = drive_in_highway(case, agent)
    np.testing.assert_array_equal(seen.tracks.x, again.tracks.x)


@pytest.mark.parametrize("where", ["highway", "mirror"])
def test_on_a_map_without_lanes_it_drives_along_the_ego_s_route(where):
    """Logs without a map have none."""
    made = scene((0.0, 0.0, 10.0), (200.0, 3.2, 10.0), steps=21)
    bare = replace(made, road=replace(made.road, lanes=(), connections=()))
    assert replay(bare, "highway").verified
    (x, *_), (y, *_) = (values[:, -1] for values in (bare.tracks.x, bare.tracks.y))
    driven = replay(bare, where, planner="highway:idm").replayed.tracks
    assert (driven.x[0, -1], driven.y[0, -1]) == pytest.approx((x, y), abs=5.0)


def test_highway_env_s_idm_does_not_run_into_the_slow_one():
    case = scene((0.0, 0.0, 12.0), (40.0, 0.0, 4.0), (37.0, 3.2, 4.0), (40.0, 6.4, 4.0))
    assert replay(case, "highway", planner="highway:idm").found is None


@pytest.mark.parametrize("where", ["highway", "mirror"])
def test_only_sumo_has_a_window(where):
    with pytest.raises(RegentsError, match=f"expected --in sumo, found --in {where}"):
        replay(platoon(), where, gui=True)


def test_wrong_agents_are_explained(tmp_path):
    with pytest.raises(PlannerError, match="did you mean .*idm"):
        replay(platoon(), "highway", planner="highway:idmm")
    (tmp_path / "bad.py").write_text("number = 3\ndef breaks(observation):\n    raise KeyError('lost')\n")
    with pytest.raises(PlannerError, match="is a int"):
        find_agent(f"{tmp_path / 'bad.py'}:number")
    with pytest.raises(PlannerError, match="lost"):
        drive_in_highway(platoon(), f"{tmp_path / 'bad.py'}:breaks")


@pytest.mark.slow
def test_the_command(tmp_path):
    case = crash_on("multilane")
    done = regents("replay", case, "--in", "highway", "--json", "--record", tmp_path / "still.png", code=0)
    (row,) = json.loads(done.stdout)
    assert row["verified"]
    assert row["position_error_mm"] == 0.0
    assert (tmp_path / "still.png").stat().st_size > 1000
