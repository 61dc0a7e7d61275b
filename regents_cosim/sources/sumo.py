"""Scenarios from SUMO: runs it in a separate process at 10 Hz and cuts windows out of its traffic."""

import math
import re
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import ModuleType

from regents_cosim.cases.provenance import sha256_of
from regents_cosim.errors import NoWindowError, SumoError
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.scenario.scenario import LeftOut, Scenario
from regents_cosim.simulators import ANY_EGO, STEP_S
from regents_cosim.simulators.sumo.config import SumoInput, SumoOptions, other_traffic, read_input, write_config
from regents_cosim.simulators.sumo.files import existing
from regents_cosim.simulators.sumo.options import MESOSCOPIC
from regents_cosim.simulators.sumo.process import end_sumo_process, in_sumo_process, more_traffic, running_sumo
from regents_cosim.simulators.sumo.types import VehicleType, require_size, vehicle_type_of
from regents_cosim.sources.conflicts import Possible, possible_conflict
from regents_cosim.sources.left_out import told_of_recordings
from regents_cosim.sources.recording import DistinctIds, GrowingRecording, Recording
from regents_cosim.sources.windows import USUAL, RecordingOrigin, Windows, choose_windows, draw_slots
from regents_cosim.system.files.atomic import scratch_folder
from regents_cosim.system.workers import result_of, submit

_SPAN_S = 600.0  # recording time where the configuration names no end
# SUMO cuts a person's path around a corner into this many pieces, each with a jump sideways. In Bologna
# (acosta_persontrips, 120 s, 536 persons) SUMO's default of 4 gives 534 jumps that cut a track in two, 32 pieces give
# 46 (SUMO 1.28).
_CORNERS, _FINE = "pedestrian.striping.walkingarea-detail", "32"
_CONTAINERS = LeftOut("unlogged", 0, detail="containers, which SUMO shows in its fcd-output alone: record --fcd")
_LIMITS = "variable speed signs and calibrators move SUMO's traffic; cases have the speed limits of the network"
# A model of persons without a state: they are where the clock says, which after a step shows the next one.
_MOVED_BY_CLOCK = "nonInteracting"
_WARNINGS = "warnings.txt"
# Warnings of SUMO about road users that it leaves out, with their ids.
_IGNORED = re.compile(r"(?:departure time, ignoring|Removing vehicle) '([^']+)'")
_ACCESS = 4  # the stage of a person between a stop and its platform: on stairs or in a lift


def record_sumo(
    source: SumoInput,
    windows: Windows = USUAL,
    *,
    executor: Executor | None = None,
    tell: Callable[[str], None] = warnings.warn,
) -> list[Scenario]:
    """Up to `windows.count` Scenarios, fewer where the traffic holds no more; the same seed gives the same ones.

    Each is a window with the ego of `source` between the configuration's begin and end (600 s where it names none),
    chosen by `windows.choose_windows`. Lane changes take 3 s (`--lanechange.duration 3`) unless SUMO's sublane model is
    on, since by default SUMO's vehicles jump between lanes. Persons are recorded while they walk or wait; in vehicles,
    in lifts and on stairs they are left out, and `tell` is called with a message. They walk around corners in finer
    steps than by SUMO's default, unless the configuration sets these (`--pedestrian.striping.walkingarea-detail`).
    Times are those of SUMO's logs.

    Raises RegentsError for input that is missing or broken, SumoError with SUMO's own words where it refuses,
    NoWindowError where no window is found.
    """
    told = set[str]()

    def tell_once(line: str) -> None:
        if line not in told:
            told.add(line)
            tell(line)

    try:
        return _record(source, replace(windows, ego=source.ego), executor, tell_once)
    finally:
        end_sumo_process()


def _record(
    source: SumoInput, windows: Windows, executor: Executor | None, tell: Callable[[str], None]
) -> list[Scenario]:
    from regents_cosim.simulators.sumo.net import read_road_map  # imports sumolib, which SUMO's process does not need

    options = read_input(source)
    if options.is_on("mesosim"):
        raise SumoError(f"{options.file}: {MESOSCOPIC} (take the option out, or add -- --mesosim=false)")
    changed = other_traffic(options, *_settings(options, windows)) if source.config else ""
    road = read_road_map(options.net)
    origin = RecordingOrigin("sumo", options.file.name, sha256_of(options.file))
    choose = partial(_windows, road=road, origin=origin, executor=executor, tell=tell)
    found = _found(SumoRecordingJob(options, windows), choose)
    signs = _LIMITS if any(one.limits for one in options.files.values()) else ""
    for said in filter(None, (changed, options.turned_off(), signs)):  # where there is an error, that alone is said
        tell(said)
    return found


