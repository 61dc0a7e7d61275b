"""Scenarios from SUMO: run it in a process of its own at 10 Hz and cut windows out of its traffic."""

import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from regents_cosim.cases.provenance import sha256_of
from regents_cosim.errors import NoWindowError, SumoError
from regents_cosim.scenario import Scenario
from regents_cosim.simulators.sumo_process import running_sumo
from regents_cosim.sources.recording import DistinctIds, GrowingRecording, Recording, left_out
from regents_cosim.sources.sumo_config import SumoInput, SumoOptions, read_input, write_config
from regents_cosim.sources.sumo_files import require_bounded
from regents_cosim.sources.sumo_net import read_road_map
from regents_cosim.sources.sumo_types import VehicleType, is_articulated, kind_of, require_size
from regents_cosim.sources.windows import Prefer, RecordingOrigin, Windows, choose_windows, draw_slots
from regents_cosim.system.scratch import scratch_folder
from regents_cosim.system.workers import result_of, run_isolated, submit

STEP_S = 0.1
_SPAN_S = 600.0  # recorded where the configuration names no end


def record_sumo(
    source: SumoInput,
    *,
    count: int = 8,
    seed: int = 0,
    horizon_s: float = 8.0,
    radius_m: float = 100.0,
    prefer: Prefer = "conflicts",
    executor: Executor | None = None,
    tell: Callable[[str], None] = warnings.warn,
) -> list[Scenario]:
    """Up to `count` Scenarios, fewer where the traffic holds no more; the same seed gives the same.

    Each is a window of `horizon_s` between the configuration's begin and end (600 s where it
    names none), as `windows.choose_windows` picks them. Lane changes take 3 s
    (`--lanechange.duration 3`) unless SUMO's sublane model is on, since by default SUMO's
    vehicles jump between lanes. Persons are left out, which `tell` is told. Times are those of SUMO's own logs.

    Raises RegentsError for input that is missing or broken, SumoError with SUMO's own words
    where it refuses, NoWindowError where no window is found.
    """
    windows = Windows(count, seed, horizon_s, radius_m, prefer=prefer, ego=source.ego)
    options = read_input(source)
    _require_microscopic(options)
    require_bounded((*options.routes, *options.additional), options.others.values())
    road = read_road_map(options.net)
    job = SumoRecordingJob(options, windows)
    recordings = run_isolated(record_slots, job) if executor is None else result_of(submit(executor, record_slots, job))
    for line in left_out(recordings):
        tell(line)
    origin = RecordingOrigin("sumo", options.file.name, sha256_of(options.file))
    return choose_windows(recordings, road, origin, windows)


def _require_microscopic(options: SumoOptions) -> None:
    """Raise SumoError for a mesoscopic simulation, whose vehicles have no places on the road."""
    words = [word.partition("=") for word in options.extra]
    named = [value for name, _, value in words if name == "--mesosim"]
    value = named[-1] if named else options.others.get("mesosim", "false")
    if value.strip().lower() not in ("false", "0", "no", "off", "-"):
        raise SumoError(
            f"{options.file}: a mesoscopic simulation (mesosim), whose vehicles stand in queues and have no place or "
            "heading of their own; expected a microscopic one (take the option out, or add -- --mesosim=false)"
        )


@dataclass(frozen=True)
class SumoRecordingJob:
    """One run of SUMO."""

    options: SumoOptions
    windows: Windows


def record_slots(job: SumoRecordingJob) -> list[Recording]:
    """Run SUMO and read the traffic in slots drawn by seed. Call it in a worker process."""
    with scratch_folder() as folder, running_sumo(sumo_command(job, folder)) as sumo:
        return list(_recordings(sumo, job))


def sumo_command(job: SumoRecordingJob, folder: Path) -> list[str]:
    """The options that SUMO is started with; a configuration is written to `folder`."""
    options = job.options
    forced = {"step-length": str(STEP_S), "seed": str(job.windows.seed)}
    defaults = {"time-to-teleport": "-1", "no-step-log": "true", "no-warnings": "true"}
    sublane = "lateral-resolution" in options.others or any("lateral-resolution" in word for word in options.extra)
    if not sublane:
        defaults["lanechange.duration"] = "3"
    return ["-c", str(write_config(options, folder, forced, defaults)), *options.extra]


def _recordings(sumo: ModuleType, job: SumoRecordingJob) -> Iterator[Recording]:
    begin_s, end_s = _span(sumo)
    steps = job.windows.steps(STEP_S)
    total = round((end_s - begin_s) / STEP_S) // steps
    if total == 0:
        raise NoWindowError(
            f"no window found: a horizon of {job.windows.horizon_s:g} s does not fit into the simulation, which lasts "
            f"{end_s - begin_s:g} s ({begin_s:g} to {end_s:g}); choose a shorter --horizon or a later --end"
        )
    types: dict[str, VehicleType] = {}
    names = DistinctIds()
    done = 0
    for index in draw_slots(total, job.windows):
        if sumo.simulation.getMinExpectedNumber() == 0:
            return  # SUMO expects no more traffic
        first = index * steps
        if first > done:
            sumo.simulationStep(begin_s + first * STEP_S)
        done = first + steps
        slot = GrowingRecording(round(begin_s + first * STEP_S, 6), STEP_S, steps, names=names, ego=job.windows.ego)
        _fill(slot, sumo, types)
        yield slot.finish(types)


def _span(sumo: ModuleType) -> tuple[float, float]:
    """Begin and end of the simulation [s]."""
    if abs(sumo.simulation.getDeltaT() - STEP_S) > 1e-9:
        raise SumoError(f"--step-length {sumo.simulation.getDeltaT():g}: recordings are made at {STEP_S} s only")
    begin_s, end_s = sumo.simulation.getTime(), sumo.simulation.getEndTime()
    return begin_s, end_s if end_s >= 0 else begin_s + _SPAN_S


def _fill(slot: GrowingRecording, sumo: ModuleType, types: dict[str, VehicleType]) -> None:
    vehicle, light = sumo.vehicle, sumo.trafficlight
    position, angle, type_of = vehicle.getPosition3D, vehicle.getAngle, vehicle.getTypeID
    add = slot.rows.append
    slot.letters.update((name, []) for name in light.getIDList())
    for step in range(slot.steps):
        sumo.simulationStep()
        slot.persons.update(sumo.person.getIDList())
        for name in vehicle.getIDList():
            x, y, z = position(name)
            kind = type_of(name)
            one = slot.named(name, kind)
            add((one, step, x, y, angle(name), z))
            if one not in types:
                types[one] = _type_of(vehicle, name)
        for name, letters in slot.letters.items():
            letters.append(light.getRedYellowGreenState(name))


def _type_of(vehicle: ModuleType, name: str) -> VehicleType:
    vehicle_class = vehicle.getVehicleClass(name)
    articulated = is_articulated(vehicle_class, vehicle.getShapeClass(name))
    length, width = vehicle.getLength(name), vehicle.getWidth(name)
    require_size(f"vehicle {name!r}", length, width)
    return VehicleType(kind_of(vehicle_class), length, width, articulated)
