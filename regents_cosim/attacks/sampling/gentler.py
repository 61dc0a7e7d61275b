"""Gentler drives to a crash that was found: the adversary's speeds up to the contact are made more even.

A drive keeps the line of the found one and comes to the place of contact at the same instant: its acceleration is a
mixture of the found one and of the constant one that covers the same way in the same time, and so covers it too. How
gentle a drive is, is the effort by which `usualness` ranks it.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from regents_cosim.attacks.descent.search import LOOKED_AT, in_one_look
from regents_cosim.attacks.descent.search_state import SearchResult
from regents_cosim.attacks.job import SearchJob
from regents_cosim.attacks.methods.moves import LookAt
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.programs.on_device import on_device
from regents_cosim.norms.limits import ACCEL_LIMIT, CURVATURE_LIMIT
from regents_cosim.scenario import VEHICLE_KINDS, Scenario
from regents_cosim.verdicts.usualness import peak_effort

_SHARES = (1.0, 0.8, 0.6, 0.4, 0.2)  # of the constant acceleration in a mixture
_BEGINS_S = (0.0, 1.0, 2.0)  # from when on it is mixed in
_LEAST_S = 1.5  # of an even drive before the contact
_LESS = 0.95  # of the former effort: a drive that takes no less is not gentler
_STILL_M = 1e-9
_LEAST_M = 1e-3  # of way in a step that shows a curvature


class Drive(NamedTuple):
    """The drive of one agent: controls of each step, and the speeds and headings to which they lead."""

    speed: Float[np.ndarray, " time"]  # [m/s]
    yaw: Float[np.ndarray, " time"]  # [rad]
    accel: Float[np.ndarray, " step"]  # [m/s^2]
    curvature: Float[np.ndarray, " step"]  # [1/m]

    def effort(self, first: int, last: int, dt: float) -> float | None:
        """Its greatest effort between two steps; None where that is too short."""
        return peak_effort(self.speed[first : last + 1], self.yaw[first : last + 1], dt)


def gentler_drives(case: Scenario, job: SearchJob, found: SearchResult) -> LookAt | None:
    """A look at drives that lead to the crash of `case` with less effort, the gentlest first; None: there is none."""
    hit, agent = case.attack.collision if case.attack else None, int(job.searched.first)
    if hit is None or case.agents[agent].id != hit.agent or case.agents[agent].kind not in VEHICLE_KINDS:
        return None
    made = found.motion.speed, found.motion.yaw, found.controls.accel, found.controls.curvature
    drive = Drive(*(np.asarray(values, float)[agent] for values in made))
    first, fastest = int(np.argmax(case.tracks.valid[agent])), float(job.world.top_speed[agent])
    now = drive.effort(first, hit.step, case.dt)
    tried = list[tuple[float, Drive]]()
    for mixed in mixtures(drive, first, hit.step, case.dt):
        effort = mixed.effort(first, hit.step, case.dt)
        if now and effort is not None and effort < _LESS * now and mixed.speed[first:].max() <= fastest:
            tried.append((effort, mixed))
    gentle = [mixed for _, mixed in sorted(tried, key=lambda one: one[0])[:LOOKED_AT]]
    if not gentle:
        return None
    shares = ((one.accel / ACCEL_LIMIT, one.curvature / CURVATURE_LIMIT) for one in gentle)
    actions = [ControlArrays(*(on_device(values[None], np.float32) for values in pair)) for pair in shares]
    return LookAt(in_one_look(actions), len(actions))


def mixtures(drive: Drive, first: int, last: int, dt: float) -> Iterator[Drive]:
    """The drives that come as far up to step `last`, more evenly, without a stop that the drive does not make."""
    accel = np.diff(drive.speed) / dt
    way = np.concatenate([[0.0], np.cumsum(0.5 * (drive.speed[1:] + drive.speed[:-1]) * dt)])
    for begin in (first + round(begins_s / dt) for begins_s in _BEGINS_S):
        seconds = (last - begin) * dt
        if seconds < _LEAST_S:
            continue
        even = 2.0 * (way[last] - way[begin] - drive.speed[begin] * seconds) / seconds**2
        for share in _SHARES:
            mixed = accel.copy()
            mixed[begin:last] += share * (even - accel[begin:last])
            speed = drive.speed[0] + np.concatenate([[0.0], np.cumsum(mixed * dt)])
            if speed[begin : last + 1].min() >= 0.0:
                yield _along(drive, way, mixed, np.maximum(speed, 0.0), dt)


def _along(
    drive: Drive,
    way: Float[np.ndarray, " time"],
    accel: Float[np.ndarray, " step"],
    speed: Float[np.ndarray, " time"],
    dt: float,
) -> Drive:
    """The drive with other speeds along the same line, as far as it leads."""
    gone = 0.5 * (speed[1:] + speed[:-1]) * dt
    rising = way + _STILL_M * np.arange(len(way))
    yaw = np.interp(np.concatenate([[0.0], np.cumsum(gone)]), rising, drive.yaw)
    return Drive(speed, yaw, accel, np.divide(np.diff(yaw), gone, out=np.zeros(len(gone)), where=gone > _LEAST_M))
