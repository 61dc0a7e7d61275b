"""Where searches begin: drives of a candidate along the lawful ways ahead of it, timed so that it would meet the ego.

A descent that starts from the log is stuck where the two would have to meet at another time, or where the candidate
would have to take another turn: the gradient pulls straight across, where a median, the law or other traffic forbids
it. Along each way that the candidate may take (`verdicts.ways`: its turns, its changes of lane, its logged path) a grid
of speeds is driven, all of them with what bends allow. Those that meet the ego, while that stays on the track that it
drives unattacked, are starts. The first are those that a driver in the ego's place could see coming: steady for the
last seconds, gentle, from the side.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from regents_cosim.attacks.descent import to_actions
from regents_cosim.attacks.job import Job
from regents_cosim.boxes import Boxes, overlap
from regents_cosim.frames import wrap
from regents_cosim.limits import ALONG_RAD, MOST_ACCEL_M_S2
from regents_cosim.mirror.actions import fit_controls
from regents_cosim.mirror.bicycle import Controls, Motion
from regents_cosim.mirror.world import scene_origin
from regents_cosim.planners.reference.parameters import CAREFUL
from regents_cosim.planners.route import evenly, logged_path
from regents_cosim.roadmap import RoadMap
from regents_cosim.scenario import Scenario, Tracks
from regents_cosim.verdicts.lane_pieces import lane_lines, neighbours
from regents_cosim.verdicts.ways import OVER_LIMIT, Way, ways_ahead

_SPACING_M = 0.5  # of the points of a way
_SMOOTH_POINTS = 9  # lanes have kinks where they meet
_BEND_ACCEL = 3.0  # [m/s^2] sideways, that a driver takes in a bend (Treiber and Kesting 2013: 2 to 3 in cities)
_BEND_BRAKE = 2.0  # [m/s^2] with which it slows down for one
_HARDEST_BRAKE = 4.5  # [m/s^2] of all starts; emergencies are left to the descent
_BRAKES = (-4.0, -2.5, -1.5, -0.75)  # [m/s^2]
_SLOWER = (0.0, 0.25, 0.5, 0.75)  # shares of the speed at first that braking ends at
_GAINS = (0.75, 1.5, 2.5)  # [m/s^2]
_FASTER_M_S = (1.0, 2.0, 4.0, 6.0, 9.0, 13.0)
_PULLING_OUT_M_S = 4.0  # for one that stands or crawls, the shares above are of this speed
_MOST_CHANGED_FROM = 2  # ways from which lanes are changed
_CHANGE_BEGINS_S = (0.0, 1.0, 2.5)
_CHANGE_LASTS_S = (4.0, 7.0, 10.0)
_SHORTEST_CHANGE_M = 12.0
_RED = "ru"  # SUMO's letters: red, and red with yellow
_EARLIEST_S = 1.5  # a crash before that is none that anyone could react to
_STEADY_S = 3.0  # before the crash: long enough to foresee it
_LEADS = 0.9  # of the ego's length ahead of its centre: the ego runs into its rear
_SEEN_S = 2.0  # before the crash: what a careful driver needs to see, to decide and to brake
_ALIKE = np.array([0.6, 2.0, np.deg2rad(30.0)])  # contacts that differ by less are alike: s, m, rad


@dataclass(frozen=True, eq=False)
class Start:
    """A drive of one candidate, [time] over the whole horizon in the map's frame; before it enters it does not move."""

    x: Float[np.ndarray, " time"]  # [m]
    y: Float[np.ndarray, " time"]  # [m]
    yaw: Float[np.ndarray, " time"]  # [rad]
    speed: Float[np.ndarray, " time"]  # [m/s]
    meets: int  # the step at which it first overlaps the ego
    contact: tuple[float, float, float]  # s, m, rad: when, how far ahead of the ego's centre, and at which angle
    promise: float  # the greater the earlier it is tried


