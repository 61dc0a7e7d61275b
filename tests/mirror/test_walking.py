"""Pedestrians are point masses that face their direction and turn on the spot, with the interface of vehicles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.test_util import check_grads
from scenes import scene
from walkers import walked

from regents_cosim.mirror.bicycle import TURN_PACE_M_S, ControlArrays, Motion
from regents_cosim.mirror.dynamics import Mobility
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.rollout import roll_out_background
from regents_cosim.mirror.world import to_tracks, to_world
from regents_cosim.norms.limits import CURVATURE_LIMIT

STEPS, DT, AGENTS = 40, 0.1, 4
WALKS = np.array([True, False, True, True])

roll_out = jax.jit(lambda mobility, start, controls, moving: mobility.roll_out(start, controls, moving, DT))
step = jax.jit(lambda mobility, state, control: mobility.step(state, control, DT))
between = jax.jit(lambda mobility, motion: mobility.controls_between(motion, DT))


def mixed(walks=WALKS):
    return Mobility(jnp.full(len(walks), 0.3), jnp.asarray(walks))


def random_walk(seed, fastest=2.0):
    rng = np.random.default_rng(seed)
    ranges = ((-50, 50), (-50, 50), (-3, 3), (0.0, fastest))
    start = Motion(*(jnp.asarray(rng.uniform(low, high, AGENTS)) for low, high in ranges))
    accel = rng.uniform(-1.0, 1.0, (AGENTS, STEPS))
    return start, ControlArrays(jnp.asarray(accel), jnp.asarray(rng.uniform(-0.2, 0.2, (AGENTS, STEPS))))


def always():
    return jnp.ones((AGENTS, STEPS), bool)


def assert_close(a, b, tolerance):
    for name in ("x", "y", "yaw", "speed"):
        assert getattr(a, name) == pytest.approx(np.asarray(getattr(b, name)), abs=tolerance), name


@pytest.mark.slow
@settings(max_examples=20)
@given(st.integers(0, 10_000))
def test_the_closed_form_is_the_loop_and_its_inverse_recovers_the_controls(x64, seed):
    """Turning on the spot, which no vehicle can do, is recovered as well."""
    start, controls = random_walk(seed)
    motion, states = roll_out(mixed(), start, controls, always()), [start]
    for k in range(STEPS):
        states.append(step(mixed(), states[-1], jax.tree.map(lambda v, k=k: v[:, k], controls)))
    assert_close(motion, jax.tree.map(lambda *values: jnp.stack(values, axis=1), *states), 1e-9)
    found = between(mixed(), motion)
    assert found.curvature[WALKS] == pytest.approx(np.asarray(controls.curvature)[WALKS], abs=1e-9)
    assert_close(roll_out(mixed(), start, found, always()), motion, 1e-3)


def test_a_walker_turns_on_the_spot_and_wheels_do_not():
    start = Motion(*(jnp.zeros(2) for _ in range(4)))
    turning = ControlArrays(jnp.zeros((2, STEPS)), jnp.full((2, STEPS), CURVATURE_LIMIT))
    motion = roll_out(mixed(np.array([True, False])), start, turning, jnp.ones((2, STEPS), bool))
    assert motion.yaw[:, -1] == pytest.approx([CURVATURE_LIMIT * TURN_PACE_M_S * STEPS * DT, 0.0], abs=1e-4)
    assert np.abs(motion.x).max() == 0.0


def test_a_walker_that_enters_late_does_not_turn_before():
    start, controls = random_walk(2)
    moving = jnp.arange(STEPS) >= jnp.array([[0], [0], [20], [39]])
    motion = roll_out(mixed(), start, controls, moving)
    for agent, first in enumerate((0, 0, 20, 39)):
        assert motion.yaw[agent, : first + 1] == pytest.approx(np.full(first + 1, start.yaw[agent]))


@pytest.mark.parametrize("braking", [0.0, 1.0])
def test_gradients_of_mixed_traffic_are_those_of_finite_differences(x64, braking):
    start, controls = random_walk(5)
    controls = ControlArrays(controls.accel - braking * jnp.sin(jnp.arange(STEPS) / 10), controls.curvature)
    weights = jnp.asarray(np.random.default_rng(0).normal(size=(4, AGENTS, STEPS + 1)))

    @jax.jit
    def score(start, controls):
        motion = mixed().roll_out(*jax.tree.map(jnp.asarray, (start, controls)), always(), DT)
        return sum((w * v).sum() for w, v in zip(weights, jax.tree.leaves(motion), strict=True))

    check_grads(score, (start, controls), order=1, modes=["rev"], eps=1e-6, rtol=1e-5)


def test_who_does_not_walk_moves_as_before():
    start, controls = random_walk(7, fastest=12.0)
    alone = roll_out(Mobility(jnp.full(AGENTS, 0.3)), start, controls, always())
    among = roll_out(mixed(), start, controls, always())
    for name in ("x", "y", "yaw", "speed"):
        assert getattr(among, name)[1] == pytest.approx(np.asarray(getattr(alone, name)[1]), abs=1e-5)


def test_a_logged_pedestrian_that_turns_back_is_followed():
    """It walks on, stands, turns round and walks back, which the bicycle model cannot do."""
    made = scene((0, 0, 10), (30, -3, 1))
    time = made.dt * np.arange(made.tracks.steps)
    along = 1.4 * np.minimum(np.minimum(time, 2.5), 8.0 - time)
    made = walked(made, 1, 30.0 + np.convolve(np.pad(along, 4, "edge"), np.full(9, 1 / 9), "valid"), 0 * time - 3.0)
    world = to_world(made)
    motion = _undisturbed(world)
    assert np.hypot(motion.x - world.log.x, motion.y - world.log.y)[1].max() < 0.2
    tracks = to_tracks(motion, world.controls, made)
    moved = 0.5 * (tracks.speed[1, 1:] + tracks.speed[1, :-1]) * made.dt
    turned = np.diff(tracks.yaw[1])
    assert tracks.curvature[1][moved > 1e-2] * moved[moved > 1e-2] == pytest.approx(turned[moved > 1e-2], abs=1e-3)


def test_traffic_without_pedestrians_has_no_walkers():
    assert to_world(scene((0, 0, 10), (30, 0, 10))).walks is None


_undisturbed = compiled(lambda world: roll_out_background(world, world.controls))
