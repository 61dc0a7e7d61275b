"""Rows of a table become tracks: sorted by who and when, doubled rows dropped, headings found where absent."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from regents_cosim.errors import LogError
from regents_cosim.frames import wrap
from regents_cosim.scenario import Agent
from regents_cosim.sources.logs.scene import Track

_TURNS_M = 0.5  # of way by which a direction is told
_MOST_AGENTS = 100_000


class Rows(NamedTuple):
    """Samples of many road users, in any order."""

    who: Int[np.ndarray, " row"]
    step: Int[np.ndarray, " row"]
    x: Float[np.ndarray, " row"]  # [m]
    y: Float[np.ndarray, " row"]  # [m]
    yaw: Float[np.ndarray, " row"]  # [rad], NaN where the log has none


def tracks_of(rows: Rows, agent: Callable[[int, Int[np.ndarray, " row"]], Agent]) -> Iterator[Track]:
    """One Track per road user; `agent` describes one by its number and its rows.

    Of two rows of the same instant the first counts. Missing headings follow from the motion.
    """
    order = np.lexsort((rows.step, rows.who))
    who = rows.who[order]
    starts = np.flatnonzero(np.diff(who, prepend=who[0] - 1)) if len(who) else np.zeros(0, int)
    if len(starts) > _MOST_AGENTS:
        raise LogError(f"{len(starts)} road users, expected at most {_MOST_AGENTS}")
    for start, end in zip(starts, [*starts[1:], len(who)], strict=True):
        mine = order[start:end]
        mine = mine[np.diff(rows.step[mine], prepend=rows.step[mine[0]] - 1) > 0]
        x, y, yaw = rows.x[mine], rows.y[mine], rows.yaw[mine]
        if np.isnan(yaw).any():
            yaw = heading_from_motion(x, y)
        yield Track(agent(int(who[start]), mine), rows.step[mine], x, y, yaw)


def steps_of(times: Float[np.ndarray, " row"]) -> tuple[Int[np.ndarray, " row"], float, float]:
    """Instants, their distance [s] and the time of the first one [s] of rows with times in seconds.

    The distance is the median gap between the times that occur; a row counts at the nearest instant.
    """
    if not np.isfinite(times).all():
        raise LogError("a time is no number")
    known = np.unique(np.round(times, 4))
    if len(known) < 2:
        raise LogError(f"{len(known)} instants, expected at least 2")
    dt = float(np.round(np.median(np.diff(known)), 4))
    place = (times - known[0]) / max(dt, 1e-4)
    if place.max() > 1e9:
        raise LogError(f"times from {known[0]:g} to {known[-1]:g} s at steps of {dt:g} s, expected one recording")
    step = np.round(place).astype(int)
    if np.median(np.abs(place - step)) > 0.1:
        raise LogError(f"times do not lie on steps of {dt:g} s")
    return step, dt, float(known[0])


def heading_from_motion(
    x: Float[np.ndarray, " sample"], y: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, " sample"]:
    """The direction of the way around each sample, over at least 0.5 m; where one stands, the last one known [rad]."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    last = len(x) - 1
    before = np.clip(np.searchsorted(way, way - 0.5 * _TURNS_M, side="right") - 1, 0, last)
    after = np.clip(np.searchsorted(way, way + 0.5 * _TURNS_M), 0, last)
    dx, dy = x[after] - x[before], y[after] - y[before]
    told = np.flatnonzero(np.hypot(dx, dy) > 0.5 * _TURNS_M)
    if not len(told):
        far = int(np.argmax(np.hypot(x - x[0], y - y[0])))
        return np.full(len(x), np.arctan2(y[far] - y[0], x[far] - x[0]))
    nearest = told[np.clip(np.searchsorted(told, np.arange(len(x)), side="right") - 1, 0, None)]
    return np.asarray(wrap(np.arctan2(dy, dx)[nearest]))
