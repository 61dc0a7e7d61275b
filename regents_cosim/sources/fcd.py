"""Scenarios from SUMO's fcd-output and a network, without running SUMO.

An fcd-output holds no sizes: they come from the vTypes of route or additional files. A vehicle of an unknown type
counts as a car of 5.0 m x 1.8 m, a person of an unknown type has SUMO's default of 0.215 m x 0.478 m, and a warning
says so. It holds no signals either. Write the log with `--precision 6`: with SUMO's default of two decimals the speeds,
which are derived from positions, are off by about 0.1 m/s.
"""

import csv
import io
import itertools
import math
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from regents_cosim.cases.provenance import sha256_of
from regents_cosim.checks.bounded import open_bounded
from regents_cosim.checks.work import Work
from regents_cosim.checks.xml_input import children, unpacked_limit
from regents_cosim.errors import InputError, LogError, NoWindowError, require_file
from regents_cosim.geometry.frames import Pose, to_sumo, wrap
from regents_cosim.geometry.jumps import jumps
from regents_cosim.geometry.lines import NearestPoint
from regents_cosim.maps.levels import has_levels, height_on, surface_points
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.scenario.scenario import LeftOut, Scenario
from regents_cosim.simulators import STEP_S
from regents_cosim.simulators.sumo.net import read_road_map
from regents_cosim.simulators.sumo.options import MESOSCOPIC
from regents_cosim.simulators.sumo.types import CAR, PEDESTRIAN, VehicleType, read_types, type_named
from regents_cosim.sources.fcd_rides import RidingPersons, is_mesoscopic, what_it_lacks
from regents_cosim.sources.left_out import told_of_recordings
from regents_cosim.sources.logs.files.text import as_utf8, encoding_of
from regents_cosim.sources.logs.scene import COARSEST_S, FINEST_S
from regents_cosim.sources.recording import DistinctIds, GrowingRecording, Recording
from regents_cosim.sources.windows import USUAL, RecordingOrigin, Windows, choose_windows, draw_slots

_EXPECTED = "SUMO's fcd-output as .xml, .xml.gz or .csv"
_LONGEST_LINE = 1 << 16
_LATEST_S = 1e12
_ONE_PLACE_M = 1.0  # a city within one degree, read as metres
_NUMBERS = 4  # per vehicle and instant: x, y, heading, height


def record_fcd(
    log: Path,
    net: Path,
    windows: Windows = USUAL,
    *,
    routes_or_types: tuple[Path, ...] = (),
    tell: Callable[[str], None] = warnings.warn,
) -> list[Scenario]:
    """Up to `windows.count` Scenarios from a log (.xml, .xml.gz, .csv, .csv.gz); the same seed gives the same ones.

    `routes_or_types` are route or additional files that define the vehicle types. Logs with another step, up to 1 s,
    are resampled to 0.1 s: positions linearly, headings along the shorter turn. `windows.choose_windows` picks the
    windows. Persons in vehicles are left out; `tell` gets a message about them and about unknown types.

    Raises LogError where the log is empty, malformed, truncated or of a mesoscopic simulation, NoWindowError where no
    window is found.
    """
    require_file(log, "FCD log")
    if is_mesoscopic(log):
        raise LogError(f"{log}: the log of {MESOSCOPIC}")
    road = read_road_map(net)
    known = read_types(routes_or_types)
    rides = RidingPersons(road)
    grid = _time_grid(log, rides)
    heights = _RoadHeights(road, log)
    recordings = list(_recordings(log, grid, known, windows, heights, rides, tell))
    _check_place(log, recordings, road)
    for line in told_of_recordings(recordings):
        tell(line)
    lacks = what_it_lacks(log)
    unlogged = _unlogged(lacks, rides)
    recordings = [replace(_resampled(recording, windows), left_out=unlogged) for recording in recordings]
    found = choose_windows(recordings, road, RecordingOrigin("fcd", log.name, sha256_of(log)), windows)
    if lacks is None:
        tell(f"{log.name} does not say how SUMO wrote it, so it is not known whether it holds all road users")
    return found


# --- time ---------------------------------------------------------------------------------------


