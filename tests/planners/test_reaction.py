"""The time at which a careful driver acts: the rule over whole tracks agrees with the step-by-step one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from regents_cosim.norms.careful import CAREFUL
from regents_cosim.norms.reaction import careful_perceives, careful_reaction_steps
from regents_cosim.planners.reference.drivers import CarefulDriver, Reaction

TIMES = CarefulDriver().times
STEPS = 60


@jax.jit
def on_device(risk, dt):
    """The step at which the danger acted on is seen, and the planner's braking at every step."""

    def advance(state, danger):
        state = TIMES.next(state, CAREFUL.most_braking_m_s2 * danger[None], dt)
        return state, state.braking

    return careful_perceives(jnp, risk, dt), jax.lax.scan(advance, Reaction.none(1), risk.astype(jnp.float32))[1]


@pytest.mark.slow
@given(
    runs=st.lists(st.tuples(st.integers(0, 8), st.integers(1, 12)), min_size=1, max_size=6),
    dt=st.sampled_from([0.05, 0.1, 0.2, 0.25]),
)
def test_the_planner_brakes_when_the_verdict_says(runs, dt):
    risk = np.concatenate([np.repeat([False, True], run) for run in runs])[:STEPS]
    risk = np.pad(risk, (0, STEPS - len(risk)))
    seen = int(careful_perceives(np, risk, dt))
    seen_there, braking = on_device(jnp.array(risk), jnp.float32(dt))
    assert int(seen_there) == seen
    acts = min(seen + int(careful_reaction_steps(np, dt)), STEPS)
    assert not braking[:acts].any()
    assert (braking[acts : acts + 1] > 0.0).all() or not risk[acts]  # it waits until the danger is there again


def danger(*runs):
    """A danger from one step up to another, and again."""
    risk = np.zeros(STEPS, bool)
    for begin, end in runs:
        risk[begin:end] = True
    return risk


@pytest.mark.parametrize(
    ("risk", "seen"),
    [
        (danger((20, 40)), 20),
        (danger((20, 24)), STEPS),  # too short to be believed: that takes 0.4 s, five steps
        (danger((20, 25)), STEPS),  # gone for 0.7 s when the brakes would act
        (danger((20, 29)), 20),  # for 0.3 s
        (danger((20, 25), (28, 30)), 20),  # in between, too
        (danger((20, 25), (40, 60)), 40),
    ],
)
def test_a_danger_that_is_gone_before_the_brakes_act_is_dismissed(risk, seen):
    assert careful_perceives(np, risk, 0.1) == seen
