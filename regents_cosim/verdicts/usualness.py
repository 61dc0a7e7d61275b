"""How usual a motion is: the rank of its effort among continuations of the same moment, resampled from the traffic.

The *effort* of a drive or a walk is the length of (acceleration or braking, lateral acceleration, jerk), each a mean
over 1 s and a share of what vehicles, or people, do at most in ordinary traffic; its greatest value up to the contact
is ranked.

A continuation begins with the state of the road user in its log and consists of pieces of 1 s from the logs of others
of its kind; each piece is the nearest in speed, acceleration and lateral acceleration of a few drawn at random
(nearest-neighbour bootstrap: Lall and Sharma 1996, Water Resources Research 32). A few road users say little: the peaks
are blurred by the bandwidth of a kernel estimate of so many samples (Silverman 1986, eq. 3.31), and a share of the
continuations is drawn from the known peaks of the kind.
"""

import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.lib.stride_tricks import sliding_window_view

from regents_cosim.norms.limits import STANDING_M_S
from regents_cosim.scenario.collisions import collides_since
from regents_cosim.scenario.scenario import VEHICLE_KINDS, Kind, Scenario, Tracks
from regents_cosim.verdicts.handling import Handling, felt, handling, mean_steps
from regents_cosim.verdicts.ordinary import CAR, DrivingLimits

CONTINUATIONS = 400
_NEAREST_OF = 8  # pieces drawn, of which the nearest continues
_NOTHING = 0.1  # smaller efforts are not felt, and count as equal
_KIND_WEIGHT = 5.0  # the known peaks of the kind count as much as so many road users


@dataclass(frozen=True, eq=False)
class UsualMotion:
    """How some kinds of road users move in ordinary traffic."""

    kinds: frozenset[Kind]
    most: DrivingLimits
    state: Float[np.ndarray, " 3"]  # m/s, m/s^2, m/s^2 lateral: equal distances of states
    median: float  # median of the peak efforts in 8 s, which are log-normal
    spread: float


# Peaks of the vehicles that `ordinary.CAR` was taken from and of those of Argoverse 2 and USA_Peach; of 17 pedestrians
# of the eight scenes of Waymo and the two of Argoverse 2 that it was tuned on. The two cyclists there say nothing.
VEHICLES = UsualMotion(VEHICLE_KINDS, CAR, np.array([2.0, 1.0, 1.0]), median=0.7, spread=0.8)
_HARD_ON_FOOT = DrivingLimits(accel=0.9, braking=0.9, lateral_accel=1.0, jerk=1.5)  # `ordinary.PEDESTRIAN`, rounded up
_ON_FOOT = UsualMotion(frozenset({"pedestrian"}), _HARD_ON_FOOT, np.array([0.5, 0.3, 0.3]), median=1.0, spread=0.7)


def usualness(attacked: Scenario) -> float | None:
    """How usual the motion of the adversary is, for an attacked scenario that ends in a collision [percent].

    It is the share of continuations of the same moment with at least its effort: 100 for a drive without any, below 1
    for one that nobody of its kind shows. None where unknown: for a cyclist, or an agent seen for less than 2 s.
    """
    hit = attacked.collision
    if hit is None or attacked.log is None:
        return None
    agent = attacked.index(hit.agent)
    return rank(attacked, attacked.log, agent, attacked.tracks, hit.step + 1)


def rank(scene: Scenario, log: Tracks, agent: int, moved: Tracks, end: int) -> float | None:
    """How usual one agent's motion along `moved` before step `end` is in traffic that moves as in `log` [percent]."""
    kind = next((one for one in (VEHICLES, _ON_FOOT) if scene.agents[agent].kind in one.kinds), None)
    if kind is None:
        return None
    own, before = _longest(kind, moved, agent, scene.dt, end), _longest(kind, log, agent, scene.dt, log.steps)
    if own is None or before is None:
        return None
    others = [i for i, one in enumerate(scene.agents) if i != agent and one.kind in kind.kinds]
    until = collides_since(scene)
    drives = [drive for i in others for drive in _drives(kind, log, i, scene.dt, int(until[i]))]
    rng = np.random.default_rng(zlib.crc32(np.ascontiguousarray(log.x).tobytes()))
    peaks = _peaks(kind, drives, before.state[0], len(own.effort), int(mean_steps(np, scene.dt)), rng)
    reached = np.maximum(peaks, _NOTHING) >= max(own.effort.max(), _NOTHING)
    return round(100.0 * (1 + int(reached.sum())) / (1 + len(peaks)), 1)


