"""Starts of searches: drives of a candidate on lawful paths, timed so that it would meet the ego.

A descent from the log gets stuck where the two would have to meet at another time, or the candidate would have to take
another turn: the gradient pulls straight across, where a median, the law or other traffic forbids it. So along each
line that the candidate may take (`drive_lines`), the places and steps are marked at which it would touch the ego on its
unattacked track (the path-time space of Kant and Zucker 1986). Those of many speed profiles (`speed_profiles`) that
enter a marked place are starts. The first ones are those that a driver in the ego's place would see coming for some
seconds: gentle, and from the side.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.attacks.descent.actions import to_actions
from regents_cosim.attacks.descent.driving_limits import within_bounds
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.job import SearchJob
from regents_cosim.attacks.starts.drive_lines import SPACING_M, AlongLines, DriveLine
from regents_cosim.attacks.starts.marked_lines import marked_lines, marked_walked_lines
from regents_cosim.attacks.starts.meeting import MeetingDrives, MeetingPair, contact_of
from regents_cosim.attacks.starts.promise import promise_of, promise_on_foot
from regents_cosim.attacks.starts.speed_profiles import DRIVING, WALKING, drive, profiles
from regents_cosim.attacks.starts.walked_lines import walk
from regents_cosim.geometry.lines import midway, steps_along
from regents_cosim.mirror.actions import OF_SMOOTH_TRACKS, fit_controls
from regents_cosim.mirror.bicycle import ControlArrays, Motion, clip
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.programs.on_device import on_device, seen_from
from regents_cosim.mirror.world import World, scene_origin
from regents_cosim.norms.limits import ACCEL_WINDOW_S, safe_distance, steps_of
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.verdicts.law.offences import is_unlawful
from regents_cosim.verdicts.ordinary import DrivingLimits

_EARLIEST_S = 1.5  # no driver could react to an earlier crash
_SIDEWAYS_S = 0.5  # time over which turning is averaged, as lines have kinks
_ALIKE = np.array([0.6, 2.0, np.deg2rad(30.0)])  # contacts that differ by less are alike: s, m, rad
_ALIKE_ON_FOOT = np.array([0.3, 0.7, np.deg2rad(30.0)])


@dataclass(frozen=True, eq=False)
class Start:
    """A drive of one candidate over the horizon, [time] in the map's frame; it stands still before it enters."""

    x: Float[np.ndarray, " time"]  # [m]
    y: Float[np.ndarray, " time"]  # [m]
    yaw: Float[np.ndarray, " time"]  # [rad]
    speed: Float[np.ndarray, " time"]  # [m/s]
    meets: int  # the step at which it first overlaps the ego
    contact: tuple[float, float, float]  # s, m, rad: time, distance ahead of the ego's centre, angle
    promise: float  # greater values are tried earlier


def followed(scenario: Scenario, job: SearchJob, found: Sequence[Start], most: int) -> list[ControlArrays]:
    """The actions [1, step] with which a job's candidate follows drives, of which there are at most `most`."""
    if not found:
        return []
    padded = [*found, *[found[-1]] * (most - len(found))]  # so that one compiled program serves any number
    origin = scene_origin(scenario)
    begun = float(np.asarray(job.world.start.yaw)[int(job.searched.first)])
    x, y, yaw, speed = (np.stack([getattr(s, name) for s in padded]) for name in ("x", "y", "yaw", "speed"))
    yaw = yaw + 2.0 * np.pi * np.round((begun - yaw[:, :1]) / (2.0 * np.pi))
    here = seen_from(np.stack([x, y], axis=-1), origin)
    wanted = Motion(*(on_device(v, np.float32) for v in (here[..., 0], here[..., 1], yaw, speed)))
    world = replace(job.world.without_road(), bounds=job.world.bounds)
    actions = jax.tree.map(np.asarray, to_actions(_allowed(world, job.searched, _fitted(job, wanted))))
    return [jax.tree.map(lambda values, k=k: on_device(values[k], np.float32), actions) for k in range(len(found))]


def _fitted(job: SearchJob, wanted: Motion) -> ControlArrays:
    """The controls [drive, step] with which the job's candidate follows drives [drive, time].

    Walks consist of such controls (`walking`).
    """

    def repeated(of_agents: Array) -> Array:
        mine = np.asarray(of_agents)[int(job.searched.first)]
        return on_device(np.repeat(mine[None], len(wanted.x), axis=0), mine.dtype.type)

    start, moving, mobility = jax.tree.map(repeated, (job.world.start, job.world.moving, job.world.mobility))
    if mobility.dynamics == "bicycle" and mobility.walks is not None and bool(mobility.walks[0]):
        return clip(mobility.controls_between(wanted, job.world.dt))
    there = on_device(np.ones(wanted.x.shape), np.bool_)
    return fit_controls(wanted, there, start, moving, job.world.dt, mobility, OF_SMOOTH_TRACKS)


