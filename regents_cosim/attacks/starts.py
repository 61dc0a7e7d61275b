"""Where searches begin: drives of a candidate along the lawful ways ahead of it, timed so that it would meet the ego.

A descent that starts from the log is stuck where the two would have to meet at another time, or where the candidate
would have to take another turn: the gradient pulls straight across, where a median, the law or other traffic forbids
it. Along each line that the candidate may take (`drive_lines`) the places and steps are marked at which it would touch
the ego, while that stays on the track that it drives unattacked (the path-time space of Kant and Zucker 1986). Those
of many speed profiles (`speed_profiles`) that enter a marked place are starts. The first are those that a driver in
the ego's place would see coming for some seconds: gentle, from the side.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from regents_cosim.attacks.actions import to_actions
from regents_cosim.attacks.drive_lines import SPACING_M, DriveLine, Near, lines_ahead
from regents_cosim.attacks.driving_limits import within_bounds
from regents_cosim.attacks.job import SearchJob
from regents_cosim.attacks.searched_agents import SearchedAgents
from regents_cosim.attacks.speed_profiles import Lights, Profiles, drive, profiles
from regents_cosim.attacks.walked_lines import walked_lines
from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.geometry.frames import wrap
from regents_cosim.limits import ACCEL_WINDOW_S, ALONG_RAD, MOST_SPEED_M_S, OVER_LIMIT
from regents_cosim.mirror.actions import FIT_PASSES, fit_controls
from regents_cosim.mirror.bicycle import Controls, Motion
from regents_cosim.mirror.compiled import compiled
from regents_cosim.mirror.world import World, scene_origin
from regents_cosim.planners.reference.parameters import FORESIGHT
from regents_cosim.scenario import Scenario, Tracks
from regents_cosim.verdicts.ordinary import DrivingLimits
from regents_cosim.verdicts.safe_distance import safe_distance

_EARLIEST_S = 1.5  # a crash before that is none that anyone could react to
_NEEDED_S = 3.0  # a careful driver who sees it coming for so long avoids it
_TURN_OVER_S = 0.3  # by which a turn is told
_LEADS = 0.9  # of the ego's length ahead of its centre: the ego runs into its rear
_SEEN_S = 2.0  # before the crash: what a careful driver needs to see, to decide and to brake
_SIDEWAYS_S = 0.5  # over which turning is taken: lines have kinks
_ROUNDING_M = 1e-3
_ALIKE = np.array([0.6, 2.0, np.deg2rad(30.0)])  # contacts that differ by less are alike: s, m, rad
_ALIKE_ON_FOOT = np.array([0.3, 0.7, np.deg2rad(30.0)])
_MARGIN_M = 0.3  # beside the ego: who walks there is in its way
_LINGERS_S = 1.5  # in its way: after so long any planner sees it


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


def followed(
    scenario: Scenario, job: SearchJob, found: Sequence[Start], most: int, passes: int = FIT_PASSES
) -> list[Controls]:
    """The actions [1, step] with which a job's candidate follows drives, of which there are at most `most`.

    They are fitted in so many `passes`.
    """
    if not found:
        return []
    padded = [*found, *[found[-1]] * (most - len(found))]  # one compiled program for any number
    origin = scene_origin(scenario)
    begun = float(job.searched.rows(job.world.start.yaw)[0])
    x, y, yaw, speed = (np.stack([getattr(s, name) for s in padded]) for name in ("x", "y", "yaw", "speed"))
    yaw = yaw + 2.0 * np.pi * np.round((begun - yaw[:, :1]) / (2.0 * np.pi))
    wanted = Motion(*(jnp.asarray(v, jnp.float32) for v in (x - origin[0], y - origin[1], yaw, speed)))
    world = replace(job.world.without_road(), bounds=job.world.bounds)
    actions = to_actions(_allowed(world, job.searched, _fitted(job, wanted, passes)))
    return [jax.tree.map(lambda values, k=k: values[k], actions) for k in range(len(found))]


def _fitted(job: SearchJob, wanted: Motion, passes: int) -> Controls:
    """The controls [drive, step] with which the job's candidate follows drives [drive, time]."""
    start, moving, mobility = jax.tree.map(
        lambda values: jnp.repeat(values, len(wanted.x), axis=0),
        job.searched.rows((job.world.start, job.world.moving, job.world.mobility)),
    )
    there = jnp.ones(wanted.x.shape, bool)
    return fit_controls(wanted, there, start, moving, job.world.dt, mobility, passes)


