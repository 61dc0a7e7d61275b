"""The time at which a careful driver acts: the rule over whole tracks agrees with the step-by-step one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.false_alarms import careful_brakes
from regents_cosim.norms.careful import careful_perceives, careful_reaction_steps
from regents_cosim.planners.careful.driver import Reaction

STEPS = 60


@jax.jit
def on_device(risk, dt):
    """At every step, the first step of the danger that is believed then, and the planner's braking."""

    def advance(state, danger):
        state = state.next(danger[None], dt)
        return state, state.braking

    seen = jax.vmap(lambda at: careful_perceives(jnp, risk, dt, at))(jnp.arange(STEPS))
    return seen, jax.lax.scan(advance, Reaction.none(1), risk)[1]


@pytest.mark.slow
@given(
    runs=st.lists(st.tuples(st.integers(0, 8), st.integers(1, 12)), min_size=1, max_size=6),
    dt=st.sampled_from([0.05, 0.1, 0.2, 0.25]),
)
def test_the_planner_begins_to_brake_when_the_verdict_says(runs, dt):
    risk = np.concatenate([np.repeat([False, True], run) for run in runs])[:STEPS]
    risk = np.pad(risk, (0, STEPS - len(risk)))
    seen, braking = on_device(jnp.array(risk), jnp.float32(dt))
    brakes = careful_brakes(risk, dt)
    assert (brakes == (np.asarray(seen) + int(careful_reaction_steps(np, dt)) <= np.arange(STEPS))).all()
    acts = int(np.argmax(np.append(brakes, True)))
    assert not braking[:acts].any()
    assert (braking[acts : acts + 1] > 0.0).all() or not risk[acts]  # it waits until the danger is there again


def danger(*runs):
    """A danger from one step up to another, and again."""
    risk = np.zeros(STEPS, bool)
    for begin, end in runs:
        risk[begin:end] = True
    return risk


@pytest.mark.parametrize(
    ("risk", "at", "seen"),
    [
        (danger((20, 40)), 39, 20),
        (danger((20, 40)), 23, STEPS),  # to believe it takes 0.4 s, five steps
        (danger((20, 40)), 24, 20),
        (danger((20, 24)), 26, STEPS),
        (danger((20, 25)), 27, 20),  # gone for 0.3 s
        (danger((20, 25)), 28, STEPS),  # for 0.4 s: it is over ...
        (danger((20, 40)), 50, STEPS),  # ... also when the brakes have acted
        (danger((20, 25), (28, 30)), 30, 20),  # there again in between
        (danger((20, 25), (40, 60)), 59, 40),
        (danger((20, 35), (40, 60)), 59, 40),  # of two, the one that is there
    ],
)
def test_the_danger_that_counts_is_the_one_that_has_not_ended(risk, at, seen):
    assert careful_perceives(np, risk, 0.1, at) == seen
    assert careful_perceives(np, risk[: at + 1], 0.1) == min(seen, at + 1)


@given(runs=st.lists(st.tuples(st.integers(0, 8), st.integers(1, 12)), min_size=1, max_size=6), cut=st.integers(0, 59))
def test_what_comes_later_changes_no_decision(runs, cut):
    risk = np.concatenate([np.repeat([False, True], run) for run in runs])[:STEPS]
    risk = np.pad(risk, (0, STEPS - len(risk)))
    other = np.where(np.arange(STEPS) > cut, ~risk, risk)
    assert (careful_brakes(risk, 0.1)[: cut + 1] == careful_brakes(other, 0.1)[: cut + 1]).all()
