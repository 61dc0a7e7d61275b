"""Who gives way of two whose ways meet on a map without a table of priorities: by lights, signs, and where they turn.

Sources, besides those of `routes.give_way`: Vienna Convention on Road Traffic (1968), art. 11 and 14 (a change of
lanes endangers no one); Uniform Vehicle Code (2000), 11-401 and 11-403 (all-way stops: the first to come, then the one
on the right) and 11-404 (who enters the road from another place than a road). None of them tells who goes first of two
that cross without any sign where none is known to be missing.
"""

from collections.abc import Sequence
from functools import lru_cache
from itertools import groupby
from typing import Literal, NamedTuple

import numpy as np
import shapely

from regents_cosim.geometry.frames import ahead_and_left, wrap
from regents_cosim.geometry.lines import heading_near
from regents_cosim.maps.roadmap import Approach, Lane, RoadMap
from regents_cosim.norms.limits import ALONG_RAD
from regents_cosim.routes.give_way import (
    TURNED_RAD,
    Waiting,
    WayIn,
    first_if,
    meeting_kind,
    turns_across,
    waits_by_signs,
    waits_for_right,
)
from regents_cosim.scenario.scenario import RED, Scenario
from regents_cosim.verdicts.law.drive import AgentDrive
from regents_cosim.verdicts.law.lane_pieces import lane_lines, lane_pieces

LATELY_S = 6.0  # an agent that entered the junction longer ago no longer had to wait
_BESIDE_M = 1.5  # so far to the side of another a driver is not in its lane
_AT_ONCE_S = 1.0
_OFF_LANES_M = 1.0  # so far beside all lanes a place is not on the road
_ROLLED_M_S = 3.0  # who passes a sign to stop faster did not stop
_BRAKED_S = 3.0  # before the line
_SHOWN = frozenset(f"gGyY{RED}")  # letters of a light that is on

Yielding = Waiting | Literal["neither"]


class Arrival(NamedTuple):
    """How one of two came to where their ways meet."""

    step: int  # at which it entered the junction
    way: WayIn
    letter: str = "-"  # of its light then
    slowest: float = 0.0  # [m/s] in the last seconds before


def who_yields(one: AgentDrive, two: AgentDrive) -> tuple[Yielding | None, Arrival, Arrival]:
    """Which of two has to give way, and how each arrived; None: not known."""
    mine, theirs = _by_lanes(one, two) or _by_headings(one, two)
    beside = [_begins_beside_road(drive) for drive in (one, two)]
    if None not in beside and beside[0] != beside[1]:
        return first_if(bool(beside[0])), mine, theirs
    if abs(float(wrap(np.asarray(theirs.way.came_rad - mine.way.came_rad)))) < ALONG_RAD:
        return _alongside(one, two, mine, theirs), mine, theirs
    return _crossing(mine, theirs, one.scenario.dt), mine, theirs


def _crossing(mine: Arrival, theirs: Arrival, dt: float) -> Yielding | None:
    lit = [one.letter in _SHOWN for one in (mine, theirs)]
    if any(lit):
        red = [one.letter in RED for one in (mine, theirs)]
        return first_if(red[0]) if all(lit) and red[0] != red[1] else turns_across(mine.way, theirs.way)
    if mine.way.sign == theirs.way.sign == "stops":
        return _all_stop(mine, theirs, dt)
    return waits_by_signs(mine.way, theirs.way)


def _all_stop(mine: Arrival, theirs: Arrival, dt: float) -> Yielding | None:
    """Who did not stop should have; else the first to come goes first."""
    ran = mine.slowest > _ROLLED_M_S, theirs.slowest > _ROLLED_M_S
    if ran[0] != ran[1]:
        return first_if(ran[0])
    if abs(mine.step - theirs.step) * dt > _AT_ONCE_S:
        return first_if(mine.step > theirs.step)
    return turns_across(mine.way, theirs.way) or waits_for_right(mine.way, theirs.way)


def _begins_beside_road(drive: AgentDrive) -> bool | None:
    """Whether it came in the last seconds from beside all lanes; None: not known, for cyclists and where it left them.

    Maps of logs leave out the lanes of cyclists.
    """
    if drive.scenario.agents[drive.agent].kind == "bicycle":
        return None
    lately = drive.steps >= drive.last - LATELY_S / drive.scenario.dt
    places, z = drive.centre[lately], np.asarray(drive.box.z)[lately]
    at = lane_pieces(drive.scenario.road).under(places, z, _OFF_LANES_M)
    on = np.bincount(at.point, minlength=int(lately.sum())) > 0
    return None if on[0] and not on.all() else not on[0]


def _alongside(one: AgentDrive, two: AgentDrive, mine: Arrival, theirs: Arrival) -> Yielding | None:
    """Of two that come from the same side, the one that turns across the lane beside its own; followers keep behind."""
    begun = _together(one, two)[0]
    tracks, agents = one.tracks, [one.agent, two.agent]
    dx, dy = (float(v[agents[1], begun] - v[agents[0], begun]) for v in (tracks.x, tracks.y))
    if abs(ahead_and_left(np, dx, dy, float(tracks.yaw[agents[0], begun]))[1]) < _BESIDE_M:
        return "neither"
    more = abs(mine.way.turned_rad) - abs(theirs.way.turned_rad)
    return None if abs(more) <= TURNED_RAD else first_if(more > 0.0)


# --- how they came -----------------------------------------------------------------------------------