@compiled
def _allowed(world: World, searched: SearchedAgents, fitted: Controls) -> Controls:
    """The nearest of some drives' controls that keep to the world's bounds [drive searched step]."""
    return jax.vmap(lambda own: within_bounds(world, searched, jax.tree.map(lambda values: values[None], own)))(fitted)


def starts(
    scenario: Scenario, agent: int, ego: Tracks, most: int, limits: DrivingLimits, lawful: bool = True
) -> list[Start]:
    """At most `most` drives of `agent` that meet the `ego` [1, time] on its track, the most promising first.

    They keep to the `limits`. Those on foot need not be `lawful`; of vehicles all are.
    """
    pair = _Pair.of(scenario, agent, ego)
    drives = _drives(scenario, agent, pair, limits, lawful)
    if drives is None:
        return []
    contact = np.column_stack([(pair.first + drives.meets) * scenario.dt, _contact(drives, pair.own)])
    promise, alike = _promise(drives, pair.own, scenario), _ALIKE
    if scenario.agents[agent].kind == "pedestrian":
        promise, alike = promise + _promise_on_foot(drives, pair, scenario.dt), _ALIKE_ON_FOOT
    others, chosen, left = _Others(scenario, agent), list[Start](), np.ones(len(promise), bool)
    for row in np.argsort(-promise, kind="stable").tolist():
        if len(chosen) == most:
            break
        start = _start(drives, row, pair.first, contact[row], float(promise[row])) if left[row] else None
        if start is not None and others.left_alone_by(start):
            chosen.append(start)
            left &= (np.abs(contact - contact[row]) > alike).any(axis=1)
    return chosen


def _start(drives: "_Drives", row: int, first: int, contact: Float[np.ndarray, " 3"], promise: float) -> Start:
    """One of some drives over the whole horizon; the candidate enters at step `first`."""
    x, y, yaw, speed = (
        np.concatenate([np.full(first, values[row, 0]), values[row]])
        for values in (drives.x, drives.y, drives.yaw, drives.speed)
    )
    when, ahead, turn = contact.tolist()
    return Start(x, y, yaw, speed, first + int(drives.meets[row]), (when, ahead, turn), promise)


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

    def left_alone_by(self, start: Start) -> bool:
        """Whether the drive touches none of them up to where it meets the ego."""
        upto = np.s_[: start.meets + 1]
        near = np.hypot(self._x[:, upto] - start.x[upto], self._y[:, upto] - start.y[upto])
        reach = 0.5 * (np.hypot(self._length, self._width)[:, upto] + np.hypot(*self._size))
        at = np.nonzero(self._there[:, upto] & (near < reach))
        mine = Boxes(start.x[at[1]], start.y[at[1]], start.yaw[at[1]], *self._size)
        theirs = Boxes(self._x[at], self._y[at], self._yaw[at], self._length[at], self._width[at])
        return not np.any(overlap(mine, theirs))


@dataclass(frozen=True, eq=False)
class _Drives:
    """Drives of one candidate from where it enters that meet the ego, [drive, time]."""

    meets: Int[np.ndarray, " drive"]  # the step, after it entered
    shows_s: Float[np.ndarray, " drive"]  # after it entered: it has left its lane visibly
    gentle: Float[np.ndarray, " drive"]  # [m/s^2] the acceleration before
    x: Float[np.ndarray, "drive time"]
    y: Float[np.ndarray, "drive time"]
    yaw: Float[np.ndarray, "drive time"]
    speed: Float[np.ndarray, "drive time"]


@dataclass(frozen=True, eq=False)
class _Pair:
    """The candidate and the ego, from the step on at which the candidate is first seen."""

    first: int
    there: Bool[np.ndarray, " time"]  # the candidate in its log
    own: tuple[np.ndarray, ...]  # x, y [m] and yaw [rad] of the ego, [time] each
    mine: tuple[float, float]  # length and width of the candidate [m]
    its: tuple[float, float]  # and of the ego

    @classmethod
    def of(cls, scenario: Scenario, agent: int, ego: Tracks) -> "_Pair":
        valid, me = scenario.tracks.valid[agent], scenario.agents[agent]
        first = int(np.argmax(valid))
        own = ego.x[0, first:], ego.y[0, first:], ego.yaw[0, first:]
        size = scenario.ego.length, scenario.ego.width
        return cls(first, valid[first:], own, (me.length, me.width), size)

    @property
    def reach_m(self) -> float:
        """How far apart the middles of the two can be where they touch."""
        return float(0.5 * (np.hypot(*self.mine) + np.hypot(*self.its)) + _ROUNDING_M)

    def touch(self, x: np.ndarray, y: np.ndarray, yaw: np.ndarray) -> Bool[np.ndarray, "row time"]:
        """Whether the candidate touches the ego at places [row time]; asked only of those that are near."""
        reach = self.reach_m
        hits = np.zeros(np.broadcast_shapes(x.shape, self.there.shape), bool)
        some = np.flatnonzero(_within(x, self.own[0], reach) & _within(y, self.own[1], reach))
        hits[some] = ((x[some] - self.own[0]) ** 2 + (y[some] - self.own[1]) ** 2 < reach**2) & self.there
        row, step = np.nonzero(hits)
        mx, my, heading = (np.broadcast_to(values, hits.shape)[row, step] for values in (x, y, yaw))
        ex, ey, towards = (values[step] for values in self.own)
        hits[row, step] = overlap(Boxes(mx, my, heading, *self.mine), Boxes(ex, ey, towards, *self.its))
        return hits


