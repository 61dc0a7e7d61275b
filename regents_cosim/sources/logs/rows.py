"""Turns rows of a table into tracks: sorts by road user and time, drops duplicates, finds missing headings."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from regents_cosim.errors import LogError
from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.lines import steps_along
from regents_cosim.sources.logs.missing_headings import RawTrack, with_headings, with_own_motion
from regents_cosim.sources.logs.scene import LATEST_STEP, LoggedMap, Track, agent_with_size

_MOST_AGENTS = 100_000
_ON_TIME = 0.01  # of a step: less is on time
_UNSTEADY = 0.1  # of a step: more is unsteady
_ROUND = 0.004  # of a step: the most by which it is rounded; steps of Waymo are up to 0.25 % longer than 0.1 s
_FAR_STEPS = 100  # between two instants, beyond which their number is not certain
_HALFWAY = 1e-6  # of a step: less is the inexactness of numbers
_GAP = 1.75  # steps between two samples, beyond which one is missing
_ELSEWHERE_M, _OFTEN = 5.0, 0.1  # one id at places so far apart at this share of its instants is two road users


class Rows(NamedTuple):
    """Samples of many road users, in any order."""

    who: Int[np.ndarray, " row"]  # number of the road user
    step: Int[np.ndarray, " row"]
    x: Float[np.ndarray, " row"]  # [m]
    y: Float[np.ndarray, " row"]  # [m]
    yaw: Float[np.ndarray, " row"]  # [rad], NaN where the log has none
    kind: np.ndarray  # the Kind of the road user
    length: Float[np.ndarray, " row"]  # [m], NaN where the log has none
    width: Float[np.ndarray, " row"]  # [m], NaN where the log has none
    names: Sequence[str] | None = None  # of the road users by number; None: the number is the name
    late: Float[np.ndarray, " row"] | None = None  # how long after its step a sample was taken, in steps


def tracks_of(rows: Rows, road: LoggedMap | None = None, along: float | None = None) -> list[Track]:
    """One Track per road user, of the kind in its first row and the median size.

    Of two rows with the same instant the first is kept. Missing headings follow from the motion, the `road`, and
    `along`, the direction of all lanes [rad].
    """
    return with_headings(_unfaced(rows), road, along)


def _require_one_place(rows: Rows, order: Int[np.ndarray, " row"]) -> None:
    """Raise LogError where an id stands for two road users at once; `order` sorts the rows by id and step."""
    who, step = rows.who[order], rows.step[order]
    away = steps_along(rows.x[order], rows.y[order])
    twice = (np.diff(who) == 0) & (np.diff(step) == 0) & (away > _ELSEWHERE_M)
    every, rows_of = np.unique(who, return_counts=True)
    split, times = np.unique(who[1:][twice], return_counts=True)
    often = times > _OFTEN * rows_of[np.searchsorted(every, split)]
    for number, count in zip(split[often], times[often], strict=True):
        name = str(number) if rows.names is None else rows.names[number]
        raise LogError(
            f"{count} times the road user {name[:40]!r} is at two places at once (does the file hold several "
            "recordings? give each its own file, or each road user its own id)"
        )


def _unfaced(rows: Rows) -> Iterator[RawTrack]:
    order = np.lexsort((rows.step, rows.who))
    _require_one_place(rows, order)
    who = rows.who[order]
    starts = np.flatnonzero(np.diff(who, prepend=who[0] - 1)) if len(who) else np.zeros(0, int)
    if len(starts) > _MOST_AGENTS:
        raise LogError(f"{len(starts)} road users, expected at most {_MOST_AGENTS}")
    for start, end in zip(starts, [*starts[1:], len(who)], strict=True):
        mine = order[start:end]
        mine = mine[np.diff(rows.step[mine], prepend=rows.step[mine[0]] - 1) > 0]
        number, first = int(who[start]), int(mine[0])
        name = str(number) if rows.names is None else rows.names[number]
        agent = agent_with_size(name, rows.kind[first], rows.length[mine], rows.width[mine])
        one = RawTrack(agent, rows.step[mine], rows.x[mine], rows.y[mine], rows.yaw[mine])
        if rows.late is not None and np.abs(rows.late[mine]).max() > _ON_TIME:
            place = one.step + rows.late[mine]
            moved = RawTrack(agent, *_on_time(one.step, place, one.x, one.y, with_own_motion(one)))
            one = moved if len(moved.step) else one  # seen once
        yield one


def _on_time(
    step: Int[np.ndarray, " sample"],
    place: Float[np.ndarray, " sample"],
    x: Float[np.ndarray, " sample"],
    y: Float[np.ndarray, " sample"],
    yaw: Float[np.ndarray, " sample"],
) -> tuple[Int[np.ndarray, " kept"], *tuple[Float[np.ndarray, " kept"], ...]]:
    """Interpolate samples taken at `place` linearly to whole steps; steps beyond the ends are dropped.

    Without this, a frame that is 40 ms late would change the speed of a vehicle at 5 m/s to 4 m/s, then to 8 m/s.
    """
    after = np.clip(np.searchsorted(place, step), 1, len(place) - 1) if len(place) > 1 else np.zeros(len(step), int)
    before = np.maximum(after - 1, 0)
    inside = (place[before] - _ON_TIME <= step) & (step <= place[after] + _ON_TIME)
    inside &= place[after] - place[before] < _GAP
    values = (np.interp(step, place, of) for of in (x, y, np.unwrap(yaw)))
    x, y, yaw = (of[inside] for of in values)
    return step[inside], x, y, np.asarray(wrap(yaw))


def late_notes(late: Float[np.ndarray, " row"] | None, dt: float) -> list[str]:
    """Notes on samples that were not taken at their steps."""
    most = 0.0 if late is None else float(np.abs(late).max())
    if most <= _ON_TIME:
        return []
    return [f"samples are up to {1e3 * dt * most:.0f} ms off steps of {1e3 * dt:.4g} ms: moved onto them"]


def steps_of(
    times: Float[np.ndarray, " row"],
) -> tuple[Int[np.ndarray, " row"], Float[np.ndarray, " row"], float, float]:
    """The step of each row, how late it is [steps], the duration of a step [s] and the first time [s].

    Each row belongs to the nearest step.
    """
    if not np.isfinite(times).all():
        raise LogError("a time is not a number")
    known = np.unique(np.round(times, 4))
    if len(known) < 2:
        raise LogError(f"{len(known)} instants, expected at least 2")
    dt = _usual_gap(known)
    place = (times - known[0]) / max(dt, 1e-4)
    if place.max() > LATEST_STEP:
        raise LogError(f"times from {known[0]:g} to {known[-1]:g} s at steps of {dt:g} s, expected one recording")
    step = _nearest(place)
    if np.median(np.abs(place - step)) > 0.1:
        raise LogError(f"times do not lie on steps of {dt:g} s")
    return step, place - step, dt, float(known[0])


def _nearest(place: Float[np.ndarray, " row"]) -> Int[np.ndarray, " row"]:
    """The nearest step; of places halfway between steps the later one, so that they stay one step apart."""
    return np.floor(place + (0.5 + _HALFWAY)).astype(int)


def _usual_gap(known: Float[np.ndarray, " instant"]) -> float:
    """The gap [s] between instants: their median, or their mean where the instants lie nearer to steps of it.

    The median is blind to late frames; at 30 Hz it is 0.0333 s, and off by a whole step after half a minute.
    """
    gaps = np.diff(known)
    median = float(np.round(np.median(gaps), 4))
    taken = np.round(gaps / max(median, 1e-4))
    near = (taken > 0) & (taken < _FAR_STEPS)
    if not near.any():
        return median
    mean = float(gaps[near].sum() / taken[near].sum())

    def off(gap: float) -> float:
        place = (known - known[0]) / max(gap, 1e-4)
        return float(np.abs(place - np.round(place)).mean())

    return min((median, mean), key=off)


def rows_by(values: np.ndarray) -> dict[Any, Int[np.ndarray, " row"]]:
    """The rows that have each value, in their order."""
    order = np.argsort(values, kind="stable")
    starts = np.flatnonzero(np.diff(values[order], prepend=np.nan))
    parts = np.split(order, starts[1:])  # a single one where there are no rows
    return dict(zip(values[order][starts].tolist(), parts, strict=False))


class FrameSteps(NamedTuple):
    """The steps of rows whose times are numbers of frames."""

    step: Int[np.ndarray, " row"]
    late: Float[np.ndarray, " row"]  # how long after its step a sample was taken, in steps
    stride: int  # frames in a step: some files keep every tenth frame alone
    first: int  # frame


def steps_of_frames(frames: np.ndarray, who: Int[np.ndarray, " row"], path: Path) -> FrameSteps:
    """The steps of rows from the first on, as far apart as the samples of road users, who are numbered.

    Raises LogError for frames that are no whole numbers.
    """
    frame = require_steps(frames, path)
    order = np.lexsort((frame, who))
    apart = np.diff(frame[order])[np.diff(who[order]) == 0]
    stride, first = max(int(np.gcd.reduce(apart, initial=0)), 1), int(frame.min())
    place = (frame - first) / stride
    step = _nearest(place)
    return FrameSteps(step, place - step, stride, first)


def require_steps(values: np.ndarray, path: Path) -> np.ndarray:
    """Whole numbers that are valid steps. Raises LogError for others."""
    if not ((np.abs(values) <= LATEST_STEP) & (values == np.floor(values))).all():  # NaN is neither
        raise LogError(f"{path}: a frame or id is not a whole number up to {LATEST_STEP:g}")
    return values.astype(int)


def steady_step(times: Float[np.ndarray, " instant"], decimals: int) -> float:
    """The step [s] of a scene with these time stamps, to so many decimals unless that changes it by more than 0.4 %.

    Raises LogError where it is not steady.
    """
    if len(times) < 2 or not (np.diff(times) > 0).all():
        raise LogError(f"{len(times)} time stamps, expected at least 2 that increase")
    median = float(np.median(np.diff(times)))
    dt = round(median, decimals)
    if abs(dt - median) > _ROUND * median:
        dt = float(times[-1] - times[0]) / (len(times) - 1)
    require_steady(times, dt)
    return dt


def require_steady(times: Float[np.ndarray, " instant"], dt: float) -> None:
    """Raise LogError where the time stamps of a scene are not `dt` apart, within a tenth of it."""
    off = float(np.abs(np.diff(times) - dt).max(initial=0.0))
    if off > _UNSTEADY * dt:
        raise LogError(
            f"a time stamp is {1e3 * off:.0f} ms off steps of {1e3 * dt:g} ms, expected at most "
            f"{1e3 * _UNSTEADY * dt:g} ms (speeds would be wrong)"
        )
