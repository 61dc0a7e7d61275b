from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scenes import TIME, platoon, scene, straight_road

from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.mirror import rollout
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.reacting_traffic import among_reacting
from regents_cosim.mirror.reactions.react import react
from regents_cosim.mirror.reactions.state import BackgroundInstant, begin
from regents_cosim.mirror.rollout import roll_out_background, with_ego
from regents_cosim.mirror.world import to_world
from regents_cosim.norms.careful import CAREFUL
from regents_cosim.norms.limits import ACCEL_LIMIT
from regents_cosim.planners.blind import ConstantVelocity, LogReplay
from regents_cosim.planners.jax_planner import CompiledScene, JaxPlanner

# Once for all scenes of a shape.
drive, drive_among_reacting = eqx.filter_jit(rollout.drive), eqx.filter_jit(rollout.drive_among_reacting)
react = eqx.filter_jit(react)


class Brakes(JaxPlanner):
    """A planner that stops at once, while its log does not."""

    def step(self, memory, sight, ego):
        return ControlArrays(jnp.float32(-6.0), jnp.float32(0.0)), memory


def driven(scenario, planner, reacting=True):
    world = to_world(scenario)
    background = roll_out_background(world, world.controls)
    memory = planner.init(CompiledScene(scenario, world))
    if not reacting:
        return world, with_ego(background, drive(planner, memory, world, background)[0])
    who = jnp.arange(world.valid.shape[0]) > 0
    return world, drive_among_reacting(planner, memory, world, background, who)[0]


@pytest.mark.parametrize("seed", range(3))
def test_traffic_that_nobody_disturbs_stays_as_it_was_recorded(seed):
    made = platoon(seed=seed)
    world, motion = driven(made, LogReplay())
    logged = roll_out_background(world, world.controls)
    assert np.abs(motion.x - logged.x)[np.asarray(world.valid)].max() < 0.02
    assert np.abs(motion.y - logged.y)[np.asarray(world.valid)].max() < 0.02


def test_a_follower_brakes_for_an_ego_that_stops():
    made = scene((0, 0, 10), (-15, 0, 10), (-30, 0, 10))
    _, blind = driven(made, Brakes(), reacting=False)
    _, motion = driven(made, Brakes())
    assert (blind.x[0] - blind.x[1]).min() < 0, "who replays its log drives through the ego"
    for ahead, behind in ((0, 1), (1, 2)):
        assert (motion.x[ahead] - motion.x[behind]).min() > 4.6 + 0.3
    assert motion.speed[1, -1] < 0.1


def test_a_follower_brakes_for_another_road_user_that_an_attack_slows_down():
    made = scene((0, 6.4, 10), (0, 0, 10), (-15, 0, 10))
    world = to_world(made)
    braking = ControlArrays(world.controls.accel.at[1].set(-4.0), world.controls.curvature)
    background = roll_out_background(world, braking)
    who = jnp.arange(world.valid.shape[0]) == 2
    memory = ConstantVelocity().init(CompiledScene(made, world))
    motion = drive_among_reacting(ConstantVelocity(), memory, world, background, who)[0]
    assert (background.x[1] - background.x[2]).min() < 0, "who replays its log drives through it"
    assert (motion.x[1] - motion.x[2]).min() > 4.6 + 0.3


def test_it_brakes_no_harder_than_the_limits_and_never_reverses():
    _, motion = driven(scene((0, 0, 10), (-15, 0, 10)), Brakes())
    accel = np.diff(np.asarray(motion.speed[1])) / 0.1
    assert accel.min() > -ACCEL_LIMIT - 0.01
    assert np.diff(np.asarray(motion.x[1])).min() > -1e-4


def test_other_lanes_are_not_held_up():
    made = scene((0, 0, 10), (-15, 3.2, 10))
    _, motion = driven(made, Brakes())
    assert motion.x[1, -1] - motion.x[1, 0] == pytest.approx(80, abs=0.1)


def test_it_goes_on_when_the_way_is_free_again():
    made = scene((40, 0, 10), (0, 0, 10))
    creeps = np.where(TIME < 2.0, 20.0 + 2.0 * TIME, 200.0)
    moved = among_an_ego(made, creeps, 0.0, 0.0, np.where(TIME < 2.0, 2.0, 10.0))
    assert moved.speed[1].min() < 7.0
    assert moved.speed[1, -1] == pytest.approx(10.0, abs=0.1)
    assert moved.x[1, -1] < 80.0 - 5.0


def test_the_ego_drives_as_among_traffic_that_does_not_react_when_nobody_has_to():
    made = scene((0, 0, 10), (25, 3.2, 10), (60, 6.4, 9))
    _, blind = driven(made, ConstantVelocity(), reacting=False)
    _, motion = driven(made, ConstantVelocity())
    assert motion.x[0] == pytest.approx(np.asarray(blind.x[0]), abs=1e-4)


@pytest.mark.parametrize("count", [1, 4, 5, 12])
def test_of_however_many_in_the_way_the_tightest_alone_holds_one_up(count):
    """The agents in the way are compared a few at a time."""

    def next_speed(ahead_m):
        made = scene((0, 0, 10), *((x, 6.4, 0) for x in ahead_m))
        world = to_world(made)
        now = jax.tree.map(lambda values: values[:, 0], world.log)
        now = eqx.tree_at(lambda motion: motion.y, now, now.y.at[1:].set(0.0))
        instant = BackgroundInstant(jnp.int32(0), now, jax.tree.map(lambda v: v[:, 0], world.log), world.valid[:, 0],
                                    world.moving[:, 0])  # fmt: skip
        return react(begin(world.log), now, world.log, instant, world).speed[0]

    gaps = np.random.default_rng(count).permutation(np.linspace(9.0, 40.0, count))
    assert float(next_speed(gaps)) == float(next_speed([9.0])) < 9.5


