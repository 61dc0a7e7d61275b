"""Manoeuvres that an ego could have done instead: a bank of braking x steering x onset.

Up to its onset a manoeuvre is the ego's own drive. From there on the ego keeps to the way that it drove itself
(`own_way`), gains or loses speed steadily for a while, moves over to one side and straightens up again:

    d(s) = D (r - sin(2 pi r) / (2 pi)),   r = s / L in [0, 1],   L = u sqrt(2 pi |D| / A)

over the distance s from the onset, where its speed is u; A is the peak of the lateral acceleration if the speed stays.
So the heading is a function of the distance, that of the own way plus atan(d'(s)), and with the change of heading per
metre as curvature the motion is an exact roll-out of the mirror's bicycle. Manoeuvres beyond the tyres or the bicycle
are left out.

Sources: lane change of sinusoidal lateral acceleration (Chee and Tomizuka 1994); friction circle a^2 + (u^2 k)^2 <= (mu
g)^2 (Rajamani 2012, ch. 13).
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from regents_cosim.judgement import Manoeuvre
from regents_cosim.norms.careful import swerve, swerve_length
from regents_cosim.norms.limits import ACCEL_LIMIT, CURVATURE_LIMIT
from regents_cosim.scenario import Scenario, Tracks
from regents_cosim.verdicts.careful.own_way import OwnWay, own_way

FRICTION = 0.75  # dry asphalt or concrete, sliding tyres (Wong 2008, table 1.3; 0.8 to 0.9 at their best)
GRAVITY = 9.81  # [m/s^2]

_LEAST_TRAVEL_M = 1e-6  # a standing vehicle has no curvature
_BEND_SHARE = 0.7  # the share of the friction that following the own way may take
_ROUNDING = 1.0 + 1e-9


@dataclass(frozen=True)
class ManoeuvreBank:
    """A grid of manoeuvres: every longitudinal with every lateral motion, from every onset."""

    accels: tuple[float, ...] = (-ACCEL_LIMIT, -4.0, -2.0, -1.0, 2.0)  # [m/s^2]
    lasting_s: tuple[float | None, ...] = (1.0, 2.0, None)  # None: to the end, only for braking
    shifts: tuple[float, ...] = (0.9, 1.8, 3.5)  # [m] half a car, a car, a lane
    lateral_accels: tuple[float, ...] = (1.0, 4.0, 6.5)  # [m/s^2] 4.2 is what full braking leaves
    # (time before the collision, spacing) of the onsets; the last pair limits them
    onsets_s: tuple[tuple[float, float], ...] = ((1.0, 0.1), (3.0, 0.2), (np.inf, 0.5))

    @property
    def along(self) -> list[tuple[float, float | None]]:
        """Pairs of acceleration [m/s^2] and duration [s]; one pair holds the speed."""
        pairs = itertools.product(self.accels, self.lasting_s)
        return [(0.0, None), *((accel, lasting) for accel, lasting in pairs if accel < 0 or lasting)]

    @property
    def aside(self) -> list[tuple[float, float]]:
        """Pairs of lateral acceleration [m/s^2] and shift [m]; one pair stays on the own way."""
        pairs = itertools.product(self.lateral_accels, self.shifts)
        return [(0.0, 0.0), *((side * accel, side * shift) for accel, shift in pairs for side in (1.0, -1.0))]

    def onsets(self, before: int, dt: float, also: tuple[int, ...] = ()) -> list[int]:
        """Onset steps before step `before`, the last first, including those of `also` in that range."""
        found = [before - 1]
        while found[-1] >= 0:
            early = (before - found[-1]) * dt
            spacing = next((spacing for until, spacing in self.onsets_s if early < until), None)
            if spacing is None:
                break
            found.append(found[-1] - max(round(spacing / dt), 1))
        first = max(before - self.onsets_s[-1][0] / dt - 1e-6, 0.0)
        return sorted({onset for onset in (*found, *also) if first <= onset < before}, reverse=True)


BANK = ManoeuvreBank()


@dataclass(frozen=True, eq=False)
class ManoeuvreSet:
    """Manoeuvres of one onset with their motion; time counts from the onset."""

    onset: int
    along: Int[np.ndarray, " manoeuvre"]  # index into `ManoeuvreBank.along`
    aside: Int[np.ndarray, " manoeuvre"]  # index into `ManoeuvreBank.aside`
    friction_share: Float[np.ndarray, " manoeuvre"]  # the greatest share of the friction along the manoeuvre
    x: Float[np.ndarray, "manoeuvre time"]  # [m]
    y: Float[np.ndarray, "manoeuvre time"]  # [m]
    yaw: Float[np.ndarray, "manoeuvre time"]  # [rad]
    speed: Float[np.ndarray, "manoeuvre time"]  # [m/s]

    def __len__(self) -> int:
        return len(self.x)

    def take(self, chosen: np.ndarray) -> "ManoeuvreSet":
        """Some of the manoeuvres, by mask or index."""
        return ManoeuvreSet(self.onset, *(values[chosen] for name, values in vars(self).items() if name != "onset"))

    def manoeuvre(self, index: int, bank: ManoeuvreBank) -> Manoeuvre:
        """The description of one manoeuvre."""
        accel, lasting_s = bank.along[self.along[index]]
        lateral_accel, shift = bank.aside[self.aside[index]]
        return Manoeuvre(self.onset, accel, lasting_s, lateral_accel, shift, float(self.friction_share[index]))

    def tracks(self, index: int, scenario: Scenario) -> Tracks:
        """The ego's track [1, time] along one manoeuvre, after its own drive up to the onset, with controls."""
        own, names = scenario.tracks, ("x", "y", "yaw", "speed")
        after = np.s_[index, : own.steps - self.onset]
        pieces = {name: (getattr(own, name)[0, : self.onset], getattr(self, name)[after]) for name in names}
        driven = {name: np.concatenate(both)[None] for name, both in pieces.items()}
        moved = _travelled(driven["speed"], scenario.dt)
        return Tracks(
            **driven,
            z=scenario.heights.of(0, driven["x"], driven["y"]),
            valid=own.valid[:1],
            accel=np.diff(driven["speed"], axis=1) / scenario.dt,
            curvature=_per_metre(np.diff(np.unwrap(driven["yaw"], axis=1), axis=1), moved),
        )