def _found(job: "SumoRecordingJob", choose: Callable[["SumoRecordingJob"], list[Scenario]]) -> list[Scenario]:
    """The windows from one run of SUMO, or from a second one that reads most of the time."""
    windows = job.windows
    try:
        found = choose(job)
    except NoWindowError:
        if not _may_look_longer(windows):
            raise
        found = []
    if not _may_look_longer(windows) or _suffice(found, windows):
        return found
    return choose(replace(job, longer=True))


def _suffice(found: list[Scenario], windows: Windows) -> bool:
    """Whether all windows have a possible conflict, and the ego has to give way in half of them."""
    possible = [possible_conflict(one, windows.others) for one in found]
    return sum(map(bool, possible)) >= windows.count <= 2 * possible.count(Possible.WITH_RIGHT_OF_WAY)


def _may_look_longer(windows: Windows) -> bool:
    return windows.prefer != "none" and windows.ego == ANY_EGO


def _windows(
    job: "SumoRecordingJob",
    road: RoadMap,
    origin: RecordingOrigin,
    executor: Executor | None,
    tell: Callable[[str], None],
) -> list[Scenario]:
    """The windows from one run of SUMO."""
    recordings, ignored = (
        in_sumo_process(record_slots, job) if executor is None else result_of(submit(executor, record_slots, job))
    )
    for line in (*told_of_recordings(recordings), *_told_of(ignored)):
        tell(line)
    if any(one.containers for one in job.options.files.values()):
        recordings = [replace(one, left_out=(_CONTAINERS,)) for one in recordings]
    return choose_windows(recordings, road, origin, job.windows)


@dataclass(frozen=True)
class SumoRecordingJob:
    """The parameters of one run of SUMO."""

    options: SumoOptions
    windows: Windows
    longer: bool = False  # record most of the time, in overlapping slots


def record_slots(job: SumoRecordingJob) -> tuple[list[Recording], dict[str, str]]:
    """Run SUMO and record the traffic in slots drawn by seed. Call it in a worker process.

    Also returns the road users that SUMO itself ignores, each with its words.
    """
    with scratch_folder() as folder:
        with running_sumo(sumo_command(job, folder)) as sumo:
            slots = list(_recordings(sumo, job))
        said = [line for file in existing(folder / _WARNINGS) for line in file.read_text(errors="replace").splitlines()]
    return slots, {found[1]: line.removeprefix("Warning: ") for line in said if (found := _IGNORED.search(line))}


def _told_of(ignored: dict[str, str]) -> Iterator[str]:
    if ignored:
        first, more = next(iter(ignored.values())), len(ignored) - 1
        yield f"{len(ignored)} road user{'s' * (more > 0)} ignored by SUMO itself: {first}{' ...' * (more > 0)}"


def sumo_command(job: SumoRecordingJob, folder: Path) -> list[str]:
    """The command line of SUMO; a configuration is written to `folder`."""
    forced, defaults = _settings(job.options, job.windows)
    said = {"no-step-log": "true", "error-log": str(folder / _WARNINGS)}
    return ["-c", str(write_config(job.options, folder, forced, defaults | said))]


def _settings(options: SumoOptions, windows: Windows) -> tuple[dict[str, str], dict[str, str]]:
    """Options that replace those of the configuration, and options that fill in missing ones."""
    # With several threads SUMO gives other traffic each time, whatever the seed.
    forced = {"step-length": str(STEP_S), "seed": str(windows.seed), "threads": "1"}
    defaults = {"time-to-teleport": "-1", _CORNERS: _FINE}
    return forced, defaults if _has_sublanes(options) else defaults | {"lanechange.duration": "3"}


def _has_sublanes(options: SumoOptions) -> bool:
    try:
        return float(options.says("lateral-resolution") or 0.0) > 0.0  # 0 and -1 turn it off
    except ValueError:
        return False  # not a number, which SUMO reports


