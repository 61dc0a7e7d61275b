"""How usual a motion is: the rank of its effort among continuations of the same moment, resampled from the traffic.

The *effort* of a drive is the length of (acceleration or braking, sideways acceleration, jerk), each a mean over 1 s
and a share of what vehicles do at most in ordinary traffic; its greatest value up to the contact is ranked.

A continuation begins with the state of the vehicle in its log and is put together of pieces of 1 s out of the logs of
the others in the scene, each the nearest in speed, acceleration and sideways acceleration of a few drawn at random
(nearest-neighbour bootstrap: Lall and Sharma 1996, Water Resources Research 32). Few vehicles say little: the peaks
are blurred by as much as a kernel estimate of so many samples takes (Silverman 1986, eq. 3.31), and a share of the
continuations is drawn from the peaks of the vehicle's kind.
"""

import zlib
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.lib.stride_tricks import sliding_window_view

from regents_cosim.limits import STANDING_M_S
from regents_cosim.scenario import VEHICLE_KINDS, Scenario, Tracks
from regents_cosim.verdicts.handling import MEAN_S, Handling, handling
from regents_cosim.verdicts.ordinary import CAR

CONTINUATIONS = 400
_NEAREST_OF = 8  # pieces drawn, the nearest of which goes on
_STATE = np.array([2.0, 1.0, 1.0])  # m/s, m/s^2, m/s^2 sideways: states that differ by so much are equally far apart
_NOTHING = 0.1  # efforts below are not felt, and equal

_AT_MOST = np.array([CAR.accel, CAR.braking, CAR.lateral_accel, CAR.jerk])
# Peaks of the efforts of these vehicles and of those of Argoverse 2 and USA_Peach in 8 s, as a log-normal distribution.
_KIND_MEDIAN, _KIND_SPREAD = 0.7, 0.8
_KIND_WEIGHT = 5.0  # vehicles that what is known of the kind counts for


def usual(attacked: Scenario) -> float | None:
    """How usual the motion of the adversary is, of an attacked scenario that ends in a collision [percent].

    The share of continuations of the same moment with at least its effort: 100 for a drive without any, below 1 for
    one that no vehicle of the traffic shows. None where it is not known: no motor vehicle, or seen for less than 2 s.
    """
    hit = attacked.attack.collision if attacked.attack else None
    if hit is None or attacked.original is None:
        return None
    agent = next(i for i, a in enumerate(attacked.agents) if a.id == hit.agent)
    return rank(attacked, attacked.original, agent, attacked.tracks, hit.step + 1)


def rank(scene: Scenario, log: Tracks, agent: int, moved: Tracks, end: int) -> float | None:
    """The same of one vehicle that moves as in `moved` before step `end`, among traffic that moves as in `log`."""
    if scene.agents[agent].kind not in VEHICLE_KINDS:
        return None
    own, before = _longest(moved, agent, scene.dt, end), _longest(log, agent, scene.dt, log.steps)
    if own is None or before is None:
        return None
    others = [i for i, one in enumerate(scene.agents) if i != agent and one.kind in VEHICLE_KINDS]
    drives = [drive for i in others for drive in _drives(log, i, scene.dt, log.steps)]
    rng = np.random.default_rng(zlib.crc32(np.ascontiguousarray(log.x).tobytes()))
    peaks = _peaks(drives, before.state[0], len(own.effort), round(MEAN_S / scene.dt), rng)
    reached = np.maximum(peaks, _NOTHING) >= max(own.effort.max(), _NOTHING)
    return round(100.0 * (1 + int(reached.sum())) / (1 + len(peaks)), 1)


@dataclass(frozen=True, eq=False)
class _Stretch:
    """One vehicle over a time without a gap."""

    state: Float[np.ndarray, "time 3"]  # [m/s, m/s^2, m/s^2] speed, acceleration, sideways acceleration
    effort: Float[np.ndarray, " time"]


def _drives(tracks: Tracks, agent: int, dt: float, end: int) -> list[_Stretch]:
    """The drives of an agent before step `end` that are long enough to say something."""
    return [_drive(felt) for felt in handling(tracks, agent, dt, end)]


def _longest(tracks: Tracks, agent: int, dt: float, end: int) -> _Stretch | None:
    return max(_drives(tracks, agent, dt, end), key=lambda drive: len(drive.effort), default=None)


def _drive(felt: Handling) -> _Stretch:
    along = felt.accel
    shares = np.stack([np.maximum(along, 0.0), np.maximum(-along, 0.0), felt.aside, felt.jerk]) / _AT_MOST[:, None]
    return _Stretch(np.stack([felt.speed, along, felt.aside], axis=1), np.linalg.norm(shares, axis=0))


def _peaks(
    drives: list[_Stretch], start: Float[np.ndarray, " 3"], steps: int, piece: int, rng: np.random.Generator
) -> Float[np.ndarray, " continuation"]:
    """The greatest effort of every continuation over so many steps; `piece` is the length of a piece in steps."""
    drives = [drive for drive in drives if len(drive.effort) > piece]
    vehicles = sum(bool((drive.state[:, 0] > STANDING_M_S).any()) for drive in drives)
    of_kind = round(CONTINUATIONS * _KIND_WEIGHT / (_KIND_WEIGHT + vehicles))
    drawn = _KIND_MEDIAN * np.exp(_KIND_SPREAD * rng.standard_normal(of_kind))
    if not vehicles:
        return drawn
    peaks = np.maximum(_resampled(drives, start, steps, piece, CONTINUATIONS - of_kind, rng), _NOTHING)
    # The spread that `_KIND_SPREAD` has at least: of a few vehicles it is not known.
    blur = 0.9 * _KIND_SPREAD * vehicles**-0.2
    return np.concatenate([drawn, peaks * np.exp(blur * rng.standard_normal(len(peaks)))])


def _resampled(
    drives: list[_Stretch], start: Float[np.ndarray, " 3"], steps: int, piece: int, count: int, rng: np.random.Generator
) -> Float[np.ndarray, " continuation"]:
    """The greatest effort of `count` chains of pieces of the drives, the first near the state `start`."""
    begins = np.concatenate([drive.state[:-piece] for drive in drives]) / _STATE
    ends = np.concatenate([drive.state[piece:] for drive in drives]) / _STATE
    now, peaks, rows = np.tile(start / _STATE, (count, 1)), np.zeros(count), np.arange(count)
    for left in range(steps, 0, -piece):
        drawn = rng.integers(0, len(begins), (count, _NEAREST_OF))
        away = ((begins[drawn] - now[:, None]) ** 2).sum(axis=2)
        taken = drawn[rows, away.argmin(axis=1)]
        peaks = np.maximum(peaks, _greatest(drives, min(left, piece), piece)[taken])
        now = ends[taken]
    return peaks


def _greatest(drives: list[_Stretch], steps: int, piece: int) -> Float[np.ndarray, " piece"]:
    """Of every piece, the greatest effort of its first `steps`."""
    return np.concatenate([sliding_window_view(d.effort, steps).max(axis=1)[: len(d.effort) - piece] for d in drives])
