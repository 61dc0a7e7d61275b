"""The time at which a careful driver acts on a danger that comes and goes.

The driver believes a danger once it has lasted as long as its evaluation takes; some time after that the brakes act.
The driver dismisses a danger that has not been seen for a while by then, and does not brake: a driver who brakes to a
standstill for a danger that is already over would escape a later crash by luck. UN Regulation 157 says nothing of this
case, as its dangers last; this driver dismisses a danger in the time that it takes to believe one.
"""

from typing import Any

from regents_cosim.norms.careful import CAREFUL

_NEAREST = 0.499


def careful_perceives(xp: Any, risk: Any, dt: Any) -> Any:
    """The first step of a danger that the careful driver believes and does not dismiss; the number of steps if none.

    `xp` is NumPy or jax.numpy; `risk` [time] tells at which steps there is a danger; `dt` is the step length [s].
    """
    steps = risk.shape[0]
    now = xp.arange(steps)
    seen = xp.concatenate([xp.zeros(1, int), xp.cumsum(risk)])  # dangers before each step

    def within(last: Any) -> Any:
        return seen[now + 1] - seen[xp.maximum(now + 1 - last, 0)]

    lasting = steps_of(xp, CAREFUL.evaluation_s, dt)
    believed = within(lasting + 1) == lasting + 1
    dismissed = xp.cumsum(within(steps_of(xp, CAREFUL.dismissal_s, dt)) == 0)
    acts = xp.minimum(now - lasting + careful_reaction_steps(xp, dt), steps - 1)
    kept = believed & (dismissed[acts] == dismissed)
    return xp.where(kept.any(), xp.argmax(kept) - lasting, steps)


def careful_reaction_steps(xp: Any, dt: Any) -> Any:
    """Steps of `dt` [s] from the first one of a danger to the last one before the brakes act."""
    return steps_of(xp, CAREFUL.evaluation_s + CAREFUL.delay_s, dt)


def steps_of(xp: Any, seconds: float, dt: Any) -> Any:
    """The nearest number of steps of `dt` [s]; halves are rounded down, in single precision too."""
    return xp.floor(seconds / dt + _NEAREST).astype(int)
