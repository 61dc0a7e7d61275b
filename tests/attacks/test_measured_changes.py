"""The smooth measures of the nearest approach of two agents, for drives with known answers."""

import jax.numpy as jnp
import pytest
from jax.test_util import check_grads

from regents_cosim.attacks.sampling.candidate_search import nearest_approach
from regents_cosim.mirror.bicycle import Motion

EGO_SPEED, OTHER_SPEED = 10.0, 6.0
DT, STEPS = 0.1, 61


def drive(x, y, yaw, speed):
    """Straight on at a constant speed."""
    far = speed * DT * jnp.arange(STEPS)
    return Motion(x + far * jnp.cos(yaw), y + far * jnp.sin(yaw), jnp.full(STEPS, yaw), jnp.full(STEPS, speed))


def approach(y, speed):
    """The approach of an agent that crosses 30 m ahead, where the ego arrives after 3 s."""
    other = drive(30.0, y, 0.5 * jnp.pi, speed)
    return nearest_approach(drive(0.0, 0.0, 0.0, EGO_SPEED), other, jnp.ones(STEPS, bool), jnp.asarray(DT))


def test_crossing_drives_meet_when_and_as_fast_as_they_do():
    speed, when = approach(-3.0 * OTHER_SPEED, OTHER_SPEED)
    assert float(speed) == pytest.approx((EGO_SPEED**2 + OTHER_SPEED**2) ** 0.5, abs=1e-3)
    assert float(when) == pytest.approx(3.0, abs=0.05)


def test_moments_at_which_one_is_not_there_do_not_count():
    ego, other = drive(0.0, 0.0, 0.0, EGO_SPEED), drive(30.0, -18.0, 0.5 * jnp.pi, OTHER_SPEED)
    _, when = nearest_approach(ego, other, jnp.arange(STEPS) < 20, jnp.asarray(DT))
    assert 1.5 < float(when) < 2.0


@pytest.mark.slow
def test_the_gradient_is_that_of_finite_differences(x64):
    check_grads(approach, (jnp.asarray(-16.0), jnp.asarray(5.0)), order=1, modes=["rev"], eps=1e-5, rtol=1e-5)