def _within(
    values: Float[np.ndarray, "row *time"], own: Float[np.ndarray, " time"], reach: float
) -> Bool[np.ndarray, " row"]:
    """Rows with a value that is within reach of the ego's range."""
    return ((values > own.min() - reach) & (values < own.max() + reach)).any(axis=1)


def _drives(scenario: Scenario, agent: int, pair: _Pair, limits: DrivingLimits, lawful: bool) -> _Drives | None:
    """Those along every line that meet the ego late enough, pass no red light, and do not turn too hard."""
    near = Near.to(pair.own[0], pair.own[1], pair.reach_m)
    marked = [(line, _touched(line, pair)) for line in _lines(scenario, agent, near, lawful)]
    marked = [(line, touched) for line, touched in marked if touched.any()]
    if not marked:
        return None
    logged, lines = scenario.tracks.speed[agent], [line for line, _ in marked]
    begun = float(logged[pair.first]), _begun_accel(logged[pair.first :], scenario.dt)
    wanted = profiles(lines, begun[0], float(logged.max()), limits)
    wanted, driven = _driven(lines, begun, wanted, pair, scenario.dt, limits)
    found = []
    for index, (line, touched) in enumerate(marked):
        rows = np.flatnonzero(wanted.line == index)
        rows = rows[_enters(touched, driven[1][rows])]
        speed, travelled = (values[rows] for values in driven)
        some = _along(line, speed, travelled, np.abs(wanted.accel[rows]), pair, scenario.dt)
        found.append(_kept(some, _hardest_turn(some, scenario.dt) <= limits.lateral_accel))
    return _Drives(*(np.concatenate([getattr(one, f.name) for one in found]) for f in fields(_Drives)))


def _lines(scenario: Scenario, agent: int, near: Near, lawful: bool) -> Iterator[DriveLine]:
    """What its kind may drive or walk along, no faster than an attack lets it get."""
    kind = scenario.agents[agent].kind
    if kind == "pedestrian":
        return walked_lines(scenario, agent, near, lawful)
    most = MOST_SPEED_M_S.get(kind, np.inf) / OVER_LIMIT
    return (replace(line, limit=min(line.limit, most)) for line in lines_ahead(scenario, agent, near))


def _driven(
    lines: list[DriveLine], begun: tuple[float, float], wanted: Profiles, pair: _Pair, dt: float, limits: DrivingLimits
) -> tuple[Profiles, tuple[np.ndarray, np.ndarray]]:
    """The profiles with their speeds and distances; those that would run a red light stop there besides."""
    steps, front_m = len(pair.there), 0.5 * pair.mine[0]
    speed, travelled = drive(lines, begun, wanted, steps, dt, limits)
    runs = np.zeros(len(wanted.line), bool)
    for index, line in enumerate(lines):
        rows = np.flatnonzero(wanted.line == index) if line.stop_lines else []
        runs[rows] = _runs_red(line, travelled[rows] + front_m, np.full(len(rows), steps), pair.first)
    if not runs.any():
        return wanted, (speed, travelled)
    lights = Lights.of(lines, pair.first, steps, front_m)
    stopping = drive(lines, begun, wanted.take(runs), steps, dt, limits, lights)
    both = np.concatenate([np.arange(len(runs)), np.flatnonzero(runs)])
    return wanted.take(both), (np.concatenate([speed, stopping[0]]), np.concatenate([travelled, stopping[1]]))