def peak_effort(speed: Float[np.ndarray, " time"], yaw: Float[np.ndarray, " time"], dt: float) -> float | None:
    """The greatest effort of a vehicle's drive, as ranked by `rank`; None where it lasts no two seconds."""
    steps = int(mean_steps(np, dt))
    return float(_drive(VEHICLES, felt(speed, yaw, steps, dt)).effort.max()) if len(speed) > 2 * steps else None


@dataclass(frozen=True, eq=False)
class _Stretch:
    """The states and efforts of one road user over a time without a gap."""

    state: Float[np.ndarray, "time 3"]  # [m/s, m/s^2, m/s^2] speed, acceleration, sideways acceleration
    effort: Float[np.ndarray, " time"]


def _drives(kind: UsualMotion, tracks: Tracks, agent: int, dt: float, end: int) -> list[_Stretch]:
    """The drives of an agent before step `end` that are long enough."""
    return [_drive(kind, moved) for moved in handling(tracks, agent, dt, end)]


def _longest(kind: UsualMotion, tracks: Tracks, agent: int, dt: float, end: int) -> _Stretch | None:
    return max(_drives(kind, tracks, agent, dt, end), key=lambda drive: len(drive.effort), default=None)


def _drive(kind: UsualMotion, moved: Handling) -> _Stretch:
    state = np.stack([moved.speed, moved.accel, moved.aside], axis=1)
    return _Stretch(state, np.sqrt(square_effort(np, kind.most, moved.accel, moved.aside, moved.jerk)))


def square_effort(xp: Any, most: DrivingLimits, accel: Any, aside: Any, jerk: Any) -> Any:
    """The square of the effort of accelerations [m/s^2] and jerks [m/s^3], each a mean over 1 s."""
    shares = xp.maximum(accel, 0.0) / most.accel, xp.minimum(accel, 0.0) / most.braking, aside / most.lateral_accel
    return sum((share**2 for share in shares), (jerk / most.jerk) ** 2)


def _peaks(
    kind: UsualMotion,
    drives: list[_Stretch],
    start: Float[np.ndarray, " 3"],
    steps: int,
    piece: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, " continuation"]:
    """The greatest effort of every continuation over `steps` steps; `piece` is the length of a piece in steps."""
    drives = [drive for drive in drives if len(drive.effort) > piece]
    moving = sum(bool((drive.state[:, 0] > STANDING_M_S).any()) for drive in drives)
    of_kind = round(CONTINUATIONS * _KIND_WEIGHT / (_KIND_WEIGHT + moving))
    drawn = kind.median * np.exp(kind.spread * rng.standard_normal(of_kind))
    if not moving:
        return drawn
    peaks = np.maximum(_resampled(kind, drives, start, steps, piece, CONTINUATIONS - of_kind, rng), _NOTHING)
    # At least the spread of the kind, as a few road users do not show it.
    blur = 0.9 * kind.spread * moving**-0.2
    return np.concatenate([drawn, peaks * np.exp(blur * rng.standard_normal(len(peaks)))])


def _resampled(
    kind: UsualMotion,
    drives: list[_Stretch],
    start: Float[np.ndarray, " 3"],
    steps: int,
    piece: int,
    count: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, " continuation"]:
    """The greatest effort of `count` chains of pieces of the drives, the first near the state `start`."""
    begins = np.concatenate([drive.state[:-piece] for drive in drives]) / kind.state
    ends = np.concatenate([drive.state[piece:] for drive in drives]) / kind.state
    now, peaks, rows = np.tile(start / kind.state, (count, 1)), np.zeros(count), np.arange(count)
    for left in range(steps, 0, -piece):
        drawn = rng.integers(0, len(begins), (count, _NEAREST_OF))
        away = ((begins[drawn] - now[:, None]) ** 2).sum(axis=2)
        taken = drawn[rows, away.argmin(axis=1)]
        peaks = np.maximum(peaks, _greatest(drives, min(left, piece), piece)[taken])
        now = ends[taken]
    return peaks


def _greatest(drives: list[_Stretch], steps: int, piece: int) -> Float[np.ndarray, " piece"]:
    """For every piece the greatest effort of its first `steps`."""
    return np.concatenate([sliding_window_view(d.effort, steps).max(axis=1)[: len(d.effort) - piece] for d in drives])
