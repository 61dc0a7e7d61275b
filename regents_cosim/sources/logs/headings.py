"""Checks that headings agree with the vehicles' motion, which degrees read as radians do not.

Vehicles drive where they point, so a mean disagreement of a quarter turn over many moving samples is not a motion but a
wrong unit, axis or sign. Vehicles that drive backwards are few.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from regents_cosim.errors import LogError
from regents_cosim.geometry.frames import wrap
from regents_cosim.scenario.scenario import VEHICLE_KINDS
from regents_cosim.sources.logs.scene import LoggedScene

_MOVING_M = 0.3  # from sample to sample; slower vehicles do not tell a heading
_ENOUGH = 20  # moving samples, below which the check passes
_MOST_RAD = np.pi / 3.0  # of mean disagreement; correct logs have less than 0.1
_UNITS = {"rad": "radians", "deg": "degrees", "nav": "degrees clockwise from +y"}


class MovingSamples(NamedTuple):
    """The logged headings of moving samples, and the directions of their motion."""

    heading: Float[np.ndarray, " sample"]  # in the log's unit
    motion: Float[np.ndarray, " sample"]  # [rad]


def to_radians(heading: Float[np.ndarray, " sample"], unit: str) -> Float[np.ndarray, " sample"]:
    """Headings in radians, counter-clockwise from +x. `unit` is rad, deg, or nav (degrees clockwise from +y)."""
    if unit == "nav":
        return np.deg2rad(90.0 - heading)
    return np.deg2rad(heading) if unit == "deg" else heading


def moving(
    heading: Float[np.ndarray, " sample"],
    x: Float[np.ndarray, " sample"],
    y: Float[np.ndarray, " sample"],
    follows: np.ndarray,
) -> MovingSamples:
    """The samples at which a road user has moved since the previous one; `follows` marks those without a gap before."""
    dx, dy = np.diff(x), np.diff(y)
    moved = follows & (np.hypot(dx, dy) > _MOVING_M) & np.isfinite(heading[1:])
    return MovingSamples(heading[1:][moved], np.arctan2(dy[moved], dx[moved]))


def joined(ways: Iterable[MovingSamples]) -> MovingSamples:
    """The samples of several road users as one."""
    found = [*ways, MovingSamples(np.zeros(0), np.zeros(0))]
    return MovingSamples(np.concatenate([one.heading for one in found]), np.concatenate([one.motion for one in found]))


def disagreement(ways: MovingSamples, unit: str) -> float:
    """Mean angle between headings and motion [rad]; 0 where no sample moves."""
    if not len(ways.heading):
        return 0.0
    return float(np.abs(wrap(to_radians(ways.heading, unit) - ways.motion)).mean())


def unit_of(ways: MovingSamples, units: Sequence[str] = ("rad", "deg", "nav")) -> tuple[str, str]:
    """The unit in which headings agree best with the motion, in doubt the first, and a note that says so."""
    errors = [disagreement(ways, unit) for unit in units]
    if len(ways.heading) < _ENOUGH:
        return units[0], f"headings in {_UNITS[units[0]]} (assumed: hardly anything moves)"
    unit = units[int(np.argmin(errors))]
    return unit, f"headings in {_UNITS[unit]} (they agree best with the motion)"


def require_headings_along_motion(scene: LoggedScene) -> None:
    """Raise LogError where the headings of a scene's vehicles disagree with their motion."""
    driven = (track for track in scene.tracks if track.agent.kind in VEHICLE_KINDS)
    ways = joined(moving(track.yaw, track.x, track.y, np.diff(track.step) == 1) for track in driven)
    apart = disagreement(ways, "rad")
    if len(ways.heading) >= _ENOUGH and apart > _MOST_RAD:
        raise LogError(
            f"{scene.name}: headings and motion of the vehicles differ by {np.rad2deg(apart):.0f} degrees in the mean, "
            "expected less than 60 (are the headings in another unit, or from another axis?)"
        )
