import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scenes import moved, platoon, scene

from regents_cosim.mirror.actions import fill_gaps, fit_controls
from regents_cosim.mirror.bicycle import ControlArrays, Motion, controls_between, roll_out
from regents_cosim.mirror.dynamics import Mobility
from regents_cosim.norms.limits import ACCEL_LIMIT, CURVATURE_LIMIT

STEPS, DT = 80, jnp.float32(0.1)


def wavy(agents=12, seed=0):
    """Smooth random motion in which some agents stop on the way."""
    rng = np.random.default_rng(seed)
    time = np.arange(STEPS) * 0.1
    phase, rate = rng.uniform(0, 6, (agents, 1)), rng.uniform(0.3, 1.2, (agents, 1))
    controls = ControlArrays(
        jnp.asarray(1.5 * np.sin(rate * time + phase) - 0.5, jnp.float32),
        jnp.asarray(0.08 * np.cos(rate * time + phase), jnp.float32),
    )
    ranges = ((-80, 80), (-80, 80), (-3, 3), (0, 14))
    start = Motion(*(jnp.asarray(rng.uniform(low, high, agents), jnp.float32) for low, high in ranges))
    return start, controls


def fit(log, start, valid=None, moving=None):
    agents = len(start.x)
    valid = jnp.ones((agents, STEPS + 1), bool) if valid is None else valid
    moving = jnp.ones((agents, STEPS), bool) if moving is None else moving
    controls = fit_controls(log, valid, start, moving, DT, Mobility(jnp.full(len(valid), 2.5)))
    return controls, roll_out(start, controls, moving, DT)


def miss(a, b):
    return np.hypot(np.asarray(a.x - b.x), np.asarray(a.y - b.y))


@pytest.mark.slow
def test_motions_of_the_model_are_fitted_to_a_centimetre():
    start, controls = wavy()
    log = roll_out(start, controls, jnp.ones((12, STEPS), bool), DT)
    assert (np.asarray(log.speed) == 0).any(), "nobody stopped: the hard case is missing"
    assert miss(fit(log, start)[1], log).max() < 1e-2


@pytest.mark.slow
def test_a_noisy_log_is_smoothed_not_followed():
    start, controls = wavy()
    true = roll_out(start, controls, jnp.ones((12, STEPS), bool), DT)
    rng = np.random.default_rng(1)
    noisy = Motion(
        *(
            v + rng.normal(0, s, v.shape).astype(np.float32)
            for v, s in zip(jax.tree.leaves(true), (0.05, 0.05, 0.02, 0.1), strict=True)
        )
    )
    noisy = Motion(noisy.x, noisy.y, noisy.yaw, jnp.maximum(noisy.speed, 0))
    _, fitted = fit(noisy, start)
    local = roll_out(start, controls_between(noisy, DT), jnp.ones((12, STEPS), bool), DT)
    assert miss(fitted, true).mean() < 0.05
    assert miss(fitted, true).mean() < 0.2 * miss(local, true).mean()


def test_controls_stay_within_the_limits():
    start, controls = wavy()
    log = roll_out(start, controls, jnp.ones((12, STEPS), bool), DT)
    jumpy = Motion(log.x.at[:, 40:].add(6.0), log.y.at[:, 60:].add(-3.2), log.yaw, log.speed)
    fitted, motion = fit(jumpy, start)
    assert np.abs(fitted.accel).max() <= ACCEL_LIMIT
    assert np.abs(fitted.curvature).max() <= CURVATURE_LIMIT
    assert np.isfinite(motion.x).all()


@pytest.mark.slow
def test_steps_that_are_not_valid_do_not_pull():
    start, controls = wavy(4)
    log = roll_out(start, controls, jnp.ones((4, STEPS), bool), DT)
    valid = jnp.ones((4, STEPS + 1), bool).at[:, 30:40].set(False)
    absurd = Motion(jnp.where(valid, log.x, 1e4), log.y, log.yaw, log.speed)
    assert (miss(fit(absurd, start, valid)[1], log)[np.asarray(valid)]).max() < 0.05


@pytest.mark.slow
def test_a_standing_agent_stands():
    start = Motion(*(jnp.zeros(2) for _ in range(4)))
    log = jax.tree.map(lambda v: jnp.broadcast_to(v[:, None], (2, STEPS + 1)), start)
    fitted, motion = fit(log, start)
    assert np.abs(motion.x).max() < 1e-3
    assert np.isfinite(fitted.accel).all()


def test_gaps_are_filled_with_the_nearest_valid_state():
    made = scene((0.0, 0.0, 10.0), (20.0, 0.0, 10.0), steps=10)
    filled = fill_gaps(moved(made, 1, valid=[0, 0, 1, 1, 0, 0, 0, 0, 1, 0]))
    kept = [2, 2, 2, 3, 3, 3, 8, 8, 8, 8]
    assert filled.x[1] == pytest.approx(made.tracks.x[1, kept])
    assert filled.x[0] == pytest.approx(made.tracks.x[0])


def test_the_same_log_gives_the_same_bits():
    from regents_cosim.mirror.world import to_world

    first, second = (to_world(platoon()).controls for _ in range(2))
    assert np.array_equal(first.accel, second.accel)
    assert np.array_equal(first.curvature, second.curvature)