@compiled
def _allowed(world: World, searched: SearchedAgents, fitted: ControlArrays) -> ControlArrays:
    """The nearest controls to those of each drive within the world's bounds [drive searched step]."""
    return jax.vmap(lambda own: within_bounds(world, searched, jax.tree.map(lambda values: values[None], own)))(fitted)


def starts(
    scenario: Scenario,
    agent: int,
    ego: Tracks,
    most: int,
    limits: DrivingLimits,
    lawful: bool = True,
    most_lines: int | None = None,
) -> list[Start]:
    """At most `most` drives of `agent` that meet the `ego` [1, time] on its track, the most promising first.

    They keep to the `limits`. Walks of pedestrians need not be `lawful`; drives of vehicles always are. If `most_lines`
    is given, only the first lines are tried.
    """
    pair = MeetingPair.of(scenario, agent, ego)
    drives = _drives(scenario, agent, pair, limits, lawful, most_lines)
    if drives is None:
        return []
    contact = np.column_stack([(pair.first + drives.meets) * scenario.dt, contact_of(drives, pair.own)])
    promise, alike = promise_of(drives, pair.own, scenario), _ALIKE
    walks = scenario.agents[agent].kind == "pedestrian"
    if walks:
        promise, alike = promise + promise_on_foot(drives, pair, scenario.dt), _ALIKE_ON_FOOT
    may_walk = partial(_keeps_law, scenario, agent, ego) if walks and lawful else lambda _: True
    chosen, left = list[Start](), np.ones(len(promise), bool)
    for row in np.argsort(-promise, kind="stable").tolist():
        if len(chosen) == most:
            break
        start = _start(drives, row, pair.first, contact[row], float(promise[row])) if left[row] else None
        if start is not None and may_walk(start):
            chosen.append(start)
            left &= (np.abs(contact - contact[row]) > alike).any(axis=1)
    return chosen


def _start(drives: MeetingDrives, row: int, first: int, contact: Float[np.ndarray, " 3"], promise: float) -> Start:
    """One drive over the whole horizon; the candidate enters at step `first`."""
    x, y, yaw, speed = (
        np.concatenate([np.full(first, values[row, 0]), values[row]])
        for values in (drives.x, drives.y, drives.yaw, drives.speed)
    )
    when, ahead, turn = contact.tolist()
    return Start(x, y, yaw, speed, first + int(drives.meets[row]), (when, ahead, turn), promise)


def with_drive(tracks: Tracks, ego: Tracks, agent: int, drive: Start) -> Tracks:
    """The tracks with the ego on its own [1, time] and `agent` on a drive, without controls."""
    moved = {}
    for name in ("x", "y", "yaw", "speed"):
        values = np.array(getattr(tracks, name))
        values[0], values[agent] = getattr(ego, name)[0], getattr(drive, name)
        moved[name] = values
    return replace(tracks, **moved, accel=None, curvature=None)


def _keeps_law(scenario: Scenario, agent: int, ego: Tracks, start: Start) -> bool:
    """Whether a pedestrian breaks no law until it meets the `ego`: it cuts the corners of its lawful line."""
    return not is_unlawful(scenario, with_drive(scenario.tracks, ego, agent, start), agent, start.meets)


def _drives(
    scenario: Scenario, agent: int, pair: MeetingPair, limits: DrivingLimits, lawful: bool, most_lines: int | None
) -> MeetingDrives | None:
    """The drives along every line that meet the ego late enough, pass no red light, and do not turn too hard."""
    walks = scenario.agents[agent].kind == "pedestrian"
    logged = scenario.tracks.speed[agent]
    begun = float(logged[pair.first]), _begun_accel(logged[pair.first :], scenario.dt)
    if walks:
        begun = begun[0], min(max(begun[1], -limits.braking), limits.accel)
        marked = marked_walked_lines(scenario, agent, pair, lawful)
    else:
        marked = marked_lines(scenario, agent, pair, begun, limits, _EARLIEST_S, most_lines)
    if not marked:
        return None
    lines = [line for line, _ in marked]
    wanted = profiles(lines, begun[0], float(logged.max()), limits, WALKING if walks else DRIVING)
    speed, travelled = drive(lines, begun, wanted, len(pair.there), scenario.dt, limits)
    walked = None
    if walks:
        tracks, at = scenario.tracks, (agent, pair.first)
        pose = float(tracks.x[at]), float(tracks.y[at]), float(tracks.yaw[at])
        walked = walk(lines, wanted.line, pose, speed, scenario.dt, limits)
    found = []
    for index, (line, touched) in enumerate(marked):
        rows = np.flatnonzero(wanted.line == index)
        if walked is None:
            rows = rows[_enters(touched, travelled[rows])]
            placed = AlongLines(travelled[rows], *line.at(travelled[rows]))
        else:
            placed = walked.take(rows)
        some = _along(line, speed[rows], placed, np.abs(wanted.accel[rows]), pair, scenario.dt)
        found.append(_kept(some, _hardest_turn(some, scenario.dt) <= limits.lateral_accel))
    return MeetingDrives(*(np.concatenate([getattr(one, f.name) for one in found]) for f in fields(MeetingDrives)))


