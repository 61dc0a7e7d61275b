"""All agents except the ego and one candidate, on their log: drives of the candidate may not touch them."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float, Int

from regents_cosim.attacks.starts.meeting import MeetingDrives
from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.scenario import Scenario

_FIRST_AT_ONCE, _MOST_AT_ONCE = 4, 64  # drives: usually the first few touch no other road user
_SPACING = 5  # steps between those at which nearness is checked first


class OtherTraffic:
    """The other agents, without those that touch the candidate in the log."""

    def __init__(self, scenario: Scenario, agent: int) -> None:
        index = np.arange(len(scenario.agents))
        known = {name for pair in scenario.overlaps if scenario.agents[agent].id in pair.agents for name in pair.agents}
        counts = [i not in (0, agent) and scenario.agents[i].id not in known for i in index.tolist()]
        tracks = scenario.tracks
        self._x, self._y, self._yaw = tracks.x[counts], tracks.y[counts], tracks.yaw[counts]
        self._there = tracks.valid[counts] & tracks.valid[agent]
        sizes = [(one.length, one.width) for one in scenario.agents]
        self._size, self._sizes = sizes[agent], np.array(sizes).reshape(-1, 2)[counts]
        self._reach_m = 0.5 * (np.hypot(*self._sizes.T) + np.hypot(*self._size))

    def left_alone(
        self, drives: MeetingDrives, rows: Int[np.ndarray, " row"], first: int, wanted: Bool[np.ndarray, " drive"]
    ) -> Iterator[int]:
        """The `rows` whose drives, from step `first` on, touch no other until they meet the ego; order is kept.

        Rows that are not `wanted` by the time of their turn are skipped.
        """
        at_once = _FIRST_AT_ONCE
        while len(rows):
            some, rows = rows[:at_once], rows[at_once:]
            some = some[wanted[some]]
            if len(some):
                yield from some[~self._touched_by(drives, some, first)].tolist()
            at_once = min(2 * at_once, _MOST_AT_ONCE)

    def _touched_by(self, drives: MeetingDrives, rows: Int[np.ndarray, " row"], first: int) -> Bool[np.ndarray, " row"]:
        """Whether each of some drives touches another agent until it meets the ego."""
        meets = drives.meets[rows]
        steps = int(meets.max()) + 1
        x, y, yaw = (values[rows, :steps] for values in (drives.x, drives.y, drives.yaw))
        ox, oy, oyaw, there = (v[:, first : first + steps] for v in (self._x, self._y, self._yaw, self._there))
        further_m = _SPACING * (_longest_step(x, y) + _longest_step(ox, oy))
        at = np.s_[:, ::_SPACING]
        away = (x[at][:, None] - ox[at]) ** 2 + (y[at][:, None] - oy[at]) ** 2
        may = (away < (self._reach_m + further_m)[:, None] ** 2).any(axis=-1)
        row, other = np.nonzero(may | ~there.all(axis=1))
        near = (x[row] - ox[other]) ** 2 + (y[row] - oy[other]) ** 2 < self._reach_m[other, None] ** 2
        pair, step = np.nonzero(near & there[other] & (np.arange(steps) <= meets[row, None]))
        row, other = row[pair], other[pair]
        mine = Boxes(x[row, step], y[row, step], yaw[row, step], *self._size)
        hits = overlap(mine, Boxes(ox[other, step], oy[other, step], oyaw[other, step], *self._sizes[other].T))
        touched = np.zeros(len(rows), bool)
        touched[row[hits]] = True
        return touched


def _longest_step(x: Float[np.ndarray, "row time"], y: Float[np.ndarray, "row time"]) -> float:
    """The longest way in one step [m]."""
    return float(np.hypot(np.diff(x), np.diff(y)).max(initial=0.0))
