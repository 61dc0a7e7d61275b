"""Find the road users that a drive of the ego meets on their fixed tracks, up to a little beyond the horizon."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.geometry.frames import ahead_and_left
from regents_cosim.norms.clean import follows
from regents_cosim.scenario.collisions import apart_at_entry
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.verdicts.careful.ego_path import EgoPositions

BEYOND_S = 2.0  # by which a drive is judged longer than the tracks, for the adversary


@dataclass(frozen=True, eq=False)
class OverlappedUsers:
    """The road users that a drive overlaps: those that count against it, and those that only run into its back."""

    counts: Bool[np.ndarray, " agent"]
    from_behind: Bool[np.ndarray, " agent"]


class OthersAround:
    """All agents except the ego; beyond the horizon the adversary goes straight on, the others are absent."""

    def __init__(self, scenario: Scenario, adversary: int, tracks: Tracks | None = None) -> None:
        """`tracks` are those of the scenario, unless the others are to drive otherwise."""
        tracks = scenario.tracks if tracks is None else tracks
        ahead = scenario.dt * np.arange(1, round(BEYOND_S / scenario.dt) + 1)
        speed, yaw = tracks.speed[:, -1:], tracks.yaw[:, -1:]
        self._x = np.hstack([tracks.x, tracks.x[:, -1:] + speed * np.cos(yaw) * ahead])
        self._y = np.hstack([tracks.y, tracks.y[:, -1:] + speed * np.sin(yaw) * ahead])
        self._yaw = np.hstack([tracks.yaw, yaw + 0.0 * ahead])
        self._z = np.hstack([tracks.z, tracks.z[:, -1:] + 0.0 * ahead])
        is_adversary = np.arange(len(tracks.x)) == adversary
        self._valid = np.hstack([tracks.valid, np.outer(is_adversary & tracks.valid[:, -1], np.ones(len(ahead), bool))])
        self._valid &= apart_at_entry(scenario.agents, tracks)[:, None]
        self._size = np.array([(agent.length, agent.width) for agent in scenario.agents])
        self._adversary, self._heights = adversary, scenario.heights

    def met_by(self, drive: EgoPositions) -> OverlappedUsers:
        """The road users that the drive overlaps; those that run into its back do not count, as a log does not brake.

        The adversary counts however it meets the ego.
        """
        dx, dy = self._x - drive.x, self._y - drive.y
        diagonal = np.hypot(*self._size.T)
        near = self._valid & (dx**2 + dy**2 <= (0.5 * (diagonal + diagonal[0]))[:, None] ** 2)
        agent, step = np.nonzero(near)
        z = self._heights.of(0, drive.x[step], drive.y[step])
        (long, wide), at = self._size.T, (agent, step)
        ego = Boxes(drive.x[step], drive.y[step], drive.yaw[step], long[0], wide[0], z)
        other = Boxes(self._x[at], self._y[at], self._yaw[at], long[agent], wide[agent], self._z[at])
        touches = np.flatnonzero(overlap(ego, other))
        met, first = np.unique(agent[touches], return_index=True)  # in the order of the steps
        at, step = (met, step[touches[first]]), step[touches[first]]
        ahead, _ = ahead_and_left(np, dx[at], dy[at], drive.yaw[step])
        from_behind = follows(np.cos(self._yaw[at] - drive.yaw[step]), ahead)
        counts, behind = np.zeros((2, len(self._x)), bool)
        counts[met] = (met == self._adversary) | ~from_behind
        behind[met] = ~counts[met]
        return OverlappedUsers(counts, behind)