def manoeuvre_sets(
    bank: ManoeuvreBank, scenario: Scenario, before: int, steps: int, also: tuple[int, ...] = ()
) -> Iterator[ManoeuvreSet]:
    """All manoeuvres of `bank` that begin before step `before`, one set per onset, the last onset first.

    They also begin at the steps of `also`, and end at the instant `steps - 1`, which may lie beyond the horizon.
    """
    way = own_way(scenario)
    for onset in bank.onsets(before, scenario.dt, also):
        yield _manoeuvre_set(bank, scenario, way, onset, steps)


def _manoeuvre_set(bank: ManoeuvreBank, scenario: Scenario, way: OwnWay, onset: int, steps: int) -> ManoeuvreSet:
    own, dt = scenario.tracks, scenario.dt
    x, y, yaw, start = (float(values[0, onset]) for values in (own.x, own.y, own.yaw, own.speed))
    # [along, aside, time]: speed and distance do not depend on the steering
    time = dt * np.arange(steps - onset)
    accel, lasting = (np.array(values, float)[:, None, None] for values in zip(*bank.along, strict=True))
    speed = np.maximum(start + accel * np.fmin(time, lasting), 0.0)
    moved = _travelled(speed, dt)
    distance = _summed(moved)
    bend = way.turned(onset, distance, _BEND_SHARE * FRICTION * GRAVITY / max(start, 1.0) ** 2)
    heading = yaw + bend + _turned_aside(bank, distance, start)
    mid = 0.5 * (heading[..., :-1] + heading[..., 1:])
    curvature = _per_metre(np.diff(heading), np.broadcast_to(moved, mid.shape))
    sideways = (0.5 * (speed[..., :-1] + speed[..., 1:])) ** 2 * curvature
    judged = np.s_[..., : own.steps - onset - 1]  # steps up to the horizon
    share = np.hypot(np.diff(speed) / dt, sideways)[judged].max(axis=-1) / (FRICTION * GRAVITY)
    possible = (share <= _ROUNDING) & (np.abs(curvature)[judged].max(axis=-1) <= CURVATURE_LIMIT)
    along, aside = np.nonzero(possible)
    mid, moved = mid[possible], moved[along, 0]
    return ManoeuvreSet(
        onset,
        along,
        aside,
        share[possible],
        x=x + _summed(moved * np.cos(mid)),
        y=y + _summed(moved * np.sin(mid)),
        yaw=heading[possible],
        speed=speed[along, 0],
    )


def _turned_aside(
    bank: ManoeuvreBank, distance: Float[np.ndarray, "along 1 time"], speed: float
) -> Float[np.ndarray, "..."]:
    """The angle [rad] between heading and own way, atan(d'(s)), as [along, aside, time]."""
    lateral_accel, shift = np.array(bank.aside).T[:, :, None]
    length = swerve_length(np, speed, shift, np.where(shift == 0.0, 1.0, np.abs(lateral_accel)))
    return swerve(np, distance, length, shift)[1]


def _travelled(speed: Float[np.ndarray, "*axes time"], dt: float) -> Float[np.ndarray, "*axes step"]:
    """Distance travelled in each step [m]."""
    return 0.5 * (speed[..., :-1] + speed[..., 1:]) * dt


def _summed(increments: Float[np.ndarray, "*axes step"]) -> Float[np.ndarray, "*axes time"]:
    """Running sums that begin with 0."""
    sums = np.zeros((*increments.shape[:-1], increments.shape[-1] + 1))
    np.cumsum(increments, axis=-1, out=sums[..., 1:])
    return sums


def _per_metre(turned: Float[np.ndarray, "*axes"], moved: Float[np.ndarray, "*axes"]) -> Float[np.ndarray, "*axes"]:
    """Curvature [1/m] of a turn [rad] over a distance [m]; 0 where nothing moved."""
    return np.divide(turned, moved, out=np.zeros_like(turned), where=moved > _LEAST_TRAVEL_M)
