"""CommonRoad XML, versions 2018b and 2020a: lanelets, recorded or predicted traffic, a planning problem.

The ego is that of the first planning problem. It has no track of its own, so it gets one that
leads along the lanelets to its goal (`planned_ego`). Positions and times given as shapes or
intervals are taken at their middle; obstacles known by sets alone are left out, and said so.
"""

import itertools
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from regents_cosim.checks.work import Work
from regents_cosim.errors import LogError
from regents_cosim.scenario import Agent, Kind
from regents_cosim.sources.logs.facing import Unfaced, faced
from regents_cosim.sources.logs.formats import CompanionFiles, LogFormat
from regents_cosim.sources.logs.planned_ego import EgoGoal, EgoStart, planned_track
from regents_cosim.sources.logs.road import lanelet
from regents_cosim.sources.logs.scene import (
    DEFAULT_SIZES,
    LATEST_STEP,
    LoggedLane,
    LoggedMap,
    LoggedScene,
    LoggedSignal,
    Track,
    sized,
    with_openings,
)
from regents_cosim.sources.logs.xml_files import read_xml

_KINDS: dict[str, Kind] = {
    "car": "car", "parkedVehicle": "car", "taxi": "car", "priorityVehicle": "car", "truck": "truck", "bus": "bus",
    "bicycle": "bicycle", "motorcycle": "motorcycle", "pedestrian": "pedestrian",
}  # fmt: skip
_LETTERS = {"red": "r", "redYellow": "u", "yellow": "y", "green": "g", "inactive": "O"}
_OFF_ROAD_TYPES = {"sidewalk", "crosswalk", "bicycleLane", "border"}
_LEAST_WIDTH_M = 2.0
_CRAWL_MPS = 0.5  # below which a velocity says nothing about the heading
_BRIDGED = 100  # steps without any moving obstacle, over which one that stands is there all the same


def read(path: Path, beside: CompanionFiles) -> Iterator[LoggedScene]:
    """The one scenario of a file."""
    root = read_xml(path, "commonRoad")
    version = root.get("commonRoadVersion", "")
    if not version.startswith("20"):
        raise LogError(f"{path}: CommonRoad version {version[:20]!r}, expected 2018b or 2020a")
    dt = _real(root.get("timeStepSize"))
    lanes, areas = _lanelets(root)
    tracks, notes = _obstacles(root, LoggedMap(lanes), Work.of(path))
    last = max((int(track.step[-1]) for track in tracks), default=0)
    ego, target = _ego(root, lanes, dt, last)
    notes += [] if ego else _without_goal(root)
    if ego is not None:
        tracks.append(ego)
        notes.append("the ego's track follows lanelets from its start to its goal; it was not driven")
    yield LoggedScene(
        name=root.get("benchmarkID", path.stem),
        dt=dt,
        tracks=tuple(tracks),
        road=LoggedMap(lanes, (), areas),
        ego=ego.agent.id if ego else None,
        target=target,
        signals=_signals(root),
        notes=tuple(notes),
    )


def _real(text: str | None) -> float:
    value = float(text or "nan")
    if not np.isfinite(value):
        raise ValueError(f"{text!r} is no number")
    return value


def _value(element: ET.Element | None) -> float | None:
    """An exact value, or the middle of an interval; None where absent."""
    if element is None:
        return None
    exact = element.find("exact")
    if exact is not None:
        return _real(exact.text)
    if element.find("intervalStart") is None:
        return None
    return 0.5 * (_real(element.findtext("intervalStart")) + _real(element.findtext("intervalEnd")))


def _interval(element: ET.Element | None) -> tuple[float, float] | None:
    """Both ends of an interval, equal ones of an exact value; None where absent."""
    if element is None or (middle := _value(element)) is None:
        return None
    if element.find("exact") is not None:
        return middle, middle
    return _real(element.findtext("intervalStart")), _real(element.findtext("intervalEnd"))


def _point(element: ET.Element) -> tuple[float, float]:
    return _real(element.findtext("x")), _real(element.findtext("y"))


# --- map --------------------------------------------------------------------------------------


def _lanelets(root: ET.Element) -> tuple[tuple[LoggedLane, ...], tuple]:
    limits = {sign.get("id", ""): _limit(sign) for sign in root.iter("trafficSign")}
    lanes, areas = [], []
    for element in root.findall("lanelet"):
        left, right = (_bound(element, side) for side in ("leftBound", "rightBound"))
        if len(left) < 2 or len(right) < 2 or element.findtext("laneletType") in _OFF_ROAD_TYPES:
            continue
        area = lanelet(left, right)
        if area is not None:
            areas.append(area)
            lanes.append(_lane(element, left, right, limits))
    return with_openings(tuple(lanes)), tuple(areas)


