import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scenes import platoon, scene

from regents_cosim.mirror import reactions, rollout
from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.reactions import begin, place
from regents_cosim.mirror.rollout import roll_out_background, with_ego
from regents_cosim.mirror.world import to_world
from regents_cosim.planners.constant_velocity import ConstantVelocity
from regents_cosim.planners.jax_planner import CompiledScene, JaxPlanner
from regents_cosim.planners.log_replay import LogReplay

# Once for all scenes of a shape.
drive, drive_among_reacting = eqx.filter_jit(rollout.drive), eqx.filter_jit(rollout.drive_among_reacting)
react = eqx.filter_jit(reactions.react)


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
    assert accel.min() > -6.01
    assert np.diff(np.asarray(motion.x[1])).min() > -1e-4


def test_other_lanes_are_not_held_up():
    made = scene((0, 0, 10), (-15, 3.2, 10))
    _, motion = driven(made, Brakes())
    assert motion.x[1, -1] - motion.x[1, 0] == pytest.approx(80, abs=0.1)


@pytest.mark.slow
def test_it_goes_on_when_the_way_is_free_again():
    log = jax.tree.map(lambda v: v, to_world(scene((0, 0, 10), (-12, 0, 10))).log)
    progress, speeds = begin(log), []
    for step in range(80):
        present = jnp.arange(log.x.shape[0]) < 2
        log_now = jax.tree.map(lambda v, step=step: v[:, step], log)
        now = place(log, progress)
        held_up = 8.0 if step < 30 else 60.0  # the one in front creeps, then is gone
        now = type(now)(now.x.at[0].set(now.x[1] + held_up), now.y, now.yaw, now.speed.at[0].set(0.0))
        half = (jnp.full_like(now.x, 2.3), jnp.full_like(now.x, 0.9))
        progress = react(progress, now, log, jnp.zeros((len(now.x), 80)), log_now, present, *half, jnp.float32(0.1))
        speeds.append(float(progress.speed[1]))
    assert min(speeds[:30]) < 7.0
    assert speeds[-1] == pytest.approx(10.0, abs=0.1)
    assert progress.step[1] < 79


def test_the_ego_drives_as_among_traffic_that_does_not_react_when_nobody_has_to():
    made = scene((0, 0, 10), (25, 3.2, 10), (60, 6.4, 9))
    _, blind = driven(made, ConstantVelocity(), reacting=False)
    _, motion = driven(made, ConstantVelocity())
    assert motion.x[0] == pytest.approx(np.asarray(blind.x[0]), abs=1e-4)


@pytest.mark.parametrize("count", [1, 4, 5, 12])
def test_of_however_many_in_the_way_the_tightest_alone_holds_one_up(count):
    """The agents in the way are compared a few at a time."""

    def next_speed(ahead_m):
        x = jnp.concatenate([jnp.zeros(1), jnp.asarray(ahead_m, jnp.float32), jnp.full(15 - len(ahead_m), -1e3)])
        now = Motion(x, jnp.zeros(16), jnp.zeros(16), jnp.zeros(16).at[0].set(10.0))
        log_now = Motion(now.x, now.y.at[1:].set(5.0), now.yaw, now.speed)
        log = jax.tree.map(lambda values: jnp.repeat(values[:, None], 81, axis=1), log_now)
        present = jnp.arange(16) <= len(ahead_m)
        half = (jnp.full(16, 2.3), jnp.full(16, 0.9))
        return react(begin(log), now, log, jnp.zeros((16, 80)), log_now, present, *half, jnp.float32(0.1)).speed[0]

    gaps = np.random.default_rng(count).permutation(np.linspace(9.0, 40.0, count))
    assert float(next_speed(gaps)) == float(next_speed([9.0])) < 9.5
