import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.test_util import check_grads
from params import slow

from regents_cosim.mirror import bicycle
from regents_cosim.mirror.bicycle import ControlArrays, Motion, clip, wrap
from regents_cosim.norms.limits import ACCEL_LIMIT, CURVATURE_LIMIT

# Compiled as a whole: op by op, every shape and precision would compile each of them alone.
controls_between, roll_out, step = map(jax.jit, (bicycle.controls_between, bicycle.roll_out, bicycle.step))
STEPS = 80


def random_start(agents, seed, slowest=0.0):
    rng = np.random.default_rng(seed)
    ranges = ((-50, 50), (-50, 50), (-3, 3), (slowest, 15))
    return Motion(*(jnp.asarray(rng.uniform(low, high, agents)) for low, high in ranges))


def random_controls(agents, seed, accel=2.0):
    rng = np.random.default_rng(seed + 1)
    return ControlArrays(
        jnp.asarray(rng.uniform(-accel, accel, (agents, STEPS))), jnp.asarray(rng.uniform(-0.1, 0.1, (agents, STEPS)))
    )


def always(agents):
    return jnp.ones((agents, STEPS), bool)


def step_by_step(start, controls, dt):
    states = [start]
    for k in range(STEPS):
        states.append(step(states[-1], jax.tree.map(lambda v, k=k: v[:, k], controls), dt))
    return jax.tree.map(lambda *values: jnp.stack(values, axis=1), *states)


def assert_close(a, b, tolerance):
    for name in ("x", "y", "yaw", "speed"):
        assert getattr(a, name) == pytest.approx(np.asarray(getattr(b, name)), abs=tolerance), name


@settings(max_examples=25)
@given(st.integers(0, 10_000), st.floats(0.5, 6.0))
def test_the_closed_form_is_the_loop(x64, seed, accel):
    start, controls = random_start(5, seed), random_controls(5, seed, accel)
    assert_close(roll_out(start, controls, always(5), 0.1), step_by_step(start, controls, 0.1), 1e-9)


@pytest.mark.slow
def test_in_single_precision_the_closed_form_stays_within_a_tenth_of_a_millimetre():
    start, controls = random_start(32, 0), random_controls(32, 0)
    assert start.x.dtype == jnp.float32
    assert_close(roll_out(start, controls, always(32), 0.1), step_by_step(start, controls, 0.1), 1e-4)


@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_the_inverse_recovers_the_motion(x64, seed):
    start, controls = random_start(5, seed), random_controls(5, seed)
    motion = roll_out(start, controls, always(5), 0.1)
    assert_close(roll_out(start, controls_between(motion, 0.1), always(5), 0.1), motion, 1e-3)


def test_the_inverse_recovers_the_controls_of_a_moving_vehicle(x64):
    start, controls = random_start(5, 3, slowest=10.0), random_controls(5, 3, accel=0.5)
    found = controls_between(roll_out(start, controls, always(5), 0.1), 0.1)
    assert found.accel == pytest.approx(np.asarray(controls.accel), abs=1e-9)
    assert found.curvature == pytest.approx(np.asarray(controls.curvature), abs=1e-9)


def test_a_braking_vehicle_stops_and_stays():
    start = Motion(*(jnp.array([value]) for value in (0.0, 0.0, 0.0, 3.0)))
    motion = roll_out(start, ControlArrays(jnp.full((1, STEPS), -2.0), jnp.full((1, STEPS), 0.3)), always(1), 0.1)
    assert motion.speed.min() == 0
    assert motion.speed[0, 15] == pytest.approx(0, abs=1e-5)
    # it turns while it rolls, so the way is along an arc of 3^2 / (2 * 2) = 2.25 m
    assert motion.yaw[0, -1] == pytest.approx(0.3 * 2.25, abs=1e-4)
    assert motion.x[0, 16:] == pytest.approx(np.full(65, motion.x[0, 16]))


def test_a_circle_closes():
    radius, speed = 20.0, 2 * np.pi * 20.0 / (STEPS * 0.1)
    start = Motion(*(jnp.array([value]) for value in (0.0, 0.0, 0.0, speed)))
    motion = roll_out(start, ControlArrays(jnp.zeros((1, STEPS)), jnp.full((1, STEPS), 1 / radius)), always(1), 0.1)
    assert (motion.x[0, -1], motion.y[0, -1]) == pytest.approx((0, 0), abs=1e-3)
    assert motion.yaw[0, -1] == pytest.approx(2 * np.pi, abs=1e-4)