def _enters(touched: Bool[np.ndarray, "point time"], travelled: Float[np.ndarray, "drive time"]) -> Any:
    """Whether each drive along a line comes to a marked place, [drive]."""
    place = np.minimum(np.rint(travelled / SPACING_M).astype(int), len(touched) - 1)
    return touched[place, np.arange(touched.shape[1])].any(axis=1)


def _along(
    line: DriveLine, speed: np.ndarray, placed: AlongLines, accel: np.ndarray, pair: MeetingPair, dt: float
) -> MeetingDrives:
    """Those of some drives along a line [drive, time] that may be starts."""
    travelled, x, y, yaw = placed
    hits = pair.touch(x, y, yaw)
    meets = np.argmax(hits, axis=1)
    shows_s = (travelled < line.shows_m).sum(axis=1) * dt
    drives = MeetingDrives(meets, shows_s, accel, np.full(len(meets), line.yields), x, y, yaw, speed)
    kept = hits.any(axis=1) & ((pair.first + meets) * dt >= _EARLIEST_S)
    kept &= ~_runs_red(line, travelled + 0.5 * pair.mine[0], meets, pair.first)
    kept &= travelled[np.arange(len(meets)), meets] <= line.lawful_m
    if line.kerbs_m:
        walked = zip(travelled[kept], meets[kept], strict=True)
        kept[kept] = [not _steps_out(line, way, int(step), pair.own, dt) for way, step in walked]
    return _kept(drives, kept)


def _kept(drives: MeetingDrives, kept: Bool[np.ndarray, " drive"]) -> MeetingDrives:
    return MeetingDrives(*(getattr(drives, f.name)[kept] for f in fields(MeetingDrives)))


def _begun_accel(speed: Float[np.ndarray, " time"], dt: float) -> float:
    """The acceleration [m/s^2] of a candidate when it is first seen."""
    steps = min(max(int(steps_of(np, ACCEL_WINDOW_S, dt)), 1), len(speed) - 1)
    return float(speed[steps] - speed[0]) / (steps * dt)


def _runs_red(
    line: DriveLine, front: Float[np.ndarray, "drive time"], meets: Int[np.ndarray, " drive"], first: int
) -> Bool[np.ndarray, " drive"]:
    """Whether drives pass a red light before they meet the ego, with their fronts at `front` [m] along the line."""
    run = np.zeros(front.shape, bool)
    for stop in line.stop_lines:
        passes = (front[:, 1:] > stop.at_m) & (front[:, :-1] <= stop.at_m)
        run[:, 1:] |= passes & stop.red[first + 1 : first + front.shape[1]]
    return (run & (np.arange(front.shape[1]) <= meets[:, None])).any(axis=1)


def _steps_out(
    line: DriveLine, travelled: Float[np.ndarray, " time"], meets: int, own: tuple[np.ndarray, ...], dt: float
) -> bool:
    """Whether a pedestrian steps onto the carriageway too near for the ego to stop
    (`verdicts.law.offences_on_foot`).
    """
    stepped = [int(np.searchsorted(travelled, kerb_m)) for kerb_m in line.kerbs_m]
    stepped = [step for step in stepped if 0 < step <= meets]
    if not stepped:
        return False
    moved = steps_along(*own[:2])
    return float(moved[max(stepped) : meets].sum()) < safe_distance(float(moved[max(stepped) - 1]) / dt, 0.0)


def _hardest_turn(drives: MeetingDrives, dt: float) -> Float[np.ndarray, " drive"]:
    """The greatest lateral acceleration [m/s^2] of each drive before it meets the ego, a mean over half a second.

    Fast drives turn hard into their lane.
    """
    sideways = midway(drives.speed) * np.diff(drives.yaw) / dt
    steps = max(round(_SIDEWAYS_S / dt), 1)
    summed = np.cumsum(np.pad(sideways, ((0, 0), (1, 0))), axis=1)
    mean = np.abs(summed[:, steps:] - summed[:, :-steps]) / steps
    before = np.arange(mean.shape[1]) + steps <= drives.meets[:, None]
    return np.max(mean, axis=1, initial=0.0, where=before)
