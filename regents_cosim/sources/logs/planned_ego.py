"""A track for an ego that has only a start and a goal.

The ego moves over to the centre lines of the lanes that lead to the goal within 20 m or 3 s, and follows them; without
such lanes it follows a cubic from start to goal. It keeps its speed if that arrives within the time asked for, and
otherwise drives at the constant acceleration that does. After the goal it drives on at its speed until 8 s have passed.
This guess at a driver's motion is good enough to tell where the ego wants to go; a planner under test drives its own
way.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.lines import cubic, distances_along, heading_near, midway, points_at, without_repeats
from regents_cosim.sources.logs.scene import LoggedLane

_BLEND_M, _BLEND_S = 20.0, 3.0  # distance or time until the ego is on the centre line
_ON_LANE_M = 4.0  # farthest distance of the start and the goal from their lanes
_SAME_WAY_RAD = np.deg2rad(60.0)
_STEP_M = 0.5
_SMOOTH_M = 2.0  # corners of centre lines are rounded over about this length
_MOST_ACCEL = 6.0  # [m/s^2] bound for unreasonable arrival times
_LONGEST_M = 20_000.0
_MOST_STEPS = 100_000
_LEAST_S = 8.0  # shortest track, if the goal's time allows
_CUBIC_POINTS = 200
_ONWARD = 20  # most lanes after the goal

_Path = Float[np.ndarray, "point 2"]


@dataclass(frozen=True)
class EgoStart:
    """The initial state of the ego."""

    x: float  # [m]
    y: float  # [m]
    yaw: float  # [rad]
    speed: float  # [m/s]


@dataclass(frozen=True)
class EgoGoal:
    """The state in which the ego should arrive; None where it is free."""

    place: tuple[float, float] | None  # [m]
    yaw: float | None  # [rad]
    earliest_s: float  # [s] after the start
    latest_s: float


def planned_track(
    start: EgoStart, goal: EgoGoal, lanes: Sequence[LoggedLane], dt: float
) -> tuple[Float[np.ndarray, " time"], Float[np.ndarray, " time"], Float[np.ndarray, " time"]]:
    """x, y [m] and yaw [rad] every `dt` [s] from the start to the goal."""
    path, goal_m = _path(start, goal, lanes)
    arrival_s = goal.latest_s
    if goal.place is not None:
        arrival_s = float(np.clip(goal_m / max(start.speed, 0.1), goal.earliest_s, goal.latest_s))
    end_s = max(arrival_s, min(goal.latest_s, _LEAST_S))
    time = dt * np.arange(min(max(round(end_s / dt), 1), _MOST_STEPS) + 1)
    gone = _gone(start.speed, goal_m if goal.place else None, arrival_s, time)
    way = distances_along(*path.T)
    ahead = path[-1] - path[-2]
    beyond = np.maximum(gone - way[-1], 0.0)[:, None] * ahead / np.hypot(*ahead)
    xy = points_at(gone, way, path) + beyond
    direction = np.unwrap(np.arctan2(*np.diff(path, axis=0).T[::-1]))
    yaw = np.interp(gone, midway(way), direction)
    yaw += (start.yaw - yaw[0] if abs(wrap(start.yaw - yaw[0])) < _SAME_WAY_RAD else 0.0) * np.exp(-gone / 3.0)
    return xy[:, 0], xy[:, 1], np.asarray(wrap(yaw))


def _gone(
    speed: float, distance: float | None, arrival_s: float, time: Float[np.ndarray, " time"]
) -> Float[np.ndarray, " time"]:
    """Distance driven [m]: at constant acceleration until the arrival, then at constant speed; never backwards."""
    speed = float(np.clip(speed, 0.0, 100.0))
    accel = 0.0
    if distance is not None:
        accel = float(np.clip(2.0 * (distance - speed * arrival_s) / arrival_s**2, -_MOST_ACCEL, _MOST_ACCEL))
    stop = speed / -accel if accel < 0.0 else np.inf
    changing = np.minimum(time, min(arrival_s, stop))
    after = np.maximum(time - min(arrival_s, stop), 0.0)
    last_speed = max(speed + accel * min(arrival_s, stop), 0.0)
    return np.minimum(speed * changing + 0.5 * accel * changing**2 + last_speed * after, _LONGEST_M)


def _path(start: EgoStart, goal: EgoGoal, lanes: Sequence[LoggedLane]) -> tuple[_Path, float]:
    """A line from the start to the goal and beyond it, and how far the goal is along it [m]."""
    here = np.array([start.x, start.y])
    route = _route(start, goal, lanes)
    if route is None:
        return _cubic(start, goal)
    line = shapely.LineString(route)
    begin = line.project(shapely.Point(here))
    end = line.project(shapely.Point(goal.place)) if goal.place else line.length
    if end - begin < 1.0:
        return _cubic(start, goal)
    last = min(max(line.length, end), begin + _LONGEST_M)
    places = np.linspace(begin, last, min(int((last - begin) / _STEP_M), 40_000) + 2)
    points = shapely.get_coordinates(shapely.line_interpolate_point(line, places))
    points = gaussian_filter1d(points, _SMOOTH_M / _STEP_M, axis=0, mode="nearest")
    fade = np.clip((places - begin) / max(_BLEND_M, _BLEND_S * start.speed), 0.0, 1.0)
    return points + (1.0 - fade**2 * (3.0 - 2.0 * fade))[:, None] * (here - points[0]), end - begin


def _cubic(start: EgoStart, goal: EgoGoal) -> tuple[_Path, float]:
    """The Hermite cubic between both poses; a straight line where there is no goal."""
    here, ahead = np.array([start.x, start.y]), np.array([np.cos(start.yaw), np.sin(start.yaw)])
    there = here + 50.0 * ahead if goal.place is None else np.array(goal.place)
    reach = float(np.hypot(*(there - here)))
    if reach < 1.0:
        return np.stack([here, here + ahead]), reach
    last = ahead if goal.yaw is None else np.array([np.cos(goal.yaw), np.sin(goal.yaw)])
    points = cubic(here, reach * ahead, there, reach * last, _CUBIC_POINTS)
    return points, float(distances_along(*points.T)[-1])


# --- which lanes ------------------------------------------------------------------------------


def _route(start: EgoStart, goal: EgoGoal, lanes: Sequence[LoggedLane]) -> _Path | None:
    """The centre lines from the start to the goal over the fewest lanes; None where no lanes lead there."""
    by_name = {lane.id: lane for lane in lanes}
    first = _lane_at(np.array([start.x, start.y]), start.yaw, lanes)
    if first is None:
        return None
    there = shapely.Point(goal.place) if goal.place else shapely.Point()  # an empty one is at no distance of lanes
    wanted = {lane.id for lane in lanes if shapely.LineString(lane.centre).distance(there) < _ON_LANE_M}
    came_from: dict[str, str | None] = {first.id: None}
    queue = deque([first.id])
    last = first.id
    while queue:
        last = queue.popleft()
        if last in wanted:
            break
        lane = by_name[last]
        for after in (*lane.exits, lane.left, lane.right):
            if after in by_name and after not in came_from:
                came_from[after] = last
                queue.append(after)
    if goal.place and last not in wanted:
        return None
    way = [last]
    while (before := came_from[way[-1]]) is not None:
        way.append(before)
    return _joined([*way[::-1], *_onward(by_name[last], by_name)], by_name)


def _onward(lane: LoggedLane, by_name: dict[str, LoggedLane]) -> list[str]:
    """The names of the lanes that follow, taking the first exit at every fork."""
    names: list[str] = []
    while lane.exits and lane.exits[0] in by_name and lane.exits[0] not in names and len(names) < _ONWARD:
        names.append(lane.exits[0])
        lane = by_name[lane.exits[0]]
    return names


def _joined(names: list[str], by_name: dict[str, LoggedLane]) -> _Path:
    """The joined centre lines; of lanes beside each other only the last is used."""
    kept = [
        name
        for name, after in zip(names, [*names[1:], None], strict=True)
        if after is None or after in by_name[name].exits
    ]
    return without_repeats(np.concatenate([by_name[name].centre for name in kept]), 1e-6)


def _lane_at(place: np.ndarray, yaw: float, lanes: Sequence[LoggedLane]) -> LoggedLane | None:
    """The nearest lane that runs in the ego's direction; None where there is none."""
    best, least, point = None, _ON_LANE_M, shapely.Point(place)
    for lane in lanes:
        line = shapely.LineString(lane.centre)
        away = line.distance(point)
        if away < least and abs(wrap(heading_near(line, point) - yaw)) < _SAME_WAY_RAD:
            best, least = lane, away
    return best
