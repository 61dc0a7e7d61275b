"""CommonRoad XML, versions 2018b and 2020a: lanelets, recorded or predicted traffic, a planning problem.

The ego is that of the first planning problem. It has no track of its own, so it gets one that leads along the lanelets
to its goal (`planned_ego`). Positions and times given as shapes or intervals are read as their middle. Obstacles
without a trajectory are left out, with a note: those given as occupancy sets, those with a single instant, phantom and
environment obstacles.
"""

import itertools
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely
from jaxtyping import Int

from regents_cosim.checks.work import Work
from regents_cosim.errors import LogError
from regents_cosim.norms.limits import ASSUMED_LIMIT_M_S
from regents_cosim.plain_text import listed
from regents_cosim.scenario.scenario import Agent, LeftOut
from regents_cosim.sources.logs.files.xml_files import number_of, point_of, read_xml
from regents_cosim.sources.logs.formats import CompanionFiles, LogFormat
from regents_cosim.sources.logs.kinds import kind_named
from regents_cosim.sources.logs.missing_headings import RawTrack, with_headings
from regents_cosim.sources.logs.planned_ego import EgoGoal, EgoStart, planned_track
from regents_cosim.sources.logs.readers.commonroad_shapes import parts_of
from regents_cosim.sources.logs.roads.commonroad_signs import Arm, approaches_of, intersections
from regents_cosim.sources.logs.roads.road import centre_line, lanelet, may_cross, speed_of
from regents_cosim.sources.logs.scene import (
    DEFAULT_SIZES,
    LATEST_STEP,
    LoggedLane,
    LoggedMap,
    LoggedScene,
    LoggedSignal,
    Track,
    with_openings,
)

# Signs of CommonRoad that limit the speed, by country. Their value is in m/s in every country; files that were
# converted from lanelet2 name a unit.
#
# Source: `TrafficSignID...` of commonroad-io 2024.3, MAX_SPEED and MAX_SPEED_ZONE_START. As in that library, an
# unknown country counts as Zamunda, and 274 is a limit in every country. The library writes Greece's letter as a
# Greek rho; files also write it as a P.
_EVERYWHERE = "274"
_ZONES = ("274.1",)
_LIMITS: dict[str, tuple[str, ...]] = {
    "ZAM": _ZONES, "DEU": _ZONES, "CHN": (), "ITA": (), "USA": ("R2-1",), "PRI": ("R2-1",), "ESP": ("r301",),
    "RUS": ("3.24",), "ARG": ("R15",), "BEL": ("C43",), "FRA": ("B14",),
    "GRC": ("\N{GREEK CAPITAL LETTER RHO}-32", "P-32"),
    "HRV": ("B31",), "AUS": (),
}  # fmt: skip


def country_of(benchmark: str) -> str:
    """The country in a benchmark's id: three letters, after `C-` for cooperative problems."""
    return benchmark.removeprefix("C-")[:3]


def limit_of(sign: ET.Element, country: str) -> float | None:
    """The speed limit of a sign of a country [m/s], the lowest where it has several; None where it limits none."""
    known = (_EVERYWHERE, *_LIMITS.get(country, _ZONES))
    parts = [
        part for part in sign.iter("trafficSignElement") if (part.findtext("trafficSignID") or "").strip() in known
    ]
    values = [speed_of(value.text or "", 1.0) for part in parts for value in part.findall("additionalValue")[:1]]
    return min((value for value in values if 0 < value < 100), default=None)


_LETTERS = {"red": "r", "redYellow": "u", "yellow": "y", "green": "g", "inactive": "O"}
_UNSEEN = {
    "phantomObstacle": "a phantom",
    "environmentObstacle": "no road user, such as a building",
}  # why they are left out
_OBSTACLES = ("dynamicObstacle", "obstacle", "staticObstacle", *_UNSEEN)
_NAMED = 5  # the most names that a message lists
_OFF_ROAD_TYPES = {"sidewalk", "bicycleLane", "border"}
_CRAWL_MPS = 0.5  # below this speed, a velocity does not tell the heading
_BRIDGED = 100  # over gaps of up to this many steps without moving obstacles, static ones stay