class _Grid(NamedTuple):
    """The instants of a log; `known` are the numbers of the instants that the log contains."""

    begin_s: float
    dt: float
    known: Int[np.ndarray, " instant"]

    @property
    def steps(self) -> int:
        """The number of instants from the first to the last."""
        return int(self.known[-1]) + 1

    def slots(self, steps: int) -> list[int]:
        """Which of the slots of `steps` instants contain data; so a pause of years in a log is skipped."""
        numbers = np.unique(self.known // steps)
        return numbers[numbers < self.steps // steps].tolist()


def _time_grid(log: Path, rides: RidingPersons) -> _Grid:
    """First instant, step and number of steps. Steps may be missing, since SUMO can leave out empty ones.

    `rides` is given every person on foot.
    """
    seen = list[float]()
    for time, rows, _ in logged_instants(log):
        seen.append(time)
        for row in rows:
            if row.walks:
                rides.see(row.name, time, row.x, row.y, row.angle, _speed(row.speed))
    rides.finish()
    times = np.array(seen)
    if len(times) < 2:
        raise LogError(f"{log}: {len(times)} time steps, expected at least 2 (is it an fcd-output?)")
    gaps = np.diff(times)
    dt = float(gaps.min())
    if dt <= 0:
        raise LogError(f"{log}: time does not increase at {times[1:][gaps <= 0][0]:g} s")
    if dt < FINEST_S:
        raise LogError(f"{log}: one sample every {dt:g} s, expected at least {FINEST_S:g} s between two")
    if dt > COARSEST_S + 1e-6:
        raise LogError(f"{log}: one sample every {dt:g} s, expected at most {COARSEST_S:g} s (--step-length 0.1)")
    steps = gaps / dt
    if np.abs(steps - np.round(steps)).max() > 0.01:
        raise LogError(f"{log}: time steps of {dt:g} s and {gaps.max():g} s mixed, expected one step length")
    known = np.round((times - times[0]) / dt).astype(np.int64)
    return _Grid(float(times[0]), round(dt, 6), known)


def _recordings(
    log: Path,
    grid: _Grid,
    known: dict[str, VehicleType],
    windows: Windows,
    heights: "_RoadHeights",
    rides: RidingPersons,
    tell: Callable[[str], None],
) -> Iterator[Recording]:
    steps = int(np.ceil(windows.horizon_s / grid.dt - 1e-6)) + 1
    there = grid.slots(steps)
    if not there:
        raise NoWindowError(
            f"no window found: a horizon of {windows.horizon_s:g} s does not fit into {log.name}, which lasts "
            f"{(grid.steps - 1) * grid.dt:g} s; choose a shorter `horizon`"
        )
    names, seen = DistinctIds(), set[tuple[bool, str]]()
    slots = {
        i: GrowingRecording(round(grid.begin_s + i * steps * grid.dt, 6), grid.dt, steps, names=names, ego=windows.ego)
        for i in (there[k] for k in draw_slots(len(there), windows))
    }
    for time, rows, riders in logged_instants(log):
        index, step = divmod(round((time - grid.begin_s) / grid.dt), steps)
        if index in slots:
            slots[index].riders.update(riders)
            here = _off_vehicles(slots[index], rows, time, rides)
            _add(slots[index], step, here, heights, known)
            seen.update((row.walks, row.kind) for row in here)
    for line in _unknown(log, seen, known):
        tell(line)
    work = Work.of(log)
    for slot in slots.values():
        vehicles = len({row[0] for row in slot.rows})
        work.spend("vehicles x instants x numbers of the windows", vehicles, steps, _NUMBERS)
        yield slot.finish()


def _off_vehicles(
    slot: GrowingRecording, rows: "list[LoggedState]", time_s: float, rides: RidingPersons
) -> "list[LoggedState]":
    """The road users that are not in a vehicle; the others are noted as riders of the slot."""
    if not rides.number:
        return rows
    aboard = {row.name for row in rows if row.walks and rides.at(row.name, time_s)}
    slot.riders |= aboard
    return [row for row in rows if not (row.walks and row.name in aboard)]


def _unlogged(lacks: str | None, rides: RidingPersons) -> tuple[LeftOut, ...]:
    """The reasons why the log lacks road users; empty where it lacks none, as far as the log says."""
    said = [lacks] if lacks else []
    if rides.number:
        said.append(f"persons in vehicles that it lacks: {rides.number}")
    return (LeftOut("unlogged", 0, detail="; ".join(said)),) if said else ()


def _add(
    slot: GrowingRecording, step: int, rows: "list[LoggedState]", heights: "_RoadHeights", known: dict[str, VehicleType]
) -> None:
    for row in rows:
        height = heights(row)
        if height is None:
            slot.riders.add(row.name)
            continue
        outline = _type_of(row, known)
        one = slot.person(row.name, outline) if row.walks else slot.named(row.name, row.kind, outline)
        slot.rows.append((one, step, row.x, row.y, row.angle, height))


def _unknown(log: Path, seen: set[tuple[bool, str]], known: dict[str, VehicleType]) -> Iterator[str]:
    """Messages about types that are not known, among those that are seen of persons (True) and vehicles."""
    for walks, taken, usual in ((False, "cars", CAR), (True, "persons", PEDESTRIAN)):
        names = sorted(kind for on_foot, kind in seen if on_foot == walks and type_named(kind, known) is None)
        if names:
            yield (
                f"{log.name}: no vType for {', '.join(names[:5])}{' ...' * (len(names) > 5)}; taken as {taken} of "
                f"{usual.length} m x {usual.width} m (name the files that define them with -r or -a)"
            )


def _type_of(row: "LoggedState", known: dict[str, VehicleType]) -> VehicleType:
    found = type_named(row.kind, known)
    if row.walks and not (found and found.kind == "other"):  # a container
        return replace(found or PEDESTRIAN, kind="pedestrian", articulated=False)
    return found or CAR


class _RoadHeights:
    """The heights that a log leaves out, taken from the lanes that its vehicles are on."""

    def __init__(self, road: RoadMap, log: Path) -> None:
        self._road, self._log = road, log
        self._points = surface_points(road.lanes)
        self._nearest = NearestPoint(self._points[:, :2]) if road.raised else None

    def __call__(self, row: "LoggedState") -> float | None:
        """The height of the road at a place [m].

        Where one road crosses above another and the log names no lane: None for a person; for a vehicle LogError is
        raised.
        """
        if row.z is not None or self._nearest is None:
            return row.z or 0.0
        if row.lane in self._road.lane:
            return float(height_on(self._road.lane[row.lane], np.array([row.x, row.y])))
        if not has_levels(self._road):
            return float(self._points[self._nearest(np.array(row.x), np.array(row.y)), 2])
        if row.walks:
            return None
        raise LogError(
            f"{self._log}: the vehicle at x {row.x:.1f}, y {row.y:.1f} has neither a height nor a lane for cars, and "
            "roads of the network lie above each other; expected z (--fcd-output.attributes x,y,z,angle,type,speed)"
        )


def _check_place(log: Path, recordings: Sequence[Recording], road: RoadMap) -> None:
    """Raise LogError where no vehicle is near the network, or all are in one place: degrees that are read as metres."""
    fronts = [_fronts(recording)[:, recording.valid] for recording in recordings]
    x, y = np.concatenate(fronts, axis=1)
    if len(x) > 1 and max(np.ptp(x), np.ptp(y)) < _ONE_PLACE_M:
        raise LogError(
            f"{log}: all vehicles are within {_ONE_PLACE_M:g} m of x {x[0]:.5f}, y {y[0]:.5f}; expected traffic in "
            "metres (a log without --fcd-output.geo)"
        )
    west, south, east, north = road.drivable.bounds
    if len(x) and not ((x > west) & (x < east) & (y > south) & (y < north)).any():
        raise LogError(
            f"{log}: all vehicles are off the network (the first at x {x[0]:.1f}, y {y[0]:.1f}; the network spans "
            f"x {west:.0f} to {east:.0f}, y {south:.0f} to {north:.0f}); expected a log of this network, "
            "without --fcd-output.geo"
        )


def _fronts(recording: Recording) -> Float[np.ndarray, "2 vehicle time"]:
    """The places that the log gives, those of the fronts [m]."""
    lengths = np.array([[one.length] for one in recording.types]).reshape(-1, 1)
    front = to_sumo(Pose(recording.x, recording.y, recording.yaw), lengths)
    return np.array([front.x, front.y])


def _resampled(recording: Recording, windows: Windows) -> Recording:
    """The Recording at 0.1 s; a vehicle is present between two samples if it drives from one to the other."""
    if abs(recording.dt - STEP_S) < 1e-6:
        return recording
    there = recording.valid
    links = there[:, :-1] & there[:, 1:]
    drives = np.pad(links & ~jumps(recording.x, recording.y, links, recording.dt), ((0, 0), (0, 1)))
    place = np.arange(windows.steps(STEP_S)) * STEP_S / recording.dt
    before = np.minimum(np.floor(place + 1e-9).astype(int), recording.x.shape[1] - 1)
    part = np.clip(place - before, 0.0, None)
    after = np.where(part > 1e-6, np.minimum(before + 1, recording.x.shape[1] - 1), before)
    valid = np.where(before == after, there[:, before], drives[:, before])

    def between(values: np.ndarray, change: np.ndarray) -> np.ndarray:
        return np.where(valid, values[:, before] + part * change, 0.0)

    x, y, yaw, z = recording.x, recording.y, recording.yaw, recording.z
    return replace(
        recording,
        dt=STEP_S,
        x=between(x, x[:, after] - x[:, before]),
        y=between(y, y[:, after] - y[:, before]),
        yaw=wrap(between(yaw, np.asarray(wrap(yaw[:, after] - yaw[:, before])))),
        z=None if z is None else between(z, z[:, after] - z[:, before]),
        valid=valid,
    )


# --- reading ------------------------------------------------------------------------------------


class LoggedState(NamedTuple):
    """The state of a vehicle, or of a person on foot, at one instant."""

    name: str
    kind: str  # its vType
    x: float
    y: float
    angle: float
    z: float | None
    lane: str
    walks: bool = False
    speed: str = ""  # [m/s] only of persons, as text of the log


_Instant = tuple[float, list[LoggedState], list[str]]  # time [s], the road users, the ids of persons that are left out


def logged_instants(log: Path) -> Iterator[_Instant]:
    """Read a log instant by instant."""
    with _explain(log):
        with open_bounded(log, unpacked_limit(log)) as stream:
            start = as_utf8(stream.peek(64)[:64], "replace").lstrip()
            if not start:
                raise ValueError("the file is empty")
            if start[:1] != b"<":
                yield from _from_csv(stream)
                return
        yield from _from_xml(log)


@contextmanager
def _explain(log: Path) -> Iterator[None]:
    try:
        yield
    except LogError:
        raise
    except (ValueError, csv.Error, InputError) as error:  # text that is not UTF-8 as well
        raise LogError(f"{log}: {error}; expected {_EXPECTED}") from error


def _from_xml(log: Path) -> Iterator[_Instant]:
    for root, element in children(log, _EXPECTED, LogError):
        if root != "fcd-export":
            raise ValueError(f"the root element is <{root}>, not <fcd-export>")
        if element.tag == "timestep":
            vehicles = [_row(vehicle.attrib) for vehicle in element.iter("vehicle")]
            others = [one.attrib for tag in ("person", "container") for one in element.iter(tag)]
            walking, riding = _persons(others, vehicles)
            yield _seconds(_value(element.attrib, "time", "timestep")), [*vehicles, *walking], riding


def _row(vehicle: Mapping[str, str]) -> LoggedState:
    x, y, angle = (_finite(_value(vehicle, name)) for name in ("x", "y", "angle"))
    z, kind = vehicle.get("z"), vehicle.get("type", "DEFAULT_VEHTYPE")
    return LoggedState(_value(vehicle, "id"), kind, x, y, angle, _finite(z) if z else None, vehicle.get("lane", ""))


def _persons(entries: Sequence[Mapping[str, str]], vehicles: list[LoggedState]) -> tuple[list[LoggedState], list[str]]:
    """The persons who walk or wait, and the ids of the others: in vehicles, on stairs, in lifts or without a place.

    By default a log does not say who rides, but puts a passenger exactly where the vehicle is.
    """
    walking, riding = list[LoggedState](), list[str]()
    taken = {(vehicle.x, vehicle.y) for vehicle in vehicles}
    for entry in entries:
        place = [entry.get(name, "") for name in ("x", "y", "angle")]
        if not all(place) or entry.get("vehicle") or entry.get("stage") == "access":
            riding.append(entry.get("id", ""))
            continue
        x, y, angle = map(_finite, place)
        if (x, y) in taken:
            riding.append(entry.get("id", ""))
            continue
        z, kind, speed = entry.get("z"), entry.get("type") or "DEFAULT_PEDTYPE", entry.get("speed")
        height = _finite(z) if z else None
        walking.append(LoggedState(entry.get("id", ""), kind, x, y, angle, height, "", True, speed or ""))
    return walking, riding


def _value(entry: Mapping[str, str], name: str, tag: str = "vehicle") -> str:
    value = entry.get(name)
    if value is None:
        raise ValueError(f"a <{tag}> has no {name}")
    return value


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:20]!r} is not a place or an angle")
    return value