def test_an_agent_that_enters_late_waits_at_its_start():
    start, controls = random_start(3, 1), random_controls(3, 1)
    moving = jnp.arange(STEPS) >= jnp.array([[0], [30], [79]])
    motion = roll_out(start, controls, moving, 0.1)
    for agent, first in enumerate((0, 30, 79)):
        assert motion.x[agent, : first + 1] == pytest.approx(np.full(first + 1, start.x[agent]))
        assert motion.speed[agent, first] == pytest.approx(float(start.speed[agent]))


@pytest.mark.parametrize("braking", [slow(0.0), 3.0])
def test_gradients_are_those_of_finite_differences(x64, braking):
    start, controls = random_start(3, 5), random_controls(3, 5)
    controls = ControlArrays(controls.accel - braking * jnp.sin(jnp.arange(STEPS) / 10), controls.curvature)
    weights = jnp.asarray(np.random.default_rng(0).normal(size=(4, 3, STEPS + 1)))

    @jax.jit
    def score(start, controls):
        motion = roll_out(*jax.tree.map(jnp.asarray, (start, controls)), always(3), 0.1)
        return sum((w * v).sum() for w, v in zip(weights, jax.tree.leaves(motion), strict=True))

    stopped = (roll_out(start, controls, always(3), 0.1).speed == 0).any()
    assert stopped == (braking > 0), "the two cases are to be with and without stops"
    check_grads(score, (start, controls), order=1, modes=["rev"], eps=1e-6, rtol=1e-5)


def test_a_standing_vehicle_can_be_set_in_motion():
    start = Motion(*(jnp.array([0.0]) for _ in range(4)))

    def way(accel):
        return roll_out(start, ControlArrays(accel, jnp.zeros((1, STEPS))), always(1), 0.1).x[0, -1]

    gradient = jax.jit(jax.grad(way))(jnp.zeros((1, STEPS)))
    assert jnp.isfinite(gradient).all()
    assert (gradient > 0).all()


def test_controls_before_an_agent_enters_do_not_cut_the_gradient():
    moving, brakes = (jnp.arange(STEPS) >= 40)[None], jnp.where(jnp.arange(STEPS) < 40, -50.0, 1.0)[None]

    def way(speed):
        start = Motion(*(jnp.zeros(1) for _ in range(3)), speed[None])
        return roll_out(start, ControlArrays(brakes, 0.0 * brakes), moving, 0.1).x[0, -1]

    assert float(jax.jit(jax.grad(way))(jnp.float32(3.0))) == pytest.approx(4.0, rel=1e-4)


def test_a_step_from_a_standstill_has_the_gradient_of_accelerating():
    start, still = Motion(*(jnp.zeros(()) for _ in range(4))), jnp.zeros(())
    gained = jax.jit(jax.grad(lambda accel: step(start, ControlArrays(accel, still), 0.1).speed))
    assert [float(gained(jnp.float32(accel))) for accel in (-1.0, 0.0, 1.0)] == pytest.approx([0.0, 0.1, 0.1])


def test_what_came_before_a_stop_does_not_matter_after_it():
    start = Motion(*(jnp.array([value]) for value in (0.0, 0.0, 0.0, 1.0)))
    accel = jnp.where(jnp.arange(STEPS) < 40, -2.0, 1.0)[None]

    def last_speed(accel):
        return roll_out(start, ControlArrays(accel, jnp.zeros((1, STEPS))), always(1), 0.1).speed[0, -1]

    gradient = np.asarray(jax.jit(jax.grad(last_speed))(accel))[0]
    assert gradient[:40] == pytest.approx(0)
    assert gradient[40:] == pytest.approx(0.1)


def test_clip_keeps_controls_within_the_limits():
    clipped = clip(ControlArrays(jnp.array([-99.0, 99.0]), jnp.array([-9.0, 0.1])))
    assert clipped.accel.tolist() == pytest.approx([-ACCEL_LIMIT, ACCEL_LIMIT])
    assert clipped.curvature.tolist() == pytest.approx([-CURVATURE_LIMIT, 0.1])


@given(st.floats(-50, 50))
def test_wrap(angle):
    assert -np.pi <= wrap(jnp.float32(angle)) <= np.pi
    assert np.exp(1j * float(wrap(jnp.float32(angle)))) == pytest.approx(np.exp(1j * angle), abs=1e-4)
