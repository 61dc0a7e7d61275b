"""Agents that are not asked where to drive are those that would keep their aim."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.logged_way import LoggedWay
from regents_cosim.mirror.reactions.bodies import bodies
from regents_cosim.mirror.reactions.moving_aside import _aims, _has_a_choice, move_aside
from regents_cosim.mirror.reactions.state import Reacting
from regents_cosim.norms.careful import CAREFUL

AGENTS, STEPS, DT = 8, 41, jnp.float32(0.1)
move_aside, aims, has_a_choice = (eqx.filter_jit(one) for one in (move_aside, _aims, _has_a_choice))


def traffic(seed):
    """Agents close behind each other on a straight road, some held up, some beside their path, some beside lanes."""
    rng = np.random.default_rng(seed)

    def numbers(least, most):
        return jnp.asarray(rng.uniform(least, most, AGENTS), jnp.float32)

    def some(*values):
        return jnp.asarray(rng.choice(values, AGENTS), jnp.float32)

    def lanes():
        return jnp.asarray(np.repeat(rng.choice([0.0, 3.2], (AGENTS, 1)), STEPS, axis=1), jnp.float32)

    speed, aim = numbers(0.0, 15.0), some(0.0, 0.0, 3.2, -3.2)
    state = Reacting(
        step=numbers(0.0, STEPS - 1.0), speed=speed, left=aim, drift=some(0.0), aim=aim,
        pressure=some(0.0, 2.0), needed=numbers(0.0, 12.0), held_up=numbers(0.0, 2.0 * CAREFUL.delay_s), yaw=some(0.0),
    )  # fmt: skip
    size = jnp.full(AGENTS, 2.3), jnp.full(AGENTS, 0.9)
    now = Motion(jnp.asarray(np.cumsum(rng.uniform(5.0, 20.0, AGENTS)), jnp.float32), aim, some(0.0), speed)
    room = LoggedWay(jnp.zeros((AGENTS, STEPS)), lanes(), lanes(), 1.5 + lanes(), 1.5 + lanes())
    return state, bodies(now, *size, None), room


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_who_has_no_choice_keeps_the_aim(seed):
    state, mine, room = traffic(seed)
    bend, wanted = jnp.zeros(AGENTS), jnp.full(AGENTS, 15.0)
    every = aims(jnp.arange(AGENTS), state, mine, mine, bend, wanted, room, DT)
    asked = np.asarray(has_a_choice(state, room, DT))
    np.testing.assert_array_equal(np.asarray(every)[~asked], np.asarray(state.aim)[~asked])
    later = move_aside(state, mine, mine, bend, wanted, jnp.asarray(True), room, DT)
    np.testing.assert_array_equal(later.aim, np.where(asked, every, state.aim))


def test_the_traffic_has_agents_of_both_kinds_and_new_aims():
    drawn = [traffic(seed) for seed in range(20)]
    asked = np.concatenate([has_a_choice(state, room, DT) for state, _, room in drawn])
    assert 0 < asked.sum() < len(asked)
    bend, wanted = jnp.zeros(AGENTS), jnp.full(AGENTS, 15.0)
    new = [aims(jnp.arange(AGENTS), state, mine, mine, bend, wanted, room, DT) for state, mine, room in drawn]
    assert any((np.asarray(aim) != state.aim).any() for aim, (state, *_) in zip(new, drawn, strict=True))