def _speed(text: str) -> float | None:
    """A speed [m/s]; None where the text is not a number."""
    try:
        return float(text) if text else None
    except ValueError:
        return None


def _seconds(time: str) -> float:
    """Parse a time of the form 12.30 or 1:02:03:04.5 (days, hours, minutes, seconds) into seconds."""
    factors = (1.0, 60.0, 3600.0, 86400.0)
    found = sum(factor * float(part) for factor, part in zip(factors, reversed(time.split(":")), strict=False))
    if not abs(found) < _LATEST_S:
        raise ValueError(f"the time {time[:20]!r} lies beyond {_LATEST_S:g} s")
    return found


def _from_csv(stream: io.BufferedReader) -> Iterator[_Instant]:
    with io.TextIOWrapper(stream, encoding_of(stream.peek(2)), newline="") as text:
        header = text.readline(_LONGEST_LINE).strip()
        separator = next((mark for mark in ";,\t" if mark in header), ";")
        columns = [name.strip('"') for name in header.split(separator)]
        missing = [name for name in (_TIME, *(f"{_VEHICLE}{name}" for name in _PLACE)) if name not in columns]
        on_foot_alone = {_TIME, *(f"{_PERSON}{name}" for name in _PLACE)} <= set(columns)
        if missing and not on_foot_alone and columns != [_TIME]:  # a log without road users has the time alone
            raise ValueError(f"neither XML nor a CSV header with {', '.join(missing)}")
        rows = (_named(columns, row) for row in csv.reader(text, delimiter=separator))
        for time, entries in itertools.groupby(rows, key=lambda entry: entry[_TIME]):
            on_wheels, on_foot = _csv_entries(entries)
            vehicles = [_row(entry) for entry in on_wheels]
            walking, riding = _persons(on_foot, vehicles)
            yield _seconds(time), [*vehicles, *walking], riding