def _touched(line: DriveLine, pair: _Pair) -> Bool[np.ndarray, "point time"]:
    """The places on a line at which the candidate would touch the ego at each step."""
    return pair.touch(line.points[:, :1], line.points[:, 1:], line.heading[:, None])


def _enters(touched: Bool[np.ndarray, "point time"], travelled: Float[np.ndarray, "drive time"]) -> Any:
    """Whether drives along a line come to a marked place, [drive]."""
    place = np.minimum(np.rint(travelled / SPACING_M).astype(int), len(touched) - 1)
    return touched[place, np.arange(touched.shape[1])].any(axis=1)


def _along(
    line: DriveLine, speed: np.ndarray, travelled: np.ndarray, accel: np.ndarray, pair: _Pair, dt: float
) -> _Drives:
    """Those of some drives along a line [drive, time] that may be starts."""
    x, y, yaw = line.at(travelled)
    hits = pair.touch(x, y, yaw)
    meets = np.argmax(hits, axis=1)
    shows_s = (travelled < line.shows_m).sum(axis=1) * dt
    drives = _Drives(meets, shows_s, accel, x, y, yaw, speed)
    kept = hits.any(axis=1) & ((pair.first + meets) * dt >= _EARLIEST_S)
    kept &= ~_runs_red(line, travelled + 0.5 * pair.mine[0], meets, pair.first)
    kept &= travelled[np.arange(len(meets)), meets] <= line.lawful_m
    if line.kerbs_m:
        walked = zip(travelled[kept], meets[kept], strict=True)
        kept[kept] = [not _steps_out(line, way, int(step), pair.own, dt) for way, step in walked]
    return _kept(drives, kept)


def _kept(drives: _Drives, kept: Bool[np.ndarray, " drive"]) -> _Drives:
    return _Drives(*(getattr(drives, f.name)[kept] for f in fields(_Drives)))


def _begun_accel(speed: Float[np.ndarray, " time"], dt: float) -> float:
    """The acceleration [m/s^2] with which a candidate is first seen."""
    steps = min(max(round(ACCEL_WINDOW_S / dt), 1), len(speed) - 1)
    return float(speed[steps] - speed[0]) / (steps * dt)


def _runs_red(
    line: DriveLine, front: Float[np.ndarray, "drive time"], meets: Int[np.ndarray, " drive"], first: int
) -> Bool[np.ndarray, " drive"]:
    """Whether drives along the line pass a red light before they meet the ego, the fronts being so far along [m]."""
    run = np.zeros(front.shape, bool)
    for stop in line.stop_lines:
        passes = (front[:, 1:] > stop.at_m) & (front[:, :-1] <= stop.at_m)
        run[:, 1:] |= passes & stop.red[first + 1 : first + front.shape[1]]
    return (run & (np.arange(front.shape[1]) <= meets[:, None])).any(axis=1)


def _steps_out(
    line: DriveLine, travelled: Float[np.ndarray, " time"], meets: int, own: tuple[np.ndarray, ...], dt: float
) -> bool:
    """Whether who walks comes onto the carriageway nearer than the ego needs to stop (`verdicts.offences_on_foot`)."""
    stepped = [int(np.searchsorted(travelled, kerb_m)) for kerb_m in line.kerbs_m]
    stepped = [step for step in stepped if 0 < step <= meets]
    if not stepped:
        return False
    moved = np.hypot(np.diff(own[0]), np.diff(own[1]))
    return float(moved[max(stepped) : meets].sum()) < safe_distance(float(moved[max(stepped) - 1]) / dt, 0.0)


def _hardest_turn(drives: _Drives, dt: float) -> Float[np.ndarray, " drive"]:
    """The greatest acceleration sideways [m/s^2] before each meets the ego, a mean over half a second.

    The fast turn hard into their lane.
    """
    sideways = 0.5 * (drives.speed[:, 1:] + drives.speed[:, :-1]) * np.diff(drives.yaw) / dt
    steps = max(round(_SIDEWAYS_S / dt), 1)
    summed = np.cumsum(np.pad(sideways, ((0, 0), (1, 0))), axis=1)
    mean = np.abs(summed[:, steps:] - summed[:, :-steps]) / steps
    before = np.arange(mean.shape[1]) + steps <= drives.meets[:, None]
    return np.max(mean, axis=1, initial=0.0, where=before)


def _contact(drives: _Drives, own: tuple[np.ndarray, ...]) -> Float[np.ndarray, "drive 2"]:
    """How far ahead of the ego's centre [m] a drive meets it, and at which angle to its heading [rad]."""
    turn = wrap(drives.yaw[np.arange(len(drives.meets)), drives.meets] - own[2][drives.meets])
    return np.stack([_ahead(drives, drives.meets, own), turn], axis=1)