def read(path: Path, beside: CompanionFiles) -> Iterator[LoggedScene]:
    """Read the one scenario of a file."""
    root = read_xml(path, "commonRoad")
    version = root.get("commonRoadVersion", "")
    if not version.startswith("20"):
        raise LogError(f"{path}: CommonRoad version {version[:20]!r}, expected 2018b or 2020a")
    dt = number_of(root.get("timeStepSize"))
    if dt <= 0.0:
        raise LogError(f"{path}: a timeStepSize of {dt:g} s, expected more than 0")
    road = _road(root)
    last = max((round(_value(time) or 0.0) for time in root.iterfind("*/trajectory/state/time")), default=0)
    ego, target = _ego(root, road.lanes, dt, last)
    tracks, notes, left_out = _obstacles(root, road, ego, Work.of(path))
    notes += _problems(root, ego is not None)
    if ego is not None:
        tracks.append(ego)
        notes.append("the ego's track follows lanelets from its start to its goal; it was not driven")
    yield LoggedScene(
        name=root.get("benchmarkID", path.stem),
        dt=dt,
        tracks=tuple(tracks),
        road=road,
        ego=ego.agent.id if ego else None,
        target=target,
        signals=_signals(root),
        notes=tuple(notes),
        left_out=left_out,
    )


def _value(element: ET.Element | None) -> float | None:
    """An exact value, or the middle of an interval; None where absent."""
    ends = _interval(element)
    return None if ends is None else 0.5 * (ends[0] + ends[1])


def _interval(element: ET.Element | None) -> tuple[float, float] | None:
    """Both ends of an interval, which are equal for an exact value; None where absent."""
    for first, last in (("exact", "exact"), ("intervalStart", "intervalEnd")):
        if element is not None and element.find(first) is not None:
            return number_of(element.findtext(first)), number_of(element.findtext(last))
    return None


# --- map --------------------------------------------------------------------------------------


def _road(root: ET.Element) -> LoggedMap:
    country = country_of(root.get("benchmarkID", ""))
    limits = {sign.get("id", ""): limit_of(sign, country) for sign in root.iter("trafficSign")}
    crossed, told = _crossed(root), approaches_of(root, country)
    inside = set().union(*(arm.inside for arms in intersections(root) for arm in arms))
    lanes, areas, crossings = [], [], []
    for element in root.findall("lanelet"):
        points = ([point_of(one) for one in element.findall(f"{side}Bound/point")] for side in ("left", "right"))
        left, right = (np.array(bound, float).reshape(-1, 2) for bound in points)
        types = {one.text for one in element.findall("laneletType")}
        area = lanelet(left, right) if len(left) > 1 and len(right) > 1 else None
        if area is None:
            continue
        if "crosswalk" in types:
            crossings.append(area)
        elif not types & _OFF_ROAD_TYPES:
            areas.append(area)
            lane = _lane(element, left, right, limits, crossed)
            junction = "intersection" in types or lane.id in inside
            lanes.append(replace(lane, approach=told.get(lane.id), junction=junction))
    return LoggedMap(with_openings(tuple(lanes)), (), tuple(areas), tuple(crossings) or None)


def _crossed(root: ET.Element) -> set[tuple[str, str]]:
    """Pairs of adjacent lanelets between which a lane change is allowed; the marking on either side decides."""
    marks = {
        (lane.get("id", ""), side): lane.findtext(f"{side}Bound/lineMarking", "")
        for lane in root.findall("lanelet")
        for side in ("left", "right")
    }
    found = set()
    for lane in root.findall("lanelet"):
        for side, back in (("left", "right"), ("right", "left")):
            for ref in lane.findall(f"adjacent{side.title()}"):
                pair = lane.get("id", ""), ref.get("ref", "")
                lines = (marks[pair[0], side], marks.get((pair[1], back), ""))
                if ref.get("drivingDir") == "same" and all(may_cross(line, side == "left") for line in lines):
                    found.add(pair)
    return found


