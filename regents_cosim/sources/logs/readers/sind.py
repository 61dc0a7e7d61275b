"""SinD: signalised crossings from above as CSV (one frame in 100.1 ms), a lanelet2 map if one lies nearby.

`Veh_smoothed_tracks.csv` and `Ped_smoothed_tracks.csv` are one recording. x and y are centres; `yaw_rad` is the heading
of a vehicle, `heading_rad` the direction of its motion. Pedestrians have neither size nor heading. Lights refer to
numbers in a picture, not to lanes, and are not read. There is no ego.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from regents_cosim.errors import LogError
from regents_cosim.sources.logs.files.csv_columns import Columns, header_of, read_columns
from regents_cosim.sources.logs.formats import CompanionFiles, LogFormat
from regents_cosim.sources.logs.kinds import kind_named
from regents_cosim.sources.logs.roads.lanelet2 import read_lanelet2
from regents_cosim.sources.logs.rows import Rows, late_notes, steps_of, tracks_of
from regents_cosim.sources.logs.scene import LoggedMap, LoggedScene, Track, with_distinct_ids

_NUMBERS = ("timestamp_ms", "x", "y", "yaw_rad", "length", "width")
_OF_VEHICLES = _NUMBERS[3:]
_VEHICLES, _WALKERS = "Veh_smoothed_tracks", "Ped_smoothed_tracks"
_NEEDED = {"track_id", "frame_id", "timestamp_ms", "agent_type"}


def read(path: Path, beside: CompanionFiles) -> Iterator[LoggedScene]:
    """Read the recording of a file of vehicles or pedestrians and its counterpart, or those of a folder."""
    files = [path] if path.is_file() else sorted(path.glob(f"{_VEHICLES}*"))
    road, notes = _map(path if path.is_dir() else path.parent, beside)
    for file in files:
        yield _scene(file, road, notes)


def _scene(file: Path, road: LoggedMap, notes: list[str]) -> LoggedScene:
    tables = [_table(one) for one in _halves(file)]
    times = [1e-3 * table.numbers["timestamp_ms"] for table in tables]
    step, late, dt, begin_s = steps_of(np.concatenate(times))
    ends = np.cumsum([len(each) for each in times])[:-1]
    halves = zip(tables, np.split(step, ends), np.split(late, ends), strict=True)
    tracks = [track for table, at, off in halves for track in _tracks(table, at, off, road)]
    lights = sorted(one.name for one in file.parent.glob("*[lL]ight*.csv"))
    notes = [*notes, "pedestrians have neither size nor heading in the log", *late_notes(late, dt)]
    notes += [f"the lights of {', '.join(lights)} are left out: they name no lane"] * bool(lights)
    name = f"{file.absolute().parent.name}-{file.name.partition('.')[0]}"
    return LoggedScene(
        name=name, dt=dt, tracks=with_distinct_ids(tracks), road=road, begin_s=begin_s, notes=tuple(notes)
    )


def _halves(file: Path) -> list[Path]:
    """The existing files of one recording (vehicles and pedestrians), given either of them."""
    names = (file.name.replace(_WALKERS, _VEHICLES), file.name.replace(_VEHICLES, _WALKERS))
    return [one for one in map(file.with_name, dict.fromkeys(names)) if one.is_file()]


def _table(path: Path) -> Columns:
    found = read_columns(path, _NUMBERS, ("track_id", "agent_type"), _OF_VEHICLES)
    missing = [name for name in _OF_VEHICLES if name not in found.numbers]
    if missing and {kind_named(name) for name in found.texts["agent_type"]} != {"pedestrian"}:
        raise LogError(f"{path}: vehicles without the column {', '.join(missing)}, expected SinD's")
    return found


def _tracks(table: Columns, step: np.ndarray, late: np.ndarray, road: LoggedMap) -> list[Track]:
    none = np.full(len(step), np.nan)
    x, y, yaw, length, width = (table.numbers.get(key, none) for key in ("x", "y", *_OF_VEHICLES))
    who, names, kind = table.codes["track_id"], table.texts["track_id"], table.kinds("agent_type")
    return tracks_of(Rows(who, step, x, y, yaw, kind, length, width, names, late), road)


def _map(folder: Path, beside: CompanionFiles) -> tuple[LoggedMap, list[str]]:
    """The given map, else the only one beside the tracks or in the folder above; and notes about it."""
    if beside.road is not None:
        return read_lanelet2(beside.road), []
    for place in (folder, folder.absolute().parent):
        found = sorted(place.glob("*.osm"))
        if len(found) == 1:
            return read_lanelet2(found[0]), []
        if found:
            return LoggedMap(), [f"{len(found)} maps beside it, of which none is taken (name one with `map`)"]
    return LoggedMap(), []


def _recognises(path: Path, head: bytes) -> bool:
    if path.is_dir():
        return any(path.glob(f"{_VEHICLES}*"))
    columns = set(header_of(head))
    return columns >= _NEEDED and ("yaw_rad" in columns or path.name.startswith(_WALKERS)) and "psi_rad" not in columns


FORMAT = LogFormat("sind", "SinD CSV", _recognises, read)
