from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from scenes import PROVENANCE, moving, scene, straight_road

from regents_cosim.maps.roadmap import Connection, Lane, RoadMap
from regents_cosim.mirror import rollout
from regents_cosim.mirror.rollout import roll_out_background
from regents_cosim.mirror.world import to_world
from regents_cosim.planners.idm import IDM, place_on_route
from regents_cosim.planners.jax_planner import CompiledScene
from regents_cosim.routes.ego_route import SPACING_M, logged_way
from regents_cosim.routes.route import route_on
from regents_cosim.scenario.scenario import Agent, Scenario, Signal, Tracks

drive = eqx.filter_jit(rollout.drive)  # once for all scenes of a shape


def driven(scenario, planner=None):
    """The ego's motion when IDM drives it."""
    planner, world = planner or IDM(), to_world(scenario)
    memory = planner.init(CompiledScene(scenario, world))
    motion, controls, _ = drive(planner, memory, world, roll_out_background(world, world.controls))
    return motion, controls, world


def crossing(changes=((0, "r"),), speed=12.0, steps=121):
    """A lane that ends at a light at x = 0 and goes on to the left, an arc of 20 m."""
    angle = np.linspace(0, np.pi / 2, 40)
    arc = 20.0 * np.stack([np.sin(angle), 1 - np.cos(angle)], axis=1)
    lanes = (
        Lane("in", np.array([[-300.0, 0.0], [0.0, 0.0]]), 3.2, 15.0),
        Lane("straight", np.array([[0.0, 0.0], [30.0, 0.0]]), 3.2, 15.0, junction=True),
        Lane("left", arc, 3.2, 9.0, junction=True),
        Lane("out", np.array([[20.0, 20.0], [20.0, 300.0]]), 3.2, 15.0),
    )
    links = (
        Connection("in", "straight", "tls", 0),
        Connection("in", "left", "tls", 1),
        Connection("left", "out"),
    )
    drivable = straight_road().drivable.buffer(400)
    way = speed * 0.1 * np.arange(steps) - 60.0
    bent = np.clip(way / 20.0, 0, np.pi / 2)
    x = np.where(way < 0, way, 20.0 * np.sin(bent))
    y = np.where(way < 0, 0.0, 20.0 * (1 - np.cos(bent)) + np.maximum(way - 10 * np.pi, 0))
    tracks = Tracks(x[None], y[None], bent[None], np.full((1, steps), speed), np.ones((1, steps), bool))
    letters = tuple((step, {"r": "Gr", "G": "GG"}[letter]) for step, letter in changes)
    return Scenario(
        "crossing", 0.1, (Agent("ego", "car", 4.6, 1.8, "ego"),), tracks, (20.0, 60.0),
        RoadMap(lanes, links, drivable), PROVENANCE, (Signal("tls", letters),),
    )  # fmt: skip


@pytest.mark.slow
def test_on_a_free_road_it_reaches_the_limit_and_stays_in_its_lane():
    motion, _, _ = driven(scene((0, 3.2, 5.0), steps=161))
    assert motion.speed[-1] == pytest.approx(15.0, abs=0.5)
    assert np.abs(motion.y - motion.y[0]).max() < 0.05


@pytest.mark.slow
def test_it_keeps_its_distance_to_a_slower_car():
    made = scene((0, 0, 12), (40, 0, 5), steps=161)
    motion, _, world = driven(made)
    gap = np.asarray(world.log.x[1] - motion.x) - 4.6
    assert gap.min() > 1.5
    assert motion.speed[-1] == pytest.approx(5.0, abs=0.5)


def test_it_stops_behind_a_standing_car():
    motion, _, world = driven(scene((0, 0, 12), (60, 0, 0), steps=161))
    assert motion.speed[-1] < 0.3
    assert 1.5 < world.log.x[1, -1] - motion.x[-1] - 4.6 < 3.5


@pytest.mark.slow
def test_it_does_not_mind_the_other_lanes():
    free = driven(scene((0, 3.2, 10)))[0]
    flanked = driven(scene((0, 3.2, 10), (15, 0.0, 10), (15, 6.4, 10), (-8, 3.2, 12)))[0]
    assert flanked.speed == pytest.approx(np.asarray(free.speed), abs=1e-5)


def test_a_box_across_its_lane_is_in_the_way():
    made = scene((0, 0, 10), (50, 3.2, 0), steps=161)
    long = replace(made.agents[1], length=10.0)
    motion, _, _ = driven(replace(moving(made, 1, yaw=np.pi / 2), agents=(made.agents[0], long)))
    assert motion.speed[-1] < 2.0


@pytest.mark.slow
def test_it_stops_at_a_red_light_and_goes_on_green():
    red, _, _world = driven(crossing())
    origin = 0.5 * (-60.0 + 20.0)
    nose = np.asarray(red.x) + origin + 2.3
    assert red.speed[-1] < 0.3
    assert -4.0 < nose[-1] < 0.3
    green, _, _ = driven(crossing(((0, "r"), (70, "G"))))
    assert green.speed[-1] > 2.0


@pytest.mark.slow
def test_it_takes_the_bend_and_slows_down_for_it():
    motion, controls, world = driven(crossing(((0, "G"),)))
    assert motion.yaw[-1] == pytest.approx(np.pi / 2, abs=0.1)
    lateral = np.asarray(controls.curvature) * np.asarray(motion.speed[:-1]) ** 2
    assert np.abs(lateral).max() < 4.5, "3 m/s^2 is aimed at, pure pursuit overshoots a little"
    path = shapely.LineString(np.stack([world.log.x[0], world.log.y[0]], axis=-1))
    assert shapely.distance(path, shapely.points(motion.x[:100], motion.y[:100])).max() < 0.5


def test_the_light_of_its_own_movement_counts():
    case = crossing()
    stop = {line.stop[0] for line in route_on(case, logged_way(case)).stop_lines(case.signals, case.tracks.steps)}
    assert stop == {True}, "the light for going straight on is green, that for turning left is red"


def test_the_route_goes_on_along_the_lanes():
    case = crossing(speed=4.0)  # the log ends before the light
    route = route_on(case, logged_way(case))
    assert len(route.points) > 100
    assert route.points[-1][0] > 60, "where the log does not turn, the straightest lane is taken"
    assert route.speed_limit[:30] == pytest.approx(15.0)


@pytest.mark.parametrize("left_m", [8.0, -8.0])
def test_a_place_beside_the_route_is_told_by_its_nearest_point(left_m):
    case = crossing()
    memory = IDM().init(CompiledScene(case, to_world(case)))
    along, across, _ = place_on_route(memory, memory.x - left_m * memory.sin, memory.y + left_m * memory.cos)
    assert along == pytest.approx(SPACING_M * np.arange(len(along)), abs=0.6)
    assert across == pytest.approx(left_m, abs=0.1)


def test_a_standing_ego_has_a_route():
    points = logged_way(scene((0, 0, 0.0), (50, 0, 10)))
    assert len(points) > 50
    assert np.isfinite(points).all()


def test_what_it_sees_does_not_depend_on_the_future():
    made = scene((0, 0, 12), (40, 0, 5), (70, 3.2, 8))
    world = to_world(made)
    planner, background = IDM(), roll_out_background(world, world.controls)
    memory = planner.init(CompiledScene(made, world))
    changed = type(background)(background.x.at[:, 50:].add(-30.0), background.y, background.yaw, background.speed)
    before, after = (drive(planner, memory, world, b)[0] for b in (background, changed))
    assert jnp.array_equal(before.x[:51], after.x[:51])
    assert not jnp.array_equal(before.x[51:], after.x[51:])
