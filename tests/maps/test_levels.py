import subprocess
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
import shapely
import two_levels
from hypothesis import given
from hypothesis import strategies as st
from mirror_drives import replay_in_mirror
from scenes import PROVENANCE

from benchmarks.focused_cost import FOCUSED_COST
from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import KING, REGENTS
from regents_cosim.errors import LogError
from regents_cosim.maps.levels import contains, drivable_at, has_levels
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.rollout import others
from regents_cosim.mirror.separation import Box, distance, overlaps
from regents_cosim.mirror.world import to_world
from regents_cosim.planners.closed_loop import ClosedLoop
from regents_cosim.scenario.collisions import find_overlaps, first_contact
from regents_cosim.scenario.scenario import Agent, Scenario, Tracks
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.sources.fcd import record_fcd
from regents_cosim.sources.sumo import record_sumo
from regents_cosim.sources.windows import Windows

BRIDGE_M = 8.0


def crossing_roads(bridge_m=BRIDGE_M):
    """A road along x at height 0, and one along y that climbs to a bridge over it and comes down again."""
    under = Lane("under", np.array([[-300.0, 0.0], [300.0, 0.0]]), 3.2, 14.0)
    way = np.array([[0.0, -300.0], [0.0, -100.0], [0.0, 100.0], [0.0, 300.0]])
    over = Lane("over", way, 3.2, 14.0, height=np.array([0.0, bridge_m, bridge_m, 0.0]))
    area = shapely.union_all([shapely.LineString(lane.centre).buffer(1.6, cap_style="flat") for lane in (under, over)])
    return RoadMap((under, over), (), area)


def meeting(bridge_m=BRIDGE_M):
    """Two cars that are at the crossing at the same time, one of them on the bridge."""
    time = 0.1 * np.arange(81)
    way = 10.0 * (time - 4.0)
    x, y = np.stack([way, 0.0 * way]), np.stack([0.0 * way, way])
    yaw = np.array([[0.0], [0.5 * np.pi]]) + 0.0 * x
    tracks = Tracks(
        x, y, yaw, np.full_like(x, 10.0), np.ones(x.shape, bool), z=np.stack([0.0 * way, bridge_m + 0.0 * way])
    )
    agents = (Agent("ego", "car", 4.6, 1.8, "ego"), Agent("over", "car", 4.6, 1.8))
    return Scenario("meeting", 0.1, agents, tracks, (40.0, 0.0), crossing_roads(bridge_m), PROVENANCE)


def test_cars_on_two_levels_do_not_collide():
    two, one = meeting(), meeting(bridge_m=0.0)
    assert first_contact(one.agents, one.tracks) is not None
    assert first_contact(two.agents, two.tracks) is None
    assert find_overlaps(one.agents, one.tracks)
    assert not find_overlaps(two.agents, two.tracks)


def test_beside_the_bridge_there_is_no_road_at_its_height():
    road = crossing_roads()
    assert has_levels(road)
    assert not has_levels(crossing_roads(bridge_m=0.0))
    places = np.array([[0.0, 0.0], [5.0, 0.0], [0.0, 5.0], [0.0, -200.0], [200.0, 0.0]])
    assert contains(road, places, BRIDGE_M).tolist() == [True, False, True, True, True]
    assert contains(road, places, 0.0).tolist() == [True, True, False, True, True]
    assert drivable_at(road, 0.0).area < road.drivable.area


@given(st.floats(-90, 90), st.floats(-1.5, 1.5))
def test_whoever_leaves_its_way_stays_on_its_road(along, aside):
    heights = meeting().heights
    assert heights.of(0, np.array(along), np.array(aside)) == pytest.approx(0.0, abs=0.1)
    assert heights.of(1, np.array(aside), np.array(along)) == pytest.approx(BRIDGE_M, abs=0.1)


def test_a_slope_that_was_not_recorded_is_followed():
    case, y = meeting(), np.linspace(0.0, 160.0, 81)
    found = case.heights.of(1, 0.0 * y, y)
    np.testing.assert_allclose(found, np.interp(y, [100.0, 300.0], [BRIDGE_M, 0.0]), atol=0.1)


@pytest.mark.slow
def test_the_device_knows_the_same_heights():
    case = meeting()
    world = to_world(case)
    np.testing.assert_allclose(world.height(world.log)[:2], case.tracks.z, atol=0.25)
    assert to_world(meeting(bridge_m=0.0)).heights is None


def test_on_the_device_levels_are_far_apart_and_draw_nobody():
    world = to_world(meeting())
    boxes = world.boxes(world.log)
    ego, over = (Box(*(None if v is None else v[i] for v in vars(boxes).values())) for i in (0, 1))
    assert not overlaps(ego, over).any()
    assert (distance(ego, over) > 1e3).all()
    assert not np.asarray(world.apart[0, 0])