def _lane(
    element: ET.Element, left: np.ndarray, right: np.ndarray, limits: dict[str, float | None],
    crossed: set[tuple[str, str]],
) -> LoggedLane:  # fmt: skip
    centre, width = centre_line(left, right)
    signs = [limits.get(ref.get("ref", "")) for ref in element.iter("trafficSignRef")]
    known = [limit for limit in signs if limit]
    old = element.findtext("speedLimit")
    beside = {
        side: ref.get("ref")
        for side in ("adjacentLeft", "adjacentRight")
        for ref in element.findall(side)
        if (element.get("id", ""), ref.get("ref")) in crossed
    }
    return LoggedLane(
        id=element.get("id", ""),
        centre=centre,
        width=width,
        speed_limit=min(known) if known else (number_of(old) if old else ASSUMED_LIMIT_M_S),
        exits=tuple(ref.get("ref", "") for ref in element.findall("successor")),
        left=beside.get("adjacentLeft"),
        right=beside.get("adjacentRight"),
    )


def _signals(root: ET.Element) -> tuple[LoggedSignal, ...]:
    """The lights: at the end of the lanelets that name them, or at the start of those that they hold up from there."""
    stands_at: dict[str, list[str]] = {}
    for element in root.findall("lanelet"):
        for ref in element.findall("trafficLightRef"):
            stands_at.setdefault(ref.get("ref", ""), []).append(element.get("id", ""))
    arms: dict[str, list[Arm]] = {}  # by the lanelets that lead in
    for arm in (arm for arms in intersections(root) for arm in arms):
        for name in arm.leading_in:
            arms.setdefault(name, []).append(arm)
    found = []
    for light in root.iter("trafficLight"):
        name = light.get("id", "")
        if name in stands_at and (cycle := _cycle(light)) is not None:
            letters, ends, offset = cycle
            held = _held(light.findtext("direction", "all").lower(), stands_at[name], arms)
            found.append(LoggedSignal(name, letters, held or tuple(stands_at[name]), bool(held), ends, offset))
    return tuple(found)


def _held(directions: str, lanelets: list[str], arms: dict[str, list[Arm]]) -> tuple[str, ...]:
    """The lanelets through an intersection that a light for some `directions`, such as leftStraight, holds up."""
    after = (arm for lanelet in lanelets for arm in arms.get(lanelet, ()))
    return tuple(sorted({name for arm in after for way in arm.onward if way in directions for name in arm.onward[way]}))


def _cycle(light: ET.Element) -> tuple[str, tuple[int, ...], int] | None:
    """A cyclic light: its letters, the steps at which each letter ends, and the step at which the cycle begins."""
    parts = [(int(number_of(e.findtext("duration"))), e.findtext("color", "")) for e in light.iter("cycleElement")]
    if not parts or min(duration for duration, _ in parts) < 1 or light.findtext("active") == "false":
        return None
    ends = tuple(itertools.accumulate(duration for duration, _ in parts))
    offset = int(number_of(light.findtext("cycle/timeOffset") or "0"))
    if max(ends[-1], abs(offset)) > LATEST_STEP:
        raise ValueError(f"a light with a cycle of {ends[-1]:.3g} steps from step {offset:.3g} on")
    return "".join(_LETTERS.get(color, "O") for _, color in parts), ends, offset


# --- traffic ----------------------------------------------------------------------------------


