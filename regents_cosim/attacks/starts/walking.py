"""Walks of a pedestrian along lines: it heads for the line a little ahead, and turns no faster than it may.

A line may leave in any direction, but a walk begins with the pedestrian's own heading, and cuts the corners of the
line. The mirror's model of a pedestrian can follow these walks within its bounds (`driving_limits`), so a search can
begin with them.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from regents_cosim.attacks.descent.driving_limits import SLOWEST_TURN_M_S, STEADY_TURN
from regents_cosim.attacks.starts.drive_lines import SPACING_M, AlongLines, DriveLine
from regents_cosim.geometry.frames import wrap
from regents_cosim.verdicts.ordinary import DrivingLimits

_AHEAD_M, _AHEAD_S = 0.5, 0.5  # it heads for a place this far ahead on the line, plus its way in this time
_OF_FASTEST = 0.998 * STEADY_TURN  # share of the fastest turn, as the search works in single precision


def walk(
    lines: Sequence[DriveLine],
    line: Int[np.ndarray, " row"],
    begun: tuple[float, float, float],
    speed: Float[np.ndarray, "row time"],
    dt: float,
    limits: DrivingLimits,
) -> AlongLines:
    """Walks from one pose `begun` [m, m, rad] with the given speeds [m/s], each along the line of its index `line`."""
    points, heading = np.concatenate([one.points for one in lines]), np.concatenate([one.heading for one in lines])
    ends = np.cumsum([len(one.points) for one in lines])
    first, last = np.concatenate([[0], ends[:-1]])[line], ends[line] - 1
    pace = 0.5 * (speed[:, 1:] + speed[:, :-1])
    fastest = _OF_FASTEST * limits.lateral_accel * dt / np.maximum(pace, SLOWEST_TURN_M_S)
    state = np.empty((speed.shape[1], 4, len(line)))  # along, x, y, yaw
    state[0] = np.array([0.0, *begun])[:, None]
    for step in range(speed.shape[1] - 1):
        along, x, y, yaw = state[step]
        goal = points[_index(first, last, along + _AHEAD_M + _AHEAD_S * pace[:, step])]
        turn = wrap(np.arctan2(goal[:, 1] - y, goal[:, 0] - x) - yaw)
        turn = np.clip(turn, -fastest[:, step], fastest[:, step])
        mid, moved = yaw + 0.5 * turn, pace[:, step] * dt
        onward = moved * np.maximum(np.cos(mid - heading[_index(first, last, along)]), 0.0)
        state[step + 1] = along + onward, x + moved * np.cos(mid), y + moved * np.sin(mid), yaw + turn
    return AlongLines(*np.moveaxis(state, (1, 2), (0, 1)))


def _index(
    first: Int[np.ndarray, " row"], last: Int[np.ndarray, " row"], along: Float[np.ndarray, " row"]
) -> Int[np.ndarray, " row"]:
    """The indices of the points nearest to the distances `along` [m] on their lines."""
    return np.minimum(first + np.rint(along / SPACING_M).astype(int), last)