def followed(scenario: Scenario, job: Job, found: Sequence[Start], most: int) -> list[Controls]:
    """The actions [1, step] with which a job's candidate follows drives, of which there are at most `most`."""
    if not found:
        return []
    padded = [*found, *[found[-1]] * (most - len(found))]  # one compiled program for any number
    origin = scene_origin(scenario)
    begun = float(job.movers.rows(job.world.start.yaw)[0])
    x, y, yaw, speed = (np.stack([getattr(s, name) for s in padded]) for name in ("x", "y", "yaw", "speed"))
    yaw = yaw + 2.0 * np.pi * np.round((begun - yaw[:, :1]) / (2.0 * np.pi))
    wanted = Motion(*(jnp.asarray(v, jnp.float32) for v in (x - origin[0], y - origin[1], yaw, speed)))
    actions = to_actions(_fitted(job, wanted))
    return [jax.tree.map(lambda values, k=k: values[k : k + 1], actions) for k in range(len(found))]


def _fitted(job: Job, wanted: Motion) -> Controls:
    """The controls [drive, step] with which the job's candidate follows drives [drive, time]."""
    start, moving, half_length = jax.tree.map(
        lambda values: jnp.repeat(values, len(wanted.x), axis=0),
        job.movers.rows((job.world.start, job.world.moving, job.world.half_length)),
    )
    there = jnp.ones(wanted.x.shape, bool)
    return fit_controls(wanted, there, start, moving, job.world.dt, half_length, job.world.dynamics)


def starts(scenario: Scenario, agent: int, ego: Tracks, most: int) -> list[Start]:
    """At most `most` drives of `agent` that meet the `ego` [1, time] on its track, the most promising first."""
    ordered = sorted(_meetings(scenario, agent, ego), key=lambda start: -start.promise)
    return _different(ordered, most, _Others(scenario, agent).leave_alone)


def _different(ordered: Sequence[Start], most: int, free: Callable[[Start], bool]) -> list[Start]:
    """The first free ones that do not meet the ego like one before."""
    chosen: list[Start] = []
    for start in ordered:
        if len(chosen) == most:
            break
        apart = (np.abs(np.subtract(start.contact, one.contact)) / _ALIKE for one in chosen)
        if all((scaled > 1.0).any() for scaled in apart) and free(start):
            chosen.append(start)
    return chosen


class _Others:
    """All but the ego and the candidate, where the log has them."""

    def __init__(self, scenario: Scenario, agent: int) -> None:
        index = np.arange(len(scenario.agents))
        known = {name for pair in scenario.overlaps if scenario.agents[agent].id in pair.agents for name in pair.agents}
        counts = [i not in (0, agent) and scenario.agents[i].id not in known for i in index.tolist()]
        self._x, self._y, yaw, length, width, _ = (values[counts] for values in np.broadcast_arrays(*scenario.boxes))
        self._yaw, self._length, self._width = yaw, length, width
        self._there = scenario.tracks.valid[counts] & scenario.tracks.valid[agent]
        self._size = scenario.agents[agent].length, scenario.agents[agent].width

    def leave_alone(self, start: Start) -> bool:
        """Whether the drive touches none of them up to where it meets the ego."""
        upto = np.s_[: start.meets + 1]
        near = np.hypot(self._x[:, upto] - start.x[upto], self._y[:, upto] - start.y[upto])
        reach = 0.5 * (np.hypot(self._length, self._width)[:, upto] + np.hypot(*self._size))
        at = np.nonzero(self._there[:, upto] & (near < reach))
        mine = Boxes(start.x[at[1]], start.y[at[1]], start.yaw[at[1]], *self._size)
        theirs = Boxes(self._x[at], self._y[at], self._yaw[at], self._length[at], self._width[at])
        return not np.any(overlap(mine, theirs))