def _bound(element: ET.Element, side: str) -> Float[np.ndarray, "point 2"]:
    return np.array([_point(point) for point in element.findall(f"{side}/point")], float).reshape(-1, 2)


def centre_line(
    left: Float[np.ndarray, "a 2"], right: Float[np.ndarray, "b 2"]
) -> tuple[Float[np.ndarray, "point 2"], float]:
    """The line midway between two bounds, and their median distance [m]."""
    count = max(len(left), len(right))
    sides = [along(side, np.linspace(0.0, 1.0, count)) for side in (left, right)]
    width = float(np.median(np.hypot(*(sides[0] - sides[1]).T)))
    return 0.5 * (sides[0] + sides[1]), width


def along(line: Float[np.ndarray, "point 2"], part: Float[np.ndarray, " place"]) -> Float[np.ndarray, "place 2"]:
    """Points at parts (0 to 1) of the length of a line."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    return np.stack([np.interp(part * way[-1], way, line[:, axis]) for axis in (0, 1)], axis=-1)


def _lane(element: ET.Element, left: np.ndarray, right: np.ndarray, limits: dict[str, float | None]) -> LoggedLane:
    centre, width = centre_line(left, right)
    signs = [limits.get(ref.get("ref", "")) for ref in element.iter("trafficSignRef")]
    known = [limit for limit in signs if limit]
    old = element.findtext("speedLimit")
    beside = {
        side: ref.get("ref")
        for side in ("adjacentLeft", "adjacentRight")
        for ref in element.findall(side)
        if ref.get("drivingDir") == "same"
    }
    return LoggedLane(
        id=element.get("id", ""),
        centre=centre,
        width=max(width, _LEAST_WIDTH_M),
        speed_limit=known[0] if known else (_real(old) if old else 13.9),
        exits=tuple(ref.get("ref", "") for ref in element.findall("successor")),
        left=beside.get("adjacentLeft"),
        right=beside.get("adjacentRight"),
        junction=element.findtext("laneletType") == "intersection",
    )


def _limit(sign: ET.Element) -> float | None:
    """The speed that a sign 274 (Germany) or R2-1 (USA) allows [m/s]; CommonRoad has it in m/s."""
    for part in sign.iter("trafficSignElement"):
        if part.findtext("trafficSignID") in ("274", "R2-1") and part.findtext("additionalValue"):
            value = _real(part.findtext("additionalValue"))
            return value if 0 < value < 100 else None
    return None


def _signals(root: ET.Element) -> tuple[LoggedSignal, ...]:
    stands_at: dict[str, list[str]] = {}
    for element in root.findall("lanelet"):
        for ref in element.findall("trafficLightRef"):
            stands_at.setdefault(ref.get("ref", ""), []).append(element.get("id", ""))
    found = []
    for light in root.iter("trafficLight"):
        name = light.get("id", "")
        if name in stands_at and (cycle := _cycle(light)) is not None:
            letters, ends, offset = cycle
            found.append(LoggedSignal(name, letters, tuple(stands_at[name]), ends=ends, offset=offset))
    return tuple(found)


def _cycle(light: ET.Element) -> tuple[str, tuple[int, ...], int] | None:
    """The letters of a light that repeats itself, the steps at which they end, and at which it begins."""
    parts = [(int(_real(e.findtext("duration"))), e.findtext("color", "")) for e in light.iter("cycleElement")]
    if not parts or min(duration for duration, _ in parts) < 1 or light.findtext("active") == "false":
        return None
    ends = tuple(itertools.accumulate(duration for duration, _ in parts))
    offset = int(_real(light.findtext("cycle/timeOffset") or "0"))
    if max(ends[-1], abs(offset)) > LATEST_STEP:
        raise ValueError(f"a light with a cycle of {ends[-1]:.3g} steps from step {offset:.3g} on")
    return "".join(_LETTERS.get(color, "O") for _, color in parts), ends, offset


# --- traffic ----------------------------------------------------------------------------------


def _obstacles(root: ET.Element, road: LoggedMap, work: Work) -> tuple[list[Track], list[str]]:
    found, stand, without = list[Unfaced](), list[bool](), 0
    for element in root:
        if element.tag in ("dynamicObstacle", "obstacle", "staticObstacle"):
            track = _track(element)
            stands = element.tag == "staticObstacle" or element.findtext("role") == "static"
            if track is None or (len(track.step) == 1 and element.find("occupancySet") is not None):
                without += 1
            else:
                found.append(track)
                stand.append(stands)
    tracks = faced(found, road)
    moving, standing = ([t for t, one in zip(tracks, stand, strict=True) if one == still] for still in (False, True))
    there = _instants(moving)
    work.spend("obstacles that stand x instants", len(standing), len(there))
    tracks = [*moving, *(_standing(track, there) for track in standing)]
    return tracks, [f"{without} obstacles have no positions, only sets, and are left out"] * (without > 0)


def _instants(moving: list[Track]) -> Int[np.ndarray, " instant"]:
    """From the first instant of the file on, as long as any obstacle moves; longer pauses are left out."""
    known = np.unique(np.concatenate([[0], *(track.step for track in moving)]))
    breaks = np.flatnonzero(np.diff(known) > _BRIDGED)
    firsts, lasts = known[[0, *(breaks + 1)]], known[[*breaks, -1]]
    return np.concatenate([np.arange(first, last + 1) for first, last in zip(firsts, lasts, strict=True)])


def _standing(track: Track, there: Int[np.ndarray, " instant"]) -> Track:
    """A static obstacle is there all the time."""
    x, y, yaw = (np.full(len(there), float(values[0])) for values in (track.x, track.y, track.yaw))
    return replace(track, step=there, x=x, y=y, yaw=yaw)


def _track(element: ET.Element) -> Unfaced | None:
    states = [_state(state) for state in [*element.findall("initialState"), *element.findall("trajectory/state")]]
    rows = {round(state[0]): state[1:] for state in states if state is not None}
    if not rows:
        return None
    step = np.array(sorted(rows))
    x, y, yaw = np.array([rows[one] for one in step.tolist()], float).T
    return Unfaced(_agent(element), step, x, y, yaw)


def _state(state: ET.Element) -> tuple[float, float, float, float] | None:
    time, place = _value(state.find("time")), _place(state.find("position"))
    if time is None or place is None:
        return None
    return time, *place, _yaw(state)


def _yaw(state: ET.Element) -> float:
    """The orientation, that of the velocity of a point mass where it has none; NaN where neither tells [rad]."""
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
        return _point(point)
    for shape in ("rectangle", "circle"):
        if (centre := position.find(f"{shape}/center")) is not None:
            return _point(centre)
    corners = [_point(point) for point in position.findall("polygon/point")]
    return (float(np.mean([x for x, _ in corners])), float(np.mean([y for _, y in corners]))) if corners else None


def _agent(element: ET.Element) -> Agent:
    kind = _KINDS.get(element.findtext("type", ""), "other")
    shape = element.find("shape")
    length, width = 0.0, 0.0
    if shape is not None and (rectangle := shape.find("rectangle")) is not None:
        length, width = _real(rectangle.findtext("length")), _real(rectangle.findtext("width"))
    elif shape is not None and (circle := shape.find("circle")) is not None:
        length = width = 2.0 * _real(circle.findtext("radius"))
    elif shape is not None and (corners := shape.findall("polygon/point")):
        xy = np.array([_point(corner) for corner in corners])
        length, width = np.ptp(xy, axis=0).tolist()
    return sized(element.get("id", ""), kind, length, width)


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
    here = Unfaced(Agent("ego", "car", *DEFAULT_SIZES["car"]), np.array([first]), *np.array(state[1:]).reshape(3, 1))
    (yaw,) = faced([here], LoggedMap(lanes))[0].yaw.tolist()
    start = EgoStart(state[1], state[2], yaw, _value(begin.find("velocity")) or 0.0)
    place = _goal_place(goal, lanes)
    when = [dt * (time - first) for time in _interval(goal.find("time")) or (last, last)]
    aim = EgoGoal(place, _value(goal.find("orientation")), *(max(time, dt) for time in when))
    x, y, yaw = planned_track(start, aim, lanes, dt)
    step = first + np.arange(len(x))
    name = f"ego_{problem.get('id', '')}"
    return Track(Agent(name, "car", *DEFAULT_SIZES["car"]), step, x, y, yaw), place or (float(x[-1]), float(y[-1]))


def _without_goal(root: ET.Element) -> list[str]:
    """What is said of planning problems that lead nowhere: the ego is then drawn from the traffic."""
    names = [one.get("id", "") for one in root.findall("planningProblem")]
    if not names:
        return []
    return [f"planning problem {names[0]} has no goal and is left out; the ego is drawn from the traffic"]


def _goal_place(goal: ET.Element, lanes: tuple[LoggedLane, ...]) -> tuple[float, float] | None:
    position = goal.find("position")
    place = _place(position)
    if place is not None or position is None:
        return place
    by_name = {lane.id: lane for lane in lanes}
    for ref in position.findall("lanelet"):
        if (lane := by_name.get(ref.get("ref", ""))) is not None:
            x, y = along(lane.centre, np.array([0.5]))[0]
            return float(x), float(y)
    return None


FORMAT = LogFormat("commonroad", "CommonRoad XML", lambda path, head: b"<commonRoad" in head, read)