def _together(one: AgentDrive, two: AgentDrive) -> np.ndarray:
    """The steps of the last seconds at which both are present."""
    both = np.intersect1d(one.steps, two.steps)
    return both[both >= one.last - LATELY_S / one.scenario.dt]


def _by_headings(one: AgentDrive, two: AgentDrive) -> tuple[Arrival, Arrival]:
    """Their arrivals where no lanes show that their ways meet."""
    steps = _together(one, two)
    return _of_heading(one, steps), _of_heading(two, steps)


def _of_heading(drive: AgentDrive, steps: np.ndarray) -> Arrival:
    yaw = np.unwrap(drive.tracks.yaw[drive.agent, steps])
    way = _taken(drive)
    told: list[tuple[int, Approach]] = [(i, lane.approach) for i, (_, lane) in enumerate(way) if lane.approach]
    index, sign = told[-1] if told else (-1, None)
    step = way[index + 1][0] if told and index + 1 < len(way) else int(steps[0])
    begin = float(drive.tracks.x[drive.agent, steps[0]]), float(drive.tracks.y[drive.agent, steps[0]])
    way_in = WayIn(float(yaw[0]), float(yaw[-1] - yaw[0]), begin, sign)
    return Arrival(step, way_in, _letter_left(drive), _slowest(drive, step))


def _letter_left(drive: AgentDrive) -> str:
    """What all lights at the end of the lane show behind which its front is on none; "-" where they differ."""
    scenario, ends = drive.scenario, drive.passed_ends[-1:]
    links = [(step, link) for step, lane in ends for link in scenario.road.exits[lane.id]]
    shown = {scenario.shows(link.signal, link.link, step) for step, link in links}
    return next(iter(shown)) if len(shown) == 1 else "-"


def _by_lanes(one: AgentDrive, two: AgentDrive) -> tuple[Arrival, Arrival] | None:
    """Their arrivals at the lanes, of those that they took lately, that meet nearest to where they are at the end."""
    road, ways = one.scenario.road, [_taken(drive) for drive in (one, two)]
    lines, place = lane_lines(road), shapely.Point(one.centre[-1])
    met = [
        (max(lines[lane.id].distance(place) for lane in (ways[0][i][1], ways[1][k][1])), i, k)
        for i in range(len(ways[0]))
        for k in range(len(ways[1]))
        if ways[1][k][1].id in met_by(road, ways[0][i][1].id)
    ]
    if not met:
        return None
    _, i, k = min(met)
    return _arrival(one, ways[0], i), _arrival(two, ways[1], k)


def _taken(drive: AgentDrive) -> list[tuple[int, Lane]]:
    """The lanes that its front took up to the last one, each with the step at which it did."""
    pairs = zip(drive.steps.tolist(), drive.front_lanes, strict=True)
    runs = [(lane, next(run)[0], drive.last) for lane, run in groupby(pairs, key=lambda pair: pair[1])]
    since = drive.last - LATELY_S / drive.scenario.dt
    left = [step for _, step, _ in runs[1:]] + [drive.last + 1]
    return [(step, lane) for (lane, step, _), end in zip(runs, left, strict=True) if lane is not None and end > since]


def _arrival(drive: AgentDrive, way: list[tuple[int, Lane]], index: int) -> Arrival:
    """The arrival at a lane of those taken: where the lanes begin that meet others, and what stands before them."""
    road = drive.scenario.road
    first = index
    while first and way[first - 1][1].approach is None and met_by(road, way[first - 1][1].id):
        first -= 1
    step, lane = way[first]
    lines = lane_lines(road)
    entered, leaves = lines[lane.id], lines[way[index][1].id]
    came, left = (heading_near(one, shapely.Point(one.coords[at])) for one, at in ((entered, 0), (leaves, -1)))
    sign: Approach | None = next((one.approach for _, one in way[max(first - 1, 0) : index + 1] if one.approach), None)
    before = [way[first - 1][1]] if first else [road.lane[link.source] for link in road.entries[lane.id]]
    if sign is None and len({one.approach for one in before}) == 1:
        sign = before[0].approach
    letter = letter_into(drive.scenario, lane, before, step)
    begin = float(lane.centre[0, 0]), float(lane.centre[0, 1])
    way_in = WayIn(came, float(wrap(left - came)), begin, sign)
    return Arrival(step, way_in, letter, _slowest(drive, step))


def _slowest(drive: AgentDrive, step: int) -> float:
    lately = (drive.steps <= step) & (drive.steps > step - _BRAKED_S / drive.scenario.dt)
    return float(drive.speed[lately].min(initial=np.inf))


def letter_into(scenario: Scenario, lane: Lane, before: Sequence[Lane], step: int) -> str:
    """What the light shows at a step to one who comes from one of the lanes before into a lane; "-" without a light."""
    links = (link for one in before for link in scenario.road.exits[one.id] if link.target == lane.id)
    shown = (scenario.shows(link.signal, link.link, step) for link in links)
    return next((letter for letter in shown if letter != "-"), "-")


@lru_cache(maxsize=4096)
def met_by(road: RoadMap, name: str) -> frozenset[str]:
    """The ids of the lanes that cross a lane or end where it ends."""
    lane = road.lane[name]
    near = road.centre_lines.query(lane_lines(road)[name].buffer(0.5 * lane.width), predicate="intersects")
    others = (road.lanes[index] for index in near.tolist())
    return frozenset(one.id for one in others if one.id != name and meeting_kind(road, lane, one))
