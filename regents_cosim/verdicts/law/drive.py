"""The drive of one road user up to an instant: its steps, and its place in the lanes at each of them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from regents_cosim.geometry.boxes import Boxes
from regents_cosim.geometry.frames import ahead_and_left, wrap
from regents_cosim.geometry.lines import distances_along, steps_along
from regents_cosim.maps.roadmap import Connection, Lane, RoadMap
from regents_cosim.maps.walkways import Walkway
from regents_cosim.norms.limits import ALONG_RAD
from regents_cosim.routes.lane_matching import match_lanes
from regents_cosim.scenario.scenario import RED, Scenario, Tracks
from regents_cosim.verdicts.law.lane_pieces import LanesUnder, lane_lines, lane_pieces
from regents_cosim.verdicts.law.lawful_ways import lawful_lanes
from regents_cosim.verdicts.law.oncoming import oncoming_share

_ROUNDING = 1e-6  # share of a spacing
_MATCH_SPACING_M = 0.5  # of the points by which lanes are matched, so a standing vehicle adds none

_AT_END_M = 1.0


class OffendingAct(NamedTuple):
    """What a measure of a drive found: an act that may be an offence."""

    step: int  # when it began
    steps: int
    amount: float


@dataclass(frozen=True, eq=False)
class AgentDrive:
    """The drive of one agent along `tracks`, at the steps up to `last` at which it is present."""

    scenario: Scenario
    agent: int
    tracks: Tracks
    last: int  # step
    since: int = 0  # acts before this step do not count

    @cached_property
    def steps(self) -> Int[np.ndarray, " time"]:
        """The steps at which it is present."""
        return np.flatnonzero(self.tracks.valid[self.agent, : self.last + 1])

    @property
    def on_foot(self) -> bool:
        """Whether it is a pedestrian."""
        return self.scenario.agents[self.agent].kind == "pedestrian"

    @cached_property
    def box(self) -> Boxes:
        """Its body at each step."""
        return _bodies(self.tracks, self.agent, self.steps, self._size)

    @property
    def _size(self) -> tuple[float, float]:
        """Length and width [m]."""
        one = self.scenario.agents[self.agent]
        return one.length, one.width

    @cached_property
    def centre(self) -> Float[np.ndarray, "time 2"]:
        """Positions of its centre [m]."""
        return np.stack([self.box.x, self.box.y], axis=-1)

    @cached_property
    def front(self) -> Float[np.ndarray, "time 2"]:
        """The middle of its front [m]."""
        yaw, half = np.asarray(self.box.yaw), 0.5 * self.scenario.agents[self.agent].length
        return self.centre + half * np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)

    @cached_property
    def yaw(self) -> Float[np.ndarray, " time"]:
        """Headings [rad]."""
        return self.tracks.yaw[self.agent, self.steps]

    @cached_property
    def speed(self) -> Float[np.ndarray, " time"]:
        """Speeds [m/s]."""
        return self.tracks.speed[self.agent, self.steps]

    @cached_property
    def moved_m(self) -> Float[np.ndarray, " time"]:
        """Distances from the previous step [m]."""
        return np.concatenate([[0.0], steps_along(*self.centre.T)])

    @cached_property
    def front_lanes(self) -> list[Lane | None]:
        """The lane under its front at every step; at a standstill the lane from before."""
        way = distances_along(*self.front.T)
        chosen = np.flatnonzero(np.diff(np.floor(way / _MATCH_SPACING_M + _ROUNDING), prepend=-1.0) > 0)
        if len(chosen) < 2:
            return [None] * len(way)
        z = np.asarray(self.box.z)[chosen]
        matched = match_lanes(self.scenario.road, self.front[chosen], z)
        return [matched[i] for i in np.searchsorted(chosen, np.arange(len(way)), side="right") - 1]

    @cached_property
    def entered(self) -> list[tuple[int, Lane, Lane]]:
        """(step, lane before, lane after) wherever its front passed from one lane into another."""
        moves = enumerate(pairwise(self.front_lanes), start=1)
        return [
            (int(self.steps[i]), before, after)
            for i, (before, after) in moves
            if before is not None and after is not None and before is not after
        ]

    @cached_property
    def passed_ends(self) -> list[tuple[int, Lane]]:
        """(step, lane) wherever its front passed the end of a lane and came onto none."""
        lines, moves = lane_lines(self.scenario.road), enumerate(pairwise(self.front_lanes), start=1)
        return [
            (int(self.steps[i]), before)
            for i, (before, after) in moves
            if before is not None and after is None and _is_past(lines[before.id], self.front[i])
        ]

    @cached_property
    def lawful(self) -> frozenset[str] | None:
        """The ids of the lanes that it may use from where it was first seen; None where unknown."""
        lanes = lawful_lanes(self.scenario, self.agent)
        return None if lanes is None else frozenset(lane.id for lane in lanes)

    @cached_property
    def oncoming_share(self) -> Float[np.ndarray, " time"]:
        """The share of its body on lanes that run only the other way."""
        return _oncoming_share(self.scenario.road, self.tracks, self.agent, self._size, self.last, self.lawful)

    @cached_property
    def under(self) -> LanesUnder:
        """The lanes under its centre."""
        return lane_pieces(self.scenario.road).under(self.centre, np.asarray(self.box.z))

    @cached_property
    def own(self) -> LanesUnder:
        """The lanes under its centre that run in its direction."""
        return self.under.take(np.abs(wrap(self.under.heading - self.yaw[self.under.point])) < ALONG_RAD)

    def longest(self, holds: Bool[np.ndarray, " time"]) -> tuple[int, int]:
        """Begin and end (excluded) of the longest run in which a condition holds; (0, 0) where it never does."""
        counts = holds & (self.steps >= self.since)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], counts, [False]]).astype(int)))
        begin, end = edges[::2], edges[1::2]
        if not len(begin):
            return 0, 0
        which = int(np.argmax(end - begin))
        return int(begin[which]), int(end[which])

    def lasting(
        self, holds: Bool[np.ndarray, " time"], amount: Float[np.ndarray, " time"], steps: int
    ) -> OffendingAct | None:
        """The longest run in which `holds` is true, with its greatest amount; None if it is shorter than `steps`."""
        begin, end = self.longest(holds)
        if not end or end - begin < steps:
            return None
        return OffendingAct(int(self.steps[begin]), end - begin, float(amount[begin:end].max()))


def _is_past(line: shapely.LineString, place: Float[np.ndarray, " 2"]) -> bool:
    return line.project(shapely.Point(place)) >= line.length - _AT_END_M


def _bodies(tracks: Tracks, agent: int, steps: Int[np.ndarray, " time"], size: tuple[float, float]) -> Boxes:
    own = agent, steps
    return Boxes(tracks.x[own], tracks.y[own], tracks.yaw[own], *size, tracks.z[own])


@lru_cache(maxsize=16)  # the law, the fault and the tags of one crash all ask for it
def _oncoming_share(
    road: RoadMap, tracks: Tracks, agent: int, size: tuple[float, float], last: int, lawful: frozenset[str] | None
) -> Float[np.ndarray, " time"]:
    steps = np.flatnonzero(tracks.valid[agent, : last + 1])
    return oncoming_share(road, _bodies(tracks, agent, steps, size), lawful)


# measures a drive, given that of the other agent in the crash; None: nothing found
Measure = Callable[[AgentDrive, AgentDrive | None], OffendingAct | None]


def agent_drive(attacked: Scenario, agent: int, last: int, since: int = 0) -> AgentDrive:
    """The drive of an agent in an attacked case up to step `last`; acts before `since` do not count."""
    return AgentDrive(attacked, agent, attacked.tracks, last, since)


def logged(attacked: Scenario, agent: int) -> AgentDrive:
    """The drive of an agent in its log, up to the end."""
    tracks = attacked.recorded_tracks
    return AgentDrive(attacked, agent, tracks, tracks.steps - 1)


def red_for_s(scenario: Scenario, way: Connection | Walkway, step: int) -> float:
    """How long [s] the light of a way had been red at a step at which it was."""
    since = step
    while since > 0 and scenario.shows(way.signal, way.link, since - 1) in RED:
        since -= 1
    return (step - since + 1) * scenario.dt


def together_since(tracks: Tracks, agents: tuple[int, int], last: int) -> int:
    """The first of the steps up to `last`, at which both agents are present, since when neither was absent."""
    absent = np.flatnonzero(~tracks.valid[list(agents), : last + 1].all(axis=0))
    return int(absent[-1]) + 1 if len(absent) else 0


def gaps(attacked: Scenario, follower: int, leader: int, step: int) -> tuple[float, float]:
    """Gaps [m] bumper to bumper along the follower's heading, and side to side; negative where they overlap."""
    tracks, agents = attacked.tracks, attacked.agents
    dx, dy = (float(v[leader, step] - v[follower, step]) for v in (tracks.x, tracks.y))
    yaw = float(tracks.yaw[follower, step])
    ahead, left = ahead_and_left(np, dx, dy, yaw)
    turn = float(wrap(tracks.yaw[leader, step] - yaw))
    cos, sin = abs(np.cos(turn)), abs(np.sin(turn))
    one, two = agents[follower], agents[leader]
    along = 0.5 * (one.length + two.length * cos + two.width * sin)
    across = 0.5 * (one.width + two.length * sin + two.width * cos)
    return ahead - along, abs(left) - across
