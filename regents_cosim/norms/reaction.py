"""The time at which a careful driver acts on a danger that comes and goes.

The driver believes a danger once it has lasted as long as its evaluation takes; some time after that the brakes act.
The driver dismisses a danger that has not been seen for a while, before or after the brakes act. A driver who braked to
a standstill for a danger that is over would escape a later crash by luck; so only the danger that leads to the crash
counts, from when it was first seen. UN Regulation 157 says nothing of dangers that end; this driver dismisses one in
the time that it takes to believe one.
"""

from typing import Any

import numpy as np
from jaxtyping import Bool

from regents_cosim.norms.careful import CAREFUL

_NEAREST = 0.499


def careful_perceives(xp: Any, risk: Any, dt: Any, at: Any = -1) -> Any:
    """The first step of the danger that the careful driver believes at a step; the number of steps if there is none.

    `xp` is NumPy or jax.numpy; `risk` [time] tells at which steps there is a danger; `dt` is the step length [s]. `at`
    is the step, normally the last one; nothing after it counts.
    """
    steps = risk.shape[0]
    now = xp.arange(steps)
    seen = xp.concatenate([xp.zeros(1, int), xp.cumsum(risk)])  # dangers before each step

    def within(last: Any) -> Any:
        return seen[now + 1] - seen[xp.maximum(now + 1 - last, 0)]

    lasting = steps_of(xp, CAREFUL.evaluation_s, dt)
    believed = within(lasting + 1) == lasting + 1
    dismissed = xp.cumsum(within(steps_of(xp, CAREFUL.dismissal_s, dt)) == 0)
    kept = believed & (dismissed == dismissed[at]) & (now <= now[at])
    return xp.where(kept.any(), xp.argmax(kept) - lasting, steps)


def careful_brakes(risk: Bool[np.ndarray, " time"], dt: float) -> Bool[np.ndarray, " time"]:
    """At which steps the careful driver brakes, each decided by the dangers up to that step alone."""
    reaction = int(careful_reaction_steps(np, dt))
    since = [int(careful_perceives(np, risk, dt, step)) for step in range(len(risk))]
    return np.array([begin + reaction <= step for step, begin in enumerate(since)], bool)


def careful_reaction_steps(xp: Any, dt: Any) -> Any:
    """Steps of `dt` [s] from the first one of a danger to the last one before the brakes act."""
    return steps_of(xp, CAREFUL.evaluation_s + CAREFUL.delay_s, dt)


def steps_of(xp: Any, seconds: float, dt: Any) -> Any:
    """The nearest number of steps of `dt` [s]; halves are rounded down, in single precision too."""
    return xp.floor(seconds / dt + _NEAREST).astype(int)