def _obstacles(
    root: ET.Element, road: LoggedMap, ego: Track | None, work: Work
) -> tuple[list[Track], list[str], tuple[LeftOut, ...]]:
    """The tracks, notes on what had to be assumed, and the obstacles without a track.

    Those that stand are there whenever another or the `ego` moves.
    """
    found, without = list[tuple[ET.Element, RawTrack]](), dict[str, list[str]]()
    for element in (one for one in root if one.tag in _OBSTACLES):
        way = _unfaced(element)
        why = _why_not(element, way)
        if why:
            without.setdefault(why, []).append(element.get("id", ""))
        elif way is not None:
            found.append((element, way))
    tracks = with_headings((way for _, way in found), road)
    boxes = list[tuple[ET.Element, Track]]()
    odd, unsized = 0, 0
    for (element, way), track in zip(found, tracks, strict=True):
        parts = parts_of(element.find("shape"))
        odd, unsized = odd + any(not part.filled for part in parts), unsized + (not parts)
        names = [f"{way.agent.id}.{i}" if len(parts) > 1 else way.agent.id for i in range(1, len(parts) + 1)]
        boxes += [(element, part.of(track, name, way.agent.kind)) for name, part in zip(names, parts, strict=True)]
        boxes += [] if parts else [(element, track)]
    moving, standing = ([track for element, track in boxes if _stands(element) == still] for still in (False, True))
    there = _instants([*moving, *([] if ego is None else [ego])])
    work.spend("obstacles that stand x instants", len(standing), len(there))
    left_out = tuple(LeftOut("unsupported", len(ids), tuple(sorted(ids)), why) for why, ids in without.items())
    notes = [
        f"left out: obstacle{'s' * (len(one.ids) > 1)} {listed(one.ids, _NAMED)} ({one.detail})" for one in left_out
    ]
    vague = sum(any(place.find("point") is None for place in one.iter("position")) for one, _ in found)
    notes += [f"{vague} obstacles whose positions are areas: the middle is taken"] * (vague > 0)
    notes += [f"{odd} obstacles are no boxes: the smallest box around each stands for it"] * (odd > 0)
    notes += [f"{unsized} obstacles without a size: that of their kind is taken"] * (unsized > 0)
    return [*moving, *(_standing(track, there) for track in standing)], notes, left_out


def _stands(element: ET.Element) -> bool:
    return element.tag == "staticObstacle" or element.findtext("role") == "static"


def _why_not(element: ET.Element, way: RawTrack | None) -> str | None:
    """The reason why an obstacle has no track, in words; None where it has one."""
    if element.tag in _UNSEEN:
        return _UNSEEN[element.tag]
    moves = element.find("trajectory/state") is not None
    if element.find("occupancySet") is not None and not moves:
        return "known by sets alone"
    if way is None:
        return "without positions"
    return None if _stands(element) or moves else "known at one instant alone"


def _instants(moving: list[Track]) -> Int[np.ndarray, " instant"]:
    """The instants at which a road user moves, from the first of the file on; longer pauses are left out."""
    known = np.unique(np.concatenate([[0], *(track.step for track in moving)]))
    breaks = np.flatnonzero(np.diff(known) > _BRIDGED)
    firsts, lasts = known[[0, *(breaks + 1)]], known[[*breaks, -1]]
    return np.concatenate([np.arange(first, last + 1) for first, last in zip(firsts, lasts, strict=True)])


def _standing(track: Track, there: Int[np.ndarray, " instant"]) -> Track:
    """A static obstacle, present at every instant."""
    x, y, yaw = (np.full(len(there), float(values[0])) for values in (track.x, track.y, track.yaw))
    return replace(track, step=there, x=x, y=y, yaw=yaw)


def _unfaced(element: ET.Element) -> RawTrack | None:
    states = [_state(state) for state in [*element.findall("initialState"), *element.findall("trajectory/state")]]
    rows = {round(state[0]): state[1:] for state in states if state is not None}
    if not rows:
        return None
    step = np.array(sorted(rows))
    x, y, yaw = np.array([rows[one] for one in step.tolist()], float).T
    kind = kind_named(element.findtext("type", ""))
    return RawTrack(Agent(element.get("id", ""), kind, *DEFAULT_SIZES[kind]), step, x, y, yaw)


def _state(state: ET.Element) -> tuple[float, float, float, float] | None:
    time, place = _value(state.find("time")), _place(state.find("position"))
    if time is None or place is None:
        return None
    return time, *place, _yaw(state)


