"""Find jumps of tracks: steps over which an agent was put elsewhere, as no vehicle can drive."""

import numpy as np
from jaxtyping import Bool, Float

# A jump differs from the motion before and after it by more than the hardest braking explains: the emergency
# deceleration of SUMO, and the size of the kinks of its lanes.
_HARDEST_M_S2 = 9.0
_JUMP_M = 0.4


def jumps(
    x: Float[np.ndarray, "agent time"],
    y: Float[np.ndarray, "agent time"],
    links: Bool[np.ndarray, "agent time-1"],
    dt: float,
) -> Bool[np.ndarray, "agent time-1"]:
    """Steps between consecutive samples (`links`) over which an agent was put elsewhere.

    Such a step differs from the one before and from the one after by more than 0.4 m + 9 m/s^2 dt^2 (0.49 m at 0.1 s):
    an instant lane change, a junction crossed in one step, a teleport. Positions decide, not reported speeds: SUMO's
    speeds differ from the geometry in junctions, and logs may hold none.
    """
    change = np.abs(np.diff(np.diff(x + 1j * y)))
    change = np.where(links[:, :-1] & links[:, 1:], change, np.inf)
    border = np.full((len(x), 1), np.inf)
    least = np.minimum(np.hstack([border, change]), np.hstack([change, border]))
    return np.isfinite(least) & (least > _JUMP_M + _HARDEST_M_S2 * dt**2)


def leaps(
    x: Float[np.ndarray, "agent time"],
    y: Float[np.ndarray, "agent time"],
    valid: Bool[np.ndarray, "agent time"],
    dt: float,
) -> Bool[np.ndarray, " agent"]:
    """The agents that no vehicle model can follow: those that jump, and those that reappear elsewhere after a gap.

    Over a gap of n steps an agent may differ by 0.4 m + 9 m/s^2 (n dt)^2 from the place to which the step before the
    gap, or the step after it, would have led. An agent without such a step may reappear anywhere.
    """
    found = np.any(jumps(x, y, valid[:, :-1] & valid[:, 1:], dt), axis=1)
    place = x + 1j * y
    for agent in np.flatnonzero((np.diff(valid.astype(int), axis=1) == 1).any(axis=1) & ~found):
        there = np.flatnonzero(valid[agent])
        at = np.flatnonzero(np.diff(there) > 1)
        steps = np.diff(there)
        moved = np.diff(place[agent, there])
        for gap in at:
            most = _JUMP_M + _HARDEST_M_S2 * (steps[gap] * dt) ** 2
            beside = [i for i in (gap - 1, gap + 1) if 0 <= i < len(steps) and steps[i] == 1]
            misses = [abs(moved[gap] - steps[gap] * moved[i]) for i in beside]
            found[agent] |= bool(misses) and min(misses) > most
    return found