def _ahead(
    drives: _Drives, step: Int[np.ndarray, " drive"], own: tuple[np.ndarray, ...]
) -> Float[np.ndarray, " drive"]:
    """How far ahead of the ego's centre [m] each drive is at a step of its own."""
    rows = np.arange(len(step))
    x, y, yaw = (values[step] for values in own)
    return (drives.x[rows, step] - x) * np.cos(yaw) + (drives.y[rows, step] - y) * np.sin(yaw)


def _promise(drives: _Drives, own: tuple[np.ndarray, ...], scenario: Scenario) -> Float[np.ndarray, " drive"]:
    """How likely a careful driver foresees the crash and the planner does not, by rules of thumb.

    Who runs the same way is suspected only while its centre is ahead of the ego's.
    """
    ahead, turn = _contact(drives, own).T
    seen_from = np.maximum(drives.meets - round(_SEEN_S / scenario.dt), 0)
    crossing = np.abs(turn) > ALONG_RAD
    unseen = ~crossing & (np.minimum(ahead, _ahead(drives, seen_from, own)) <= 0.0)
    leads = ~crossing & (ahead > _LEADS * scenario.ego.length)
    foreseen = np.clip(_foreseen_s(drives, own, scenario) / _NEEDED_S, 0.0, 1.0)
    return 1.5 * foreseen - 0.1 * drives.gentle + 0.5 * crossing - 1.0 * unseen - 0.4 * leads


def _promise_on_foot(drives: _Drives, pair: _Pair, dt: float) -> Float[np.ndarray, " drive"]:
    """What speaks against a walk: long in the ego's way before, where any planner sees it, and into its side."""
    x, y, yaw = pair.own
    left = (drives.y - y) * np.cos(yaw) - (drives.x - x) * np.sin(yaw)
    in_way = np.abs(left) < 0.5 * (pair.its[1] + pair.mine[1]) + _MARGIN_M
    before = drives.meets[:, None] - np.arange(in_way.shape[1])
    lingers_s = ((before > 0) & (before * dt <= _LINGERS_S) & in_way).sum(axis=1) * dt
    ahead = _ahead(drives, drives.meets, pair.own)
    return -1.0 * lingers_s / _LINGERS_S - 1.0 * (ahead < 0.5 * pair.its[0])


def _foreseen_s(drives: _Drives, own: tuple[np.ndarray, ...], scenario: Scenario) -> Float[np.ndarray, " drive"]:
    """For how long before the crash a careful driver would have seen it coming [s].

    That is: were the candidate to go on with its speed and its turn, it would be where the ego then is, or would be
    half a second sooner or later; and it crosses the ego's way, or shows that it leaves its lane.
    """
    dt, rows = scenario.dt, np.arange(len(drives.meets))
    near_m = 0.5 * (scenario.ego.length + scenario.ego.width)
    lasts, foreseen = np.ones(len(rows), bool), np.zeros(len(rows))
    for before in range(2, round(_NEEDED_S / dt) + 1, 2):
        step = drives.meets - before
        at, past = np.maximum(step, 0), np.maximum(step - round(_TURN_OVER_S / dt), 0)
        x, y, yaw, speed = (values[rows, at] for values in (drives.x, drives.y, drives.yaw, drives.speed))
        turned = (yaw - drives.yaw[rows, past]) * before / np.maximum(at - past, 1)
        chord = speed * before * dt * np.sinc(0.5 * turned / np.pi)
        there = x + chord * np.cos(yaw + 0.5 * turned), y + chord * np.sin(yaw + 0.5 * turned)
        late = [np.clip(drives.meets + shift, 0, len(own[0]) - 1) for shift in _slack(dt)]
        away = np.min([np.hypot(there[0] - own[0][when], there[1] - own[1][when]) for when in late], axis=0)
        angle = np.abs(wrap(yaw + turned - own[2][drives.meets]))
        suspected = ((angle > FORESIGHT.along_rad) & (angle < FORESIGHT.against_rad)) | (step * dt >= drives.shows_s)
        lasts &= (step >= 0) & (away < near_m) & suspected
        foreseen[lasts] = before * dt
    return foreseen


def _slack(dt: float) -> list[int]:
    """Steps by which the ego may be earlier or later."""
    spacing = FORESIGHT.spacing_s / dt
    return [round(spacing * index) for index in range(-FORESIGHT.slack, FORESIGHT.slack + 1)]