def _yaw(state: ET.Element) -> float:
    """The yaw [rad]: the orientation, or for a point mass the direction of its velocity; NaN where neither is known."""
    yaw, sideways = _value(state.find("orientation")), _value(state.find("velocityY"))
    if yaw is None and sideways is not None:
        velocity = complex(_value(state.find("velocity")) or 0.0, sideways)
        yaw = float(np.angle(velocity)) if abs(velocity) > _CRAWL_MPS else None
    return np.nan if yaw is None else yaw


def _place(position: ET.Element | None) -> tuple[float, float] | None:
    """The middle of a point, rectangle, circle or polygon; None for a set of lanelets."""
    if position is None:
        return None
    if (point := position.find("point")) is not None:
        return point_of(point)
    for shape in ("rectangle", "circle"):
        if (centre := position.find(f"{shape}/center")) is not None:
            return point_of(centre)
    corners = [point_of(one) for one in position.findall("polygon/point")]
    middle = shapely.Polygon(corners).centroid if len(corners) > 2 else shapely.MultiPoint(corners).centroid
    return (middle.x, middle.y) if corners else None


# --- ego --------------------------------------------------------------------------------------


def _ego(
    root: ET.Element, lanes: tuple[LoggedLane, ...], dt: float, last: int
) -> tuple[Track | None, tuple[float, float] | None]:
    problem = next((one for one in root.findall("planningProblem") if one.find("goalState") is not None), None)
    if problem is None:
        return None, None
    begin, goal = problem.find("initialState"), problem.find("goalState")
    state = None if begin is None else _state(begin)
    if begin is None or goal is None or state is None:
        raise ValueError("a planning problem without start or goal")
    first = round(state[0])
    here = RawTrack(Agent("ego", "car", *DEFAULT_SIZES["car"]), np.array([first]), *np.array(state[1:]).reshape(3, 1))
    (yaw,) = with_headings([here], LoggedMap(lanes))[0].yaw.tolist()
    start = EgoStart(state[1], state[2], yaw, _value(begin.find("velocity")) or 0.0)
    place = _goal_place(goal, lanes)
    when = [dt * (time - first) for time in _interval(goal.find("time")) or (last, last)]
    aim = EgoGoal(place, _value(goal.find("orientation")), *(max(time, dt) for time in when))
    x, y, yaw = planned_track(start, aim, lanes, dt)
    step = first + np.arange(len(x))
    name = f"ego_{problem.get('id', '')}"
    return Track(Agent(name, "car", *DEFAULT_SIZES["car"]), step, x, y, yaw), place or (float(x[-1]), float(y[-1]))


def _problems(root: ET.Element, solved: bool) -> list[str]:
    """Notes on planning problems: on those besides the ego's, and on those without a route to the goal."""
    problems = root.findall("planningProblem")
    names = [one.get("id", "") for one in problems]
    if names and not solved:
        return [f"planning problem {names[0]} has no goal and is left out; the ego is drawn from the traffic"]
    most = max((len(one.findall("goalState")) for one in problems), default=0)
    several = [f"a planning problem with {most} goals: the ego drives to the first"] * (most > 1)
    if len(names) < 2:
        return several
    own = next(one.get("id", "") for one in problems if one.find("goalState") is not None)
    others = ", ".join(name for name in names if name != own)
    return [*several, f"{len(names)} planning problems: the ego is that of {own}; left out: {others}"]


def _goal_place(goal: ET.Element, lanes: tuple[LoggedLane, ...]) -> tuple[float, float] | None:
    position = goal.find("position")
    place = _place(position)
    if place is not None or position is None:
        return place
    by_name = {lane.id: lane for lane in lanes}
    for ref in position.findall("lanelet"):
        if (lane := by_name.get(ref.get("ref", ""))) is not None:
            middle = shapely.LineString(lane.centre).interpolate(0.5, normalized=True)
            return middle.x, middle.y
    return None


FORMAT = LogFormat("commonroad", "CommonRoad XML", lambda path, head: b"<commonRoad" in head, read)
