"""INTERACTION: tracks as CSV (10 Hz), a lanelet2 map, several recordings or cases per place.

`vehicle_tracks_NNN.csv` and `pedestrian_tracks_NNN.csv` are one recording; files with a leading `case_id` hold many
short ones, of a split: `PLACE_train.csv`, `PLACE_val.csv`, `PLACE_obs.csv`. The map is the given one, else the `.osm`
beside the tracks, or `PLACE.osm` in a folder `maps` above them. There is no ego; pedestrians have neither size nor
heading.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from regents_cosim.errors import LogError
from regents_cosim.scenario.scenario import VEHICLE_KINDS
from regents_cosim.sources.logs.files.csv_columns import Columns, header_of, read_columns
from regents_cosim.sources.logs.formats import CompanionFiles, LogFormat, head_of
from regents_cosim.sources.logs.kinds import kind_named
from regents_cosim.sources.logs.roads.lanelet2 import read_lanelet2
from regents_cosim.sources.logs.rows import Rows, late_notes, rows_by, steps_of, tracks_of
from regents_cosim.sources.logs.scene import LoggedMap, LoggedScene, Track, with_distinct_ids

_NUMBERS = ("case_id", "timestamp_ms", "x", "y", "psi_rad", "length", "width")
_OPTIONAL = ("case_id", "psi_rad", "length", "width")
_DT = 0.1


def read(path: Path, beside: CompanionFiles) -> Iterator[LoggedScene]:
    """Read a file of vehicles with its pedestrians, or all recordings of a folder."""
    files = [path] if path.is_file() else sorted(path.glob("*tracks*.csv"))
    walkers = {file.name: file for file in path.parent.glob("pedestrian_tracks*.csv")} if path.is_file() else {}
    walkers |= {file.name: file for file in files if file.name.startswith("pedestrian_tracks")}
    vehicles = [file for file in files if file.name not in walkers] or files
    road = _map(path, beside)
    for file in vehicles:
        partner = walkers.get(file.name.replace("vehicle_tracks", "pedestrian_tracks"))
        tables = [_table(file)] + ([_table(partner)] if partner and partner != file else [])
        yield from _scenes(file, tables, road)


def _table(path: Path) -> Columns:
    found = read_columns(path, _NUMBERS, ("track_id", "agent_type"), _OPTIONAL)
    kinds = {kind_named(name) for name in found.texts["agent_type"]}
    if "psi_rad" not in found.numbers and kinds & VEHICLE_KINDS:
        names = ", ".join(header_of(head_of(path)))[:200]
        raise LogError(
            f"{path}: vehicles without the column psi_rad, their headings; the header has {names} (if of other data, "
            "describe the file with a mapping, and name that file by `columns`, with `format` table)"
        )
    names = [name.removesuffix(".0") for name in found.texts["track_id"]]
    return Columns(found.numbers, found.codes, found.texts | {"track_id": names})


def _scenes(path: Path, tables: list[Columns], road: LoggedMap) -> Iterator[LoggedScene]:
    """One scene per case, or one of all rows."""
    rows = [_rows_by_case(table, path) for table in tables]
    kinds = [table.kinds("agent_type") for table in tables]
    cases = sorted(set().union(*rows))
    times = np.concatenate([t.numbers["timestamp_ms"] for t in tables])
    begin_s = 1e-3 * float(times.min())
    bare = any("length" not in table.numbers or np.isnan(table.numbers["length"]).any() for table in tables)
    for case in cases:
        mine = [(table, kind, of[case]) for table, kind, of in zip(tables, kinds, rows, strict=True) if case in of]
        tracks = [track for table, kind, here in mine for track in _tracks(table, kind, here, 1e3 * begin_s, road)]
        name = f"{path.parent.name}-{path.stem}" + (f"-case{case:.0f}" if len(cases) > 1 else "")
        notes = ["pedestrians and cyclists have neither size nor heading in the log"] * bare
        place = np.concatenate([_place(table, here, 1e3 * begin_s) for table, _, here in mine])
        notes += late_notes(place - np.round(place), _DT)
        yield LoggedScene(
            name=name, dt=_DT, tracks=with_distinct_ids(tracks), road=road, begin_s=begin_s, notes=tuple(notes)
        )


def _rows_by_case(table: Columns, path: Path) -> dict[float, Int[np.ndarray, " row"]]:
    """The rows of each case; a file without cases is a single case."""
    steps_of(table.numbers["timestamp_ms"] * 1e-3)  # raises for times that make no sense
    case = table.numbers.get("case_id", np.zeros(len(table)))
    if not np.isfinite(case).all():
        raise LogError(f"{path}: a case_id is not a number")
    return rows_by(case)


def _tracks(
    table: Columns, kind: np.ndarray, mine: Int[np.ndarray, " row"], begin_ms: float, road: LoggedMap
) -> list[Track]:
    empty = np.full(len(mine), np.nan)
    x, y, yaw, length, width = (
        table.numbers[key][mine] if key in table.numbers else empty for key in ("x", "y", "psi_rad", "length", "width")
    )
    place = _place(table, mine, begin_ms)
    who, step = table.codes["track_id"][mine], np.round(place).astype(int)
    names = table.texts["track_id"]
    return tracks_of(Rows(who, step, x, y, yaw, kind[mine], length, width, names, place - step), road)


def _place(table: Columns, mine: Int[np.ndarray, " row"], begin_ms: float) -> Float[np.ndarray, " row"]:
    """The times of rows, in steps."""
    return (table.numbers["timestamp_ms"][mine] - begin_ms) / (1e3 * _DT)


def _map(path: Path, beside: CompanionFiles) -> LoggedMap:
    if beside.road is not None:
        return read_lanelet2(beside.road)
    folder = path if path.is_dir() else path.parent
    for place in (folder, *(above / "maps" for above in [folder, *folder.absolute().parents][:5])):
        found = sorted([*place.glob("*.osm"), *place.glob("*.osm_xy")])
        named = [file for file in found if file.stem == folder.name or f"{path.stem}_".startswith(f"{file.stem}_")]
        if (place == folder and found) or named:
            return read_lanelet2(max(named, key=lambda file: len(file.stem), default=found[0]))
    raise LogError(f"{path}: no lanelet2 map (.osm) beside the tracks (name it with `map`)")


def _recognises(path: Path, head: bytes) -> bool:
    if path.is_dir():
        return any(path.glob("vehicle_tracks_*.csv"))
    return {"track_id", "frame_id", "timestamp_ms", "agent_type"} <= set(header_of(head))


FORMAT = LogFormat("interaction", "INTERACTION CSV with a lanelet2 map", _recognises, read)