def test_the_road_field_is_that_of_the_own_level():
    world, field = to_world(meeting()), None
    field = world.road
    beside = jnp.array([8.0]), jnp.array([0.0])
    assert field(*beside, jnp.array([0.0])) < 0.1
    assert field(*beside, jnp.array([BRIDGE_M])) > 0.9


@pytest.mark.parametrize("planner", ["idm", "constant_velocity"])
def test_nobody_brakes_for_a_car_on_the_bridge(planner):
    log, case = meeting().tracks, meeting()
    standing = replace(log, y=np.where(np.arange(2)[:, None] == 1, 0.0, log.y), speed=log.speed * [[1.0], [0.0]])
    driven = replay_in_mirror(replace(case, tracks=standing), planner)
    assert driven.speed[0].min() > 9.5
    assert np.ptp(driven.z[0]) < 0.1
    if planner == "idm":
        below = replace(standing, z=np.zeros(log.z.shape))
        assert replay_in_mirror(replace(case, tracks=below), planner).speed[0].min() < 1.0


def test_a_planner_on_the_host_is_told_the_heights():
    case = meeting()
    world = to_world(case)
    seen = ClosedLoop(case, world, world.log, None).seen
    assert seen.z.tolist() == [0.0, BRIDGE_M]
    traffic = others(world, world.log, world.valid)
    np.testing.assert_allclose(traffic.z[0], BRIDGE_M, atol=0.1)
    assert isinstance(traffic.motion, Motion)


@pytest.fixture(scope="module")
def two_roads(tmp_path_factory):
    """A configuration of SUMO whose two roads cross on two levels, and what it records."""
    pytest.importorskip("sumo", reason="netconvert is in the eclipse-sumo wheel")
    config = two_levels.build(tmp_path_factory.mktemp("levels"))
    return config, record_sumo(SumoInput(config=config), Windows(count=2, horizon_s=4.0), tell=lambda _: None)


@pytest.mark.slow
def test_sumo_is_recorded_with_heights(two_roads):
    _, cases = two_roads
    for case in cases:
        assert not case.overlaps
        assert case.heights.stacked
        for agent, z in zip(case.agents, case.tracks.z, strict=True):
            assert z.max() <= two_levels.BRIDGE_M
            assert agent.id.startswith("north") or not z.any()
        known = case.heights(case.tracks.x, case.tracks.y)
        np.testing.assert_allclose(known[case.tracks.valid], case.tracks.z[case.tracks.valid], atol=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("attributes", ["x,y,z,angle,type,lane", "x,y,angle,type,lane", "x,y,angle,type"])
def test_an_fcd_output_has_them_itself_or_by_its_lanes(two_roads, tmp_path, attributes):
    config, _ = two_roads
    log, net = tmp_path / "fcd.xml", config.with_name("levels.net.xml")
    options = ["-c", config, "--step-length", "0.1", "--end", "12", "--fcd-output", log, "--precision", "6"]
    program = Path(pytest.importorskip("sumo").SUMO_HOME) / "bin" / "sumo"
    words = [program, *options, "--fcd-output.attributes", attributes, "--no-step-log", "true"]
    subprocess.run([str(word) for word in words], check=True, capture_output=True)
    if attributes.endswith("type"):
        with pytest.raises(LogError, match="roads of the network lie above each other; expected z"):
            record_fcd(log, net, Windows(horizon_s=4.0), routes_or_types=(config.with_name("levels.rou.xml"),))
        return
    found = record_fcd(log, net, Windows(count=2, horizon_s=4.0), routes_or_types=(config.with_name("levels.rou.xml"),))
    assert all(not case.overlaps for case in found)
    for case in found:
        for agent, z, valid in zip(case.agents, case.tracks.z, case.tracks.valid, strict=True):
            assert (z[valid] > 0.0).all() == agent.id.startswith("north")


@pytest.mark.slow
@pytest.mark.parametrize("config", [KING, REGENTS, FOCUSED_COST], ids=["king", "regents", "focused"])
def test_no_attack_crashes_two_levels_into_each_other(two_roads, config):
    _, cases = two_roads
    found = list(attack(cases, config.but(iterations=100), "idm"))
    assert any(result.attack.outcome == "collision" for result in found)
    for result in found:
        if result.collision:
            assert result.collision.agent.partition(".")[0] == result.ego.id.partition(".")[0]


def test_a_lane_without_a_length_takes_no_road():
    """As a map from elsewhere may have one."""
    road = crossing_roads()
    point = Lane("point", np.array([[1.0, 1.0], [1.0, 1.0]]), 3.2, 14.0, height=np.array([8.0, 8.0]))
    more = replace(road, lanes=(*road.lanes, point))
    for height in (0.0, BRIDGE_M):
        assert drivable_at(more, height).equals(drivable_at(road, height))