@dataclass(frozen=True, eq=False)
class _Line:
    """A way as an evenly spaced line."""

    points: Float[np.ndarray, "point 2"]  # [m] every `_SPACING_M`
    heading: Float[np.ndarray, " point"]  # [rad] continuous
    limit: float  # [m/s] where it begins
    shows_m: float = 0.0  # so far along, a change of lane can be noticed
    lights: tuple[tuple[float, Bool[np.ndarray, " time"]], ...] = ()  # stop lines [m] along it, and when they are red

    def at(self, way: Float[np.ndarray, "*axes"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places [m, m] and headings [rad] so many metres along."""
        along = np.arange(len(self.points)) * _SPACING_M
        return tuple(np.interp(way, along, values) for values in (*self.points.T, self.heading))  # pyright: ignore


def _ways(scenario: Scenario, agent: int) -> Iterator[_Line]:
    """The lawful ways ahead, with changes of lane from several places on; and the logged path."""
    tracks = scenario.tracks
    first = int(np.argmax(tracks.valid[agent]))
    speed, fastest = float(tracks.speed[agent, first]), float(tracks.speed[agent].max())
    reach_m = 2.0 * fastest * tracks.steps * scenario.dt + 50.0
    ways = ways_ahead(scenario, agent)
    logged = _line(_prolonged(logged_path(tracks, agent), reach_m), np.inf)
    taken = next((way for way in ways if way.logged), None)
    yield logged if taken is None else replace(logged, lights=_lights(scenario, taken, logged))
    for index, way in enumerate(ways):
        if way.changes > 1:
            continue
        line = _line(_prolonged(way.points, reach_m), max(lane.speed_limit for lane in way.lanes[:2]))
        line = replace(line, lights=_lights(scenario, way, line))
        yield line
        if way.changes == 0 and index < _MOST_CHANGED_FROM:
            yield from _changing(scenario.road, line, way, max(speed, _PULLING_OUT_M_S))


def _changing(road: RoadMap, line: _Line, way: Way, speed: float) -> Iterator[_Line]:
    """The way, with a change to a neighbour that begins sooner or later and takes longer or less long."""
    along = np.arange(len(line.points)) * _SPACING_M
    across = np.stack([-np.sin(line.heading), np.cos(line.heading)], axis=1)
    for begin_s, lasting_s in itertools.product(_CHANGE_BEGINS_S, _CHANGE_LASTS_S):
        begin_m, length_m = begin_s * speed, max(lasting_s * speed, _SHORTEST_CHANGE_M)
        if begin_m + length_m > along[-1]:
            continue
        place = int(begin_m / _SPACING_M)
        for aside in _neighbours_aside(road, way, line.points[place], across[place]):
            done = np.clip((along - begin_m) / length_m, 0.0, 1.0)
            shift = aside * (done - np.sin(2.0 * np.pi * done) / (2.0 * np.pi))
            shows_m = float(along[np.argmax(np.abs(shift) > CAREFUL.wandering_m)])
            changed = _line(line.points + shift[:, None] * across, line.limit)
            yield replace(changed, shows_m=shows_m, lights=line.lights)


def _lights(scenario: Scenario, way: Way, line: _Line) -> tuple[tuple[float, Bool[np.ndarray, " time"]], ...]:
    """The stop lines that the way passes."""
    signals = {signal.id: signal for signal in scenario.signals}
    drawn = shapely.LineString(line.points)
    found = []
    for lane, onward in itertools.pairwise(way.lanes):
        link = next((link for link in scenario.road.exits[lane.id] if link.target == onward.id), None)
        if link is not None and link.signal in signals:
            shown = [signals[link.signal].letters(step)[link.link] for step in range(scenario.tracks.steps)]
            at_m = float(drawn.project(shapely.Point(lane.centre[-1])))
            found.append((at_m, np.array([letter in _RED for letter in shown])))
    return tuple(found)


def _neighbours_aside(
    road: RoadMap, way: Way, place: Float[np.ndarray, " 2"], left: Float[np.ndarray, " 2"]
) -> list[float]:
    """How far to the left of a place on the way [m] the middles are of the lanes that one may change to from there."""
    lines, at = lane_lines(road), shapely.Point(place)
    here = min(way.lanes, key=lambda lane: lines[lane.id].distance(at))
    found = [
        np.array(lines[other].interpolate(lines[other].project(at)).coords[0]) for other in neighbours(road)[here.id]
    ]
    return [float((other - place) @ left) for other in found]


def _prolonged(points: Float[np.ndarray, "point 2"], reach_m: float) -> Float[np.ndarray, "further 2"]:
    """The line, straight on to that length."""
    left = reach_m - float(np.hypot(*np.diff(points, axis=0).T).sum())
    ahead = points[-1] - points[-2]
    return np.vstack([points, points[-1] + max(left, 1.0) * ahead / np.hypot(*ahead)])


def _line(points: Float[np.ndarray, "point 2"], limit: float) -> _Line:
    even = evenly(points, _SPACING_M)
    smooth = np.stack([_smooth(even[:, axis]) for axis in (0, 1)], axis=1)
    even = evenly(smooth, _SPACING_M)
    step = np.gradient(even, axis=0)
    return _Line(even, np.unwrap(np.arctan2(step[:, 1], step[:, 0])), limit)


def _smooth(values: Float[np.ndarray, " point"]) -> Float[np.ndarray, " point"]:
    """Twice the mean of the neighbours, the ends where they are."""
    half = _SMOOTH_POINTS // 2
    for _ in range(2):
        before, after = 2.0 * values[0] - values[half:0:-1], 2.0 * values[-1] - values[-2 : -half - 2 : -1]
        padded = np.concatenate([before, values, after])
        values = np.convolve(padded, np.full(_SMOOTH_POINTS, 1.0 / _SMOOTH_POINTS), mode="valid")
    return values


@dataclass(frozen=True, eq=False)
class _Drives:
    """Drives of one candidate from where it enters, [drive, time], and what was wanted of each."""

    runs_red: Bool[np.ndarray, "drive time"]  # by then it has passed a red light
    settles: Int[np.ndarray, " drive"]  # the step from which on it goes on as it does, and shows where to
    gentle: Float[np.ndarray, " drive"]  # [m/s^2] the acceleration before
    x: Float[np.ndarray, "drive time"]
    y: Float[np.ndarray, "drive time"]
    yaw: Float[np.ndarray, "drive time"]
    speed: Float[np.ndarray, "drive time"]


def _meetings(scenario: Scenario, agent: int, ego: Tracks) -> Iterator[Start]:
    """All drives that meet the ego, late enough that a driver could react."""
    me, dt = scenario.agents[agent], scenario.dt
    first = int(np.argmax(scenario.tracks.valid[agent]))
    drives = _drives(scenario, agent, first)
    own = ego.x[0, first:], ego.y[0, first:], ego.yaw[0, first:]  # [time] each
    hits = _overlaps(drives, own, (me.length, me.width), (scenario.ego.length, scenario.ego.width))
    hits &= scenario.tracks.valid[agent, first:]
    meets = np.argmax(hits, axis=1)
    late = hits.any(axis=1) & ((first + meets) * dt >= _EARLIEST_S)
    late &= ~drives.runs_red[np.arange(len(meets)), meets]
    late &= _hardest_turn(drives, meets, dt) <= MOST_ACCEL_M_S2
    contact = _contact(drives, meets, own)
    promise = _promise(drives, meets, own, scenario)
    for row in np.flatnonzero(late).tolist():
        x, y, yaw, speed = (
            np.concatenate([np.full(first, values[row, 0]), values[row]])
            for values in (drives.x, drives.y, drives.yaw, drives.speed)
        )
        when = (first + int(meets[row])) * dt
        met = (when, float(contact[row, 0]), float(contact[row, 1]))
        yield Start(x, y, yaw, speed, first + int(meets[row]), met, float(promise[row]))


def _hardest_turn(drives: _Drives, meets: Int[np.ndarray, " drive"], dt: float) -> Float[np.ndarray, " drive"]:
    """The greatest acceleration sideways [m/s^2] before each meets the ego; the fast turn hard into their lane."""
    sideways = 0.5 * (drives.speed[:, 1:] + drives.speed[:, :-1]) * np.abs(np.diff(drives.yaw)) / dt
    before = np.arange(sideways.shape[1]) < meets[:, None]
    return np.max(sideways, axis=1, initial=0.0, where=before)


def _overlaps(
    drives: _Drives, own: tuple[np.ndarray, ...], mine: tuple[float, float], ego: tuple[float, float]
) -> Bool[np.ndarray, "drive time"]:
    """Where the boxes overlap; asked only of those that are near."""
    reach = 0.5 * (np.hypot(*mine) + np.hypot(*ego))
    near = np.hypot(drives.x - own[0], drives.y - own[1]) < reach
    row, step = np.nonzero(near)
    one = Boxes(drives.x[near], drives.y[near], drives.yaw[near], *mine)
    hits = np.zeros(near.shape, bool)
    x, y, yaw = (values[step] for values in own)
    hits[row, step] = overlap(one, Boxes(x, y, yaw, *ego))
    return hits


def _drives(scenario: Scenario, agent: int, first: int) -> _Drives:
    """A grid of speeds along every way."""
    speed = scenario.tracks.speed[agent]
    lines = list(_ways(scenario, agent))
    changes = [_changes(float(speed[first]), _most(line.limit, float(speed.max()))) for line in lines]
    way = np.repeat(np.arange(len(lines)), [len(some) for some in changes])
    change = np.vstack(changes)
    driven, travelled = _driven(lines, way, float(speed[first]), change, len(speed) - first, scenario.dt)
    places = [line.at(travelled[way == index]) for index, line in enumerate(lines)]
    x, y, yaw = (np.vstack(values) for values in zip(*places, strict=True))
    accel, wanted = change.T
    gap = np.abs(wanted - speed[first])
    changing_s = np.divide(gap, np.abs(accel), out=np.zeros_like(accel), where=accel != 0.0)
    shows = (travelled < np.array([line.shows_m for line in lines])[way][:, None]).sum(axis=1)
    settles = np.maximum(shows, np.ceil(changing_s / scenario.dt).astype(int))
    half_length = 0.5 * scenario.agents[agent].length
    runs_red = np.vstack(
        [_runs_red(line, travelled[way == index] + half_length, first) for index, line in enumerate(lines)]
    )
    return _Drives(runs_red, settles, np.abs(accel), x, y, yaw, driven)


def _runs_red(line: _Line, front: Float[np.ndarray, "drive time"], first: int) -> Bool[np.ndarray, "drive time"]:
    """Whether a drive along the line has passed a red light by then, its front being so far along [m]."""
    run = np.zeros(front.shape, bool)
    for at_m, red in line.lights:
        passes = (front[:, 1:] > at_m) & (front[:, :-1] <= at_m) & red[first + 1 :]
        run[:, 1:] |= passes
    return np.logical_or.accumulate(run, axis=1)


def _most(limit: float, logged: float) -> float:
    """The top speed of drives on a way [m/s]."""
    return max(OVER_LIMIT * limit, logged) if np.isfinite(limit) else 1.3 * max(logged, _PULLING_OUT_M_S)


def _changes(speed: float, most: float) -> Float[np.ndarray, "drive 2"]:
    """Accelerations [m/s^2], and the speeds [m/s] at which they end."""
    slower = [(brake, share * max(speed, _PULLING_OUT_M_S)) for brake in _BRAKES for share in _SLOWER]
    faster = [(gain, speed + more) for gain in _GAINS for more in _FASTER_M_S]
    changes = [(0.0, speed), *(pair for pair in slower if pair[1] < speed), *(p for p in faster if p[1] <= most)]
    return np.array(changes)


def _driven(
    lines: Sequence[_Line], way: Int[np.ndarray, " drive"], begun: float, change: np.ndarray, steps: int, dt: float
) -> tuple[Float[np.ndarray, "drive time"], Float[np.ndarray, "drive time"]]:
    """Speeds [m/s] and distances [m] of all drives, slower than wanted where the way bends."""
    accel, wanted = change.T
    allowed = np.concatenate([_allowed_in_bends(line) for line in lines])
    ends = np.cumsum([len(line.points) for line in lines])
    begins = (ends - [len(line.points) for line in lines])[way]
    last = ends[way] - 1
    speed, travelled = [np.full(len(change), begun)], [np.zeros(len(change))]
    for _ in range(steps - 1):
        now = speed[-1]
        slower, faster = np.maximum(now + accel * dt, np.minimum(wanted, now)), np.minimum(now + accel * dt, wanted)
        aim = np.where(accel < 0.0, slower, np.where(accel > 0.0, np.maximum(faster, np.minimum(now, wanted)), wanted))
        ahead = np.minimum(begins + (travelled[-1] / _SPACING_M).astype(int) + 1, last)
        aim = np.clip(np.minimum(aim, allowed[ahead]), now - _HARDEST_BRAKE * dt, now + _GAINS[-1] * dt)
        speed.append(np.maximum(aim, 0.0))
        travelled.append(travelled[-1] + 0.5 * (now + speed[-1]) * dt)
    return np.stack(speed, axis=1), np.stack(travelled, axis=1)


def _allowed_in_bends(line: _Line) -> Float[np.ndarray, " point"]:
    """Speed [m/s] at every point that its bend allows, and those ahead within gentle braking."""
    curvature = np.abs(np.gradient(line.heading)) / _SPACING_M
    gained = 2.0 * _BEND_BRAKE * _SPACING_M * np.arange(len(curvature))
    square = _BEND_ACCEL / np.maximum(curvature, 1e-4) + gained
    return np.sqrt(np.minimum.accumulate(square[::-1])[::-1] - gained)


def _contact(
    drives: _Drives, meets: Int[np.ndarray, " drive"], own: tuple[np.ndarray, ...]
) -> Float[np.ndarray, "drive 2"]:
    """How far ahead of the ego's centre [m] a drive meets it, and at which angle to its heading [rad]."""
    turn = wrap(drives.yaw[np.arange(len(meets)), meets] - own[2][meets])
    return np.stack([_ahead(drives, meets, own), turn], axis=1)


def _ahead(
    drives: _Drives, step: Int[np.ndarray, " drive"], own: tuple[np.ndarray, ...]
) -> Float[np.ndarray, " drive"]:
    """How far ahead of the ego's centre [m] each drive is at a step of its own."""
    rows = np.arange(len(step))
    x, y, yaw = (values[step] for values in own)
    return (drives.x[rows, step] - x) * np.cos(yaw) + (drives.y[rows, step] - y) * np.sin(yaw)


def _promise(
    drives: _Drives, meets: Int[np.ndarray, " drive"], own: tuple[np.ndarray, ...], scenario: Scenario
) -> Float[np.ndarray, " drive"]:
    """How likely a careful driver foresees the crash and the planner does not, by rules of thumb.

    Who runs the same way is suspected only while its centre is ahead of the ego's.
    """
    ahead, turn = _contact(drives, meets, own).T
    seen_from = np.maximum(meets - round(_SEEN_S / scenario.dt), 0)
    foreseen = np.clip((meets - drives.settles) * scenario.dt / _STEADY_S, -0.5, 1.0)
    crossing = np.abs(turn) > ALONG_RAD
    unseen = ~crossing & (np.minimum(ahead, _ahead(drives, seen_from, own)) <= 0.0)
    leads = ~crossing & (ahead > _LEADS * scenario.ego.length)
    return foreseen - 0.1 * drives.gentle + 0.5 * crossing - 1.0 * unseen - 0.4 * leads