def among_an_ego(made, x, y, yaw, speed):
    """The tracks of the others when the ego drives as given [time], or stands as given."""
    ego = tuple(np.broadcast_to(np.asarray(values, float), TIME.shape) for values in (x, y, yaw, speed))
    return among_reacting(made, ego, np.arange(len(made.agents)) > 0)


def overlaps(made, moved, x, y, yaw):
    ego = Boxes(*(np.broadcast_to(values, TIME.shape) for values in (x, y, yaw, 4.6, 1.8)))
    return overlap(ego, Boxes(moved.x[1], moved.y[1], moved.yaw[1], 4.6, 1.8)).any()


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("arrives_s", [3.4, 3.7, 4.0])
def test_it_lets_pass_one_that_crosses_ahead_of_it(side, arrives_s):
    made = scene((300, 6.4, 10), (0, 0, 10))
    y, yaw = side * 10.0 * (TIME - arrives_s), side * np.pi / 2
    moved = among_an_ego(made, 40.0, y, yaw, 10.0)
    assert not overlaps(made, moved, 40.0, y, yaw)
    assert moved.speed[1].min() < 8.0, "it brakes"
    assert moved.speed[1, -1] > 6.0, "and goes on"
    assert moved.y[1] == pytest.approx(0.0, abs=0.05), "on its path"


def test_it_does_not_wait_for_one_that_comes_after_it():
    made = scene((300, 6.4, 10), (0, 0, 10))
    moved = among_an_ego(made, 40.0, 10.0 * (TIME - 5.5), np.pi / 2, 10.0)
    assert moved.x[1] == pytest.approx(10.0 * TIME, abs=0.05)


@pytest.mark.parametrize("ahead_rad", [-0.3, 0.0, 0.3, 0.6])
def test_it_does_not_wait_for_one_in_the_other_lane_of_a_bend(ahead_rad):
    """Both keep to their lanes, although the way of either leads straight into the other's."""
    angle = 10.0 / 20.0 * TIME
    made = scene((300, 6.4, 10), (0, 0, 10))
    outer = angle + ahead_rad
    tracks = replace(
        made.tracks,
        x=np.stack([23.5 * np.sin(outer), 20.0 * np.sin(angle)]),
        y=np.stack([20.0 - 23.5 * np.cos(outer), 20.0 - 20.0 * np.cos(angle)]),
        yaw=np.stack([outer, angle]),
        speed=np.stack([np.full(81, 11.75), np.full(81, 10.0)]),
    )
    late = 0.05  # [rad] behind its log, so that it counts as disturbed
    outer = outer - late
    moved = among_an_ego(replace(made, tracks=tracks), 23.5 * np.sin(outer), 20.0 - 23.5 * np.cos(outer), outer, 11.75)
    assert np.hypot(moved.x[1] - tracks.x[1], moved.y[1] - tracks.y[1]).max() < 0.1


def test_it_changes_lanes_around_one_that_stands():
    made = scene((300, 6.4, 10), (0, 0, 10), steps=81)
    moved = among_an_ego(made, 50.0, 0.0, 0.0, 2.0 * np.ones(81))
    assert not overlaps(made, moved, 50.0, 0.0, 0.0)
    assert moved.y[1].max() > 1.0
    assert moved.y[1].max() < 3.4, "on the lane beside"


def test_it_changes_no_lane_where_another_drives():
    beside = [(x, 3.2, 10) for x in range(-40, 120, 9)]
    made = scene((300, 6.4, 10), (0, 0, 10), *beside)
    moved = among_an_ego(made, 50.0, 0.0, 0.0, 0.0)
    assert not overlaps(made, moved, 50.0, 0.0, 0.0)
    assert np.abs(moved.y[1]).max() < 0.6


def test_it_changes_no_lane_where_there_is_none():
    made = scene((300, 0, 10), (0, 0, 10), road=straight_road(lanes=1))
    moved = among_an_ego(made, 50.0, 0.0, 0.0, 0.0)
    assert not overlaps(made, moved, 50.0, 0.0, 0.0)
    assert np.abs(moved.y[1]).max() < 0.5, "its body stays on its lane"


def test_it_swerves_where_braking_is_too_late_and_not_before_a_driver_can_act():
    made = scene((300, 6.4, 10), (0, 0, 25))
    ego = 50.0 + np.zeros(81), 1.6 + np.zeros(81), 0.0, 0.0
    moved = among_an_ego(made, *ego)
    assert not overlaps(made, moved, *ego[:3])
    aside = np.abs(moved.y[1]) > 0.01
    assert aside.any()
    brakes = np.flatnonzero(moved.speed[1] < 24.9)[0]
    assert np.flatnonzero(aside)[0] - brakes >= round(CAREFUL.delay_s / 0.1) - 2
    assert moved.y[1].min() > -0.9, "on its lanes"


@pytest.mark.parametrize("seed", range(3))
def test_what_each_does_is_a_motion_of_a_vehicle(seed):
    """Headings follow the way, and nothing jumps."""
    made = platoon(seed=seed)
    moved = among_an_ego(made, made.tracks.x[0] - 2.0 * TIME, made.tracks.y[0] + 1.5, 0.0, 8.0)
    way = np.stack([np.diff(moved.x, axis=1), np.diff(moved.y, axis=1)])[:, 1:]
    driven = np.hypot(*way)
    assert np.abs(np.diff(driven / 0.1, axis=1)).max() < 0.1 * 8.0
    turned = np.abs(np.arctan2(way[1], way[0]) - moved.yaw[1:, 1:])[driven > 0.2]
    assert turned.max() < 0.06