def _csv_entries(rows: Iterable[dict[str, str]]) -> tuple[list[dict[str, str]], list[dict[str, str]]]:
    """Vehicles and persons, with the attribute names of the XML format.

    SUMO 1.28 names all columns after the first entry of the log, whether that is a vehicle or a person. A person is
    recognised by having an edge but no lane. Older logs have separate columns for both.
    """
    on_wheels, on_foot = list[dict[str, str]](), list[dict[str, str]]()
    for row in rows:
        for prefix in (_VEHICLE, _PERSON):
            entry = {name.removeprefix(prefix): value for name, value in row.items() if name.startswith(prefix)}
            if entry.get("id"):  # empty in a step without road users
                walks = not entry.get("lane") and (prefix == _PERSON or bool(entry.get("edge")))
                (on_foot if walks else on_wheels).append(entry)
    return on_wheels, on_foot


def _named(columns: list[str], row: list[str]) -> dict[str, str]:
    if len(row) != len(columns):
        raise ValueError(f"truncated or damaged CSV, {len(row)} of {len(columns)} columns in the row {row[:3]}")
    return dict(zip(columns, row, strict=True))


_TIME, _VEHICLE, _PERSON = "timestep_time", "vehicle_", "person_"
_PLACE = ("id", "x", "y", "angle")