def _recordings(sumo: ModuleType, job: SumoRecordingJob) -> Iterator[Recording]:
    begin_s, end_s = _span(sumo)
    steps = job.windows.steps(STEP_S)
    total = round((end_s - begin_s) / STEP_S) // steps
    if total == 0:
        raise NoWindowError(
            f"no window found: a horizon of {job.windows.horizon_s:g} s does not fit into the simulation, which lasts "
            f"{end_s - begin_s:g} s ({begin_s:g} to {end_s:g}), as it takes {steps * STEP_S:g} s in all "
            "(choose a shorter `horizon` or a later `end`)"
        )
    types: dict[str, VehicleType] = {}
    ahead_s = STEP_S if job.options.says("pedestrian.model") == _MOVED_BY_CLOCK else 0.0
    names = DistinctIds()
    waiting, done = deque(_begins(round((end_s - begin_s) / STEP_S), steps, job)), 0
    reading = deque[tuple[int, GrowingRecording]]()  # the slots that are being recorded, with their first steps
    while waiting or reading:
        if waiting and not more_traffic(sumo):
            waiting.clear()
            continue
        if not reading and waiting[0] > done:
            done = waiting[0]
            sumo.simulationStep(begin_s + done * STEP_S)
        if waiting and waiting[0] == done:
            slot = GrowingRecording(
                round(begin_s + waiting.popleft() * STEP_S, 6), STEP_S, steps, names=names, ego=job.windows.ego
            )
            reading.append((done, slot))
        sumo.simulationStep()
        _read(sumo, [(slot, done - first) for first, slot in reading], types, ahead_s)
        done += 1
        if done - reading[0][0] == steps:
            yield reading.popleft()[1].finish()


def _begins(run: int, steps: int, job: SumoRecordingJob) -> list[int]:
    """The first steps of the slots to record in a run of `steps` steps."""
    if not job.longer:
        return [index * steps for index in draw_slots(run // steps, job.windows)]
    apart = max(steps // 2, 1)
    return [index * apart for index in draw_slots((run - steps) // apart + 1, job.windows, longer=True)]


def _span(sumo: ModuleType) -> tuple[float, float]:
    """Begin and end of the simulation [s]."""
    if abs(sumo.simulation.getDeltaT() - STEP_S) > 1e-9:
        raise SumoError(f"--step-length {sumo.simulation.getDeltaT():g}: recordings are made at {STEP_S} s only")
    begin_s, end_s = sumo.simulation.getTime(), sumo.simulation.getEndTime()
    return begin_s, end_s if end_s >= 0 else begin_s + _SPAN_S


def _read(
    sumo: ModuleType, slots: Sequence[tuple[GrowingRecording, int]], types: dict[str, VehicleType], ahead_s: float
) -> None:
    """Add the current state of the traffic to the given slots, each at its step; persons are shown `ahead_s` later."""
    vehicle, light = sumo.vehicle, sumo.trafficlight
    position, angle, type_of = vehicle.getPosition3D, vehicle.getAngle, vehicle.getTypeID
    for name in vehicle.getIDList():
        (x, y, z), yaw, kind = position(name), angle(name), type_of(name)
        if kind not in types or "@" in kind:  # a type of its own, whose length changes where a train is split
            types[kind] = vehicle_type_of(vehicle, name)
        for slot, step in slots:
            slot.rows.append((slot.named(name, kind, types[kind]), step, x, y, yaw, z))
    _read_persons(sumo.person, slots, types, ahead_s)
    for name in light.getIDList():
        letters = light.getRedYellowGreenState(name)
        for slot, _ in slots:
            slot.letters.setdefault(name, []).append(letters)


def _read_persons(
    person: ModuleType, slots: Sequence[tuple[GrowingRecording, int]], types: dict[str, VehicleType], ahead_s: float
) -> None:
    """Add the persons who walk or wait, and note the others as left out."""
    for name in person.getIDList():
        if person.getVehicle(name) or person.getStage(name).type == _ACCESS:
            for slot, _ in slots:
                slot.riders.add(name)
            continue
        (x, y, z), yaw, kind = person.getPosition3D(name), person.getAngle(name), f"person {person.getTypeID(name)}"
        if ahead_s:
            way_m = person.getSpeed(name) * ahead_s
            x, y = x - way_m * math.sin(math.radians(yaw)), y - way_m * math.cos(math.radians(yaw))
        if kind not in types:
            length, width = person.getLength(name), person.getWidth(name)
            require_size(f"person {name!r}", length, width)
            types[kind] = VehicleType("pedestrian", length, width)  # whatever the class of the type
        for slot, step in slots:
            slot.rows.append((slot.person(name, types[kind]), step, x, y, yaw, z))
