"""Choose whether and where a careful driver swerves, by what he expects when he decides, never by what comes.

He decides as long before he acts as his brakes take. Where he expects braking alone to be enough, he only brakes.
Otherwise he takes the swerve with the most room to all road users that he sees, if they go on as now
(`verdicts.careful.foresight`); where he expects a collision on each of them, he does not swerve. UN Regulation 157
knows no swerve.
"""

import numpy as np
from jaxtyping import Float, Int

from regents_cosim.collisions import apart_at_entry
from regents_cosim.geometry.boxes import Boxes, corners, distance
from regents_cosim.geometry.frames import wrap
from regents_cosim.maps.levels import beyond_road
from regents_cosim.norms.careful import CAREFUL, FORESIGHT
from regents_cosim.norms.limits import ALONG_RAD, OFF_ROAD_M
from regents_cosim.scenario import Scenario
from regents_cosim.verdicts.careful.ego_path import EgoPath
from regents_cosim.verdicts.careful.emergency_braking import EgoPositions, braking_positions
from regents_cosim.verdicts.careful.foresight import expected_ways


def expected_swerve(
    attacked: Scenario, path: EgoPath, adversary: int, decides: int, acts: int, speed: Float[np.ndarray, " step"]
) -> tuple[float, EgoPositions]:
    """The swerve [m, positive to the left] that the driver decides on at step `decides`, and the drive with it.

    The drive has these speeds, and moves aside from step `acts` on. The shift is 0 where he only brakes.
    """
    around = _ExpectedOthers(attacked, path, adversary, decides, acts)
    drives = {
        shift: braking_positions(attacked, path, speed, acts, shift, CAREFUL.swerve_m_s2)
        for shift in (0.0, *CAREFUL.swerves_m)
    }
    rooms = {
        shift: around.room_of(drive)
        for shift, drive in drives.items()
        if not shift or _keeps_to_road(attacked, drive, acts)
    }
    best = max(rooms, key=lambda shift: rooms[shift])
    chosen = best if rooms[0.0][0] <= 0.0 < rooms[best][0] else 0.0
    return chosen, drives[chosen]


class _ExpectedOthers:
    """The ways of all others from step `acts` on, as they are to be expected at step `decides`."""

    def __init__(self, attacked: Scenario, path: EgoPath, adversary: int, decides: int, acts: int) -> None:
        ahead = np.arange(acts - decides, int(FORESIGHT.ahead_s / attacked.dt) + 1)
        seen = _in_view(attacked, adversary, decides)
        x, y, yaw, z = expected_ways(attacked, path, seen, decides, ahead * attacked.dt)
        size = np.array([(agent.length, agent.width) for agent in attacked.agents])
        self._ways, self._size = (x, y, yaw, z), size[seen]
        self._steps, self._is_adversary, self._attacked = decides + ahead, seen == adversary, attacked

    def room_of(self, drive: EgoPositions) -> tuple[float, float]:
        """The least distances [m] of a drive to all others, and to the adversary."""
        steps = self._steps[self._steps < len(drive.x)]
        x, y, yaw = drive.x[steps], drive.y[steps], drive.yaw[steps]
        ego = self._attacked.ego
        mine = Boxes(x, y, yaw, ego.length, ego.width, self._attacked.heights.of(0, x, y))
        x, y, yaw, z = (values[:, : len(steps)] for values in self._ways)
        away = np.asarray(distance(mine, Boxes(x, y, yaw, self._size[:, :1], self._size[:, 1:], z)))
        return float(away.min(initial=np.inf)), float(away[self._is_adversary].min(initial=np.inf))


def _in_view(attacked: Scenario, adversary: int, step: int) -> Int[np.ndarray, " agent"]:
    """The road users that the driver sees at a step, without those behind him that go his way."""
    tracks, index = attacked.tracks, np.arange(len(attacked.agents))
    dx, dy = tracks.x[:, step] - tracks.x[0, step], tracks.y[:, step] - tracks.y[0, step]
    yaw = tracks.yaw[0, step]
    follows = (np.abs(wrap(tracks.yaw[:, step] - yaw)) < ALONG_RAD) & (dx * np.cos(yaw) + dy * np.sin(yaw) < 0.0)
    seen = tracks.valid[:, step] & apart_at_entry(attacked.agents, tracks) & ~follows
    return np.flatnonzero((seen | (index == adversary)) & (index > 0))


def _keeps_to_road(attacked: Scenario, drive: EgoPositions, onset: int) -> bool:
    """Whether every corner that was on the road at the onset stays on it."""
    ego, steps = attacked.ego, np.arange(onset, attacked.tracks.steps)
    x, y, yaw = drive.x[steps], drive.y[steps], drive.yaw[steps]
    z = np.asarray(attacked.heights.of(0, x, y))
    off = beyond_road(attacked.road, corners(Boxes(x, y, yaw, ego.length, ego.width)), z[:, None]) > OFF_ROAD_M
    return not off[:, ~off[0]].any()
