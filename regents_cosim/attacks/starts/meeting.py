"""A candidate and the ego that it has to meet, and drives that meet it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.geometry.frames import ahead_and_left, wrap
from regents_cosim.scenario.scenario import Scenario, Tracks

_ROUNDING_M = 1e-3


@dataclass(frozen=True, eq=False)
class MeetingDrives:
    """Drives of one candidate that meet the ego, from where it enters, [drive, time]."""

    meets: Int[np.ndarray, " drive"]  # the step of the meeting, counted from its entry
    shows_s: Float[np.ndarray, " drive"]  # when it visibly leaves its lane, counted from its entry
    gentle: Float[np.ndarray, " drive"]  # [m/s^2] magnitude of its acceleration before
    yields: Bool[np.ndarray, " drive"]  # whether its movement through a junction gives way to the ego's
    x: Float[np.ndarray, "drive time"]
    y: Float[np.ndarray, "drive time"]
    yaw: Float[np.ndarray, "drive time"]
    speed: Float[np.ndarray, "drive time"]


@dataclass(frozen=True, eq=False)
class MeetingPair:
    """The candidate and the ego, from the step on at which the candidate is first seen."""

    first: int
    there: Bool[np.ndarray, " time"]  # the candidate's presence in its log
    own: tuple[np.ndarray, ...]  # x, y [m] and yaw [rad] of the ego, [time] each
    mine: tuple[float, float]  # length and width of the candidate [m]
    its: tuple[float, float]  # length and width of the ego [m]

    @classmethod
    def of(cls, scenario: Scenario, agent: int, ego: Tracks) -> "MeetingPair":
        """The pair of `agent` and an ego that drives along `ego` [1, time]."""
        valid, me = scenario.tracks.valid[agent], scenario.agents[agent]
        first = int(np.argmax(valid))
        own = ego.x[0, first:], ego.y[0, first:], ego.yaw[0, first:]
        size = scenario.ego.length, scenario.ego.width
        return cls(first, valid[first:], own, (me.length, me.width), size)

    @property
    def reach_m(self) -> float:
        """The greatest distance of the centres at which the two can touch [m]."""
        return float(0.5 * (np.hypot(*self.mine) + np.hypot(*self.its)) + _ROUNDING_M)

    def touch(
        self, x: np.ndarray, y: np.ndarray, yaw: np.ndarray, may: Bool[np.ndarray, "row time"] | bool = True
    ) -> Bool[np.ndarray, "row time"]:
        """Whether the candidate touches the ego at places [row time], where `may` is true.

        Exact boxes are compared only for places nearby.
        """
        reach = self.reach_m
        hits = np.zeros(np.broadcast_shapes(x.shape, self.there.shape), bool)
        some = np.flatnonzero(_within(x, self.own[0], reach) & _within(y, self.own[1], reach))
        hits[some] = ((x[some] - self.own[0]) ** 2 + (y[some] - self.own[1]) ** 2 < reach**2) & self.there
        hits &= may
        row, step = np.nonzero(hits)
        mx, my, heading = (np.broadcast_to(values, hits.shape)[row, step] for values in (x, y, yaw))
        ex, ey, towards = (values[step] for values in self.own)
        hits[row, step] = overlap(Boxes(mx, my, heading, *self.mine), Boxes(ex, ey, towards, *self.its))
        return hits


def _within(
    values: Float[np.ndarray, "row *time"], own: Float[np.ndarray, " time"], reach: float
) -> Bool[np.ndarray, " row"]:
    """Rows with a value within reach of the ego's range."""
    return ((values > own.min() - reach) & (values < own.max() + reach)).any(axis=1)


def contact_of(drives: MeetingDrives, own: tuple[np.ndarray, ...]) -> Float[np.ndarray, "drive 2"]:
    """Where each drive meets the ego: distance ahead of its centre [m], and angle to its heading [rad]."""
    turn = wrap(drives.yaw[np.arange(len(drives.meets)), drives.meets] - own[2][drives.meets])
    return np.stack([ahead_of_ego(drives, drives.meets, own), turn], axis=1)


def ahead_of_ego(
    drives: MeetingDrives, step: Int[np.ndarray, " drive"], own: tuple[np.ndarray, ...]
) -> Float[np.ndarray, " drive"]:
    """The distance ahead of the ego's centre [m] of each drive, at a step of its own."""
    rows = np.arange(len(step))
    x, y, yaw = (values[step] for values in own)
    return ahead_and_left(np, drives.x[rows, step] - x, drives.y[rows, step] - y, yaw)[0]
