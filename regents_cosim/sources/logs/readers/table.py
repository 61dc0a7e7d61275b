"""Any table of tracks, text or Parquet, with a TOML file that explains its columns.

```toml
dt = 0.04                 # [s] of a frame, only where time counts frames
time = "ms"               # s (default), ms, us, ns or frames; dates of Parquet need none
position = "m"            # m (default), ft, or deg: x is the longitude, y the latitude (WGS 84)
heading = "deg"           # rad, deg (both counter-clockwise from +x) or nav (degrees clockwise from +y);
                          # by default the unit that agrees best with the motion, with a note;
                          # of positions in degrees: from true north, or east
anchor = "centre"         # of x and y: centre (default) or front, the front bumper
ego = "17"                # optional
map = "place.osm"         # optional, a lanelet2 map in the folder, in metres or around (0, 0); for degrees in degrees
header = ["stamp", "track", "east", "north"]  # only of a text file that has no line of names

[columns]                 # ours = theirs; id, time, x and y are needed
id = "track"
time = "stamp"
x = "east"
y = "north"               # also heading, speed, length, width, kind

[kinds]                   # theirs = ours
"2" = "car"
```

The TOML file lies beside the table under the same name (`tracks.csv`, `tracks.toml`) or is named by `columns`. Without
it the columns must be called id, time, x, y and so on. A column of speeds is accepted but ignored, since speeds follow
from positions.
"""

import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from regents_cosim.checks.bounded import read_bounded
from regents_cosim.checks.names import lies_in
from regents_cosim.checks.typed_values import from_values
from regents_cosim.errors import InputError, LogError
from regents_cosim.geometry.frames import FOOT_M, from_lat_lon, north_of
from regents_cosim.plain_text import listed
from regents_cosim.scenario.scenario import Kind
from regents_cosim.sources.logs.files.csv_columns import Columns, header_of, heading_like, read_columns
from regents_cosim.sources.logs.files.polars_files import read_polars
from regents_cosim.sources.logs.files.text import as_utf8
from regents_cosim.sources.logs.formats import CompanionFiles, LogFormat
from regents_cosim.sources.logs.headings import moving, to_radians, unit_of
from regents_cosim.sources.logs.kinds import kind_named
from regents_cosim.sources.logs.roads.lanelet2 import UtmOrigin, read_lanelet2
from regents_cosim.sources.logs.rows import Rows, late_notes, steps_of, steps_of_frames, tracks_of
from regents_cosim.sources.logs.scene import LoggedMap, LoggedScene, of_centre

_NEEDED = ("id", "time", "x", "y")
_MORE = ("heading", "speed", "length", "width", "kind")
_LARGEST_MAPPING = 1 << 14  # bytes: a key of 50 000 parts makes tomllib allocate 2 GiB
_KIND = re.compile(r"((agent|object|obj|vehicle|veh)[ _]?)?(type|class|category|label)", re.IGNORECASE)
_DEGREES = re.compile(r"(?:.*[_ ])?(lat|lon|lng)(?:g|itude|gitude)?(?![a-z])", re.IGNORECASE)
_NAMED = 5  # the most words that a message lists
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


class _Mapping(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The content of the TOML file."""

    columns: dict[Literal["id", "time", "x", "y", "heading", "speed", "length", "width", "kind"], str] = {}
    kinds: dict[str, Kind] = {}
    dt: float | None = None
    time: Literal["s", "ms", "us", "ns", "frames"] = "s"
    position: Literal["m", "ft", "deg"] | None = None
    heading: Literal["rad", "deg", "nav"] | None = None
    anchor: Literal["centre", "front"] = "centre"
    ego: str | None = None
    map: str | None = None
    header: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Table:
    columns: Columns
    mapping: _Mapping
    names: dict[str, str]  # of the columns, by ours

    def numbers(self, name: str) -> np.ndarray | None:
        """A numeric column; None where there is none."""
        return self.columns.numbers.get(self.names[name])


def read(path: Path, beside: CompanionFiles) -> Iterator[LoggedScene]:
    """Read the one recording of a table."""
    mapping = _mapping(path, beside)
    table = _table(path, mapping)
    step, late, dt, begin_s = _instants(table, path)
    factor = FOOT_M if mapping.position == "ft" else 1.0
    x, y = (factor * _known(table.numbers(name)) for name in ("x", "y"))
    origin, turned = _origin(path, table, x, y), 0.0
    if origin is not None:
        turned = north_of(y, x, origin.zone)
        east, north = from_lat_lon(y, x, origin.zone)
        x, y = np.asarray(east) - origin.x, np.asarray(north) - origin.y
    heading = table.numbers("heading")
    unread = _unread(path, table)
    who, unknown = table.columns.codes[table.names["id"]], np.full(len(x), np.nan)
    sizes = (table.numbers(name) for name in ("length", "width"))
    length, width = (unknown if size is None else factor * size for size in sizes)
    rows = Rows(who, step, x, y, unknown, _kinds(table), length, width, table.columns.texts[table.names["id"]], late)
    heading_note = "headings follow from the motion"
    if heading is not None:
        unit, heading_note = _heading_unit(mapping, heading, rows)
        rows = rows._replace(yaw=to_radians(heading, unit) + turned)
    file = beside.road or (_beside(path, mapping.map) if mapping.map else None)
    road = LoggedMap() if file is None else read_lanelet2(file, origin)
    tracks = tracks_of(rows, road)
    tracks = tuple(map(of_centre, tracks) if mapping.anchor == "front" else tracks)
    notes = [heading_note] * bool(heading_note) + late_notes(late, dt)
    notes += unread
    notes += ["sizes usual for the kind are assumed"] * (table.numbers("length") is None)
    yield LoggedScene(
        name=path.name.partition(".")[0], dt=dt, tracks=tracks, road=road, ego=mapping.ego, begin_s=begin_s,
        notes=tuple(notes),
    )  # fmt: skip


def _mapping(path: Path, beside: CompanionFiles) -> _Mapping:
    file = beside.columns or path.with_name(path.name.partition(".")[0] + ".toml")
    if beside.columns is None and not file.is_file():
        return _Mapping()
    try:
        return from_values(tomllib.loads(as_utf8(read_bounded(file, _LARGEST_MAPPING)).decode()), _Mapping)
    except (InputError, tomllib.TOMLDecodeError, UnicodeDecodeError, msgspec.ValidationError) as error:
        raise LogError(
            f"{file}: {str(error)[:200]} (expected a mapping of columns, see regents_cosim.sources.logs.readers.table)"
        ) from None


def _beside(path: Path, name: str) -> Path:
    """The map that a table's own file names: a stranger may have written it, so it says nothing of other folders."""
    file = path.parent / name
    if not lies_in(file, path.parent):
        raise LogError(f"{path}: its map {name!r} lies outside its folder (copy it there, or name it by `map`)")
    return file


def _table(path: Path, mapping: _Mapping) -> _Table:
    names = {name: mapping.columns.get(name, name) for name in (*_NEEDED, *_MORE)}
    given = set(mapping.columns)
    optional = [names[name] for name in _MORE if name not in given]
    numbers = [names[name] for name in ("time", "x", "y", "heading", "length", "width")]
    with path.open("rb") as file:
        is_binary = file.read(4) in (b"PAR1", b"ARRO")
    texts = [names["id"], names["kind"]]
    if is_binary:
        return _Table(read_polars(path, numbers, texts, optional), mapping, names)
    return _Table(read_columns(path, numbers, texts, optional, mapping.header), mapping, names)


def _unread(path: Path, table: _Table) -> list[str]:
    """Notes on columns that are not read although their names suggest that they matter.

    Raises LogError where such a column may hold the headings and neither the names nor a mapping decide it.
    """
    read = {*table.names.values()}
    headings = [name for name in heading_like(table.columns.header) if name not in read]
    notes = []
    if headings and table.numbers("heading") is None:
        said = f"{headings[0]} may be the headings"
        if not table.mapping.columns:
            raise LogError(
                f"{path}: {said}, and there is no column heading (name it in a mapping of columns: heading = "
                f'"{headings[0]}" below [columns]; see regents_cosim.sources.logs.readers.table)'
            )
        notes.append(f"{said}, and is not read: the mapping does not name it")
    kinds = [name for name in table.columns.header if _KIND.fullmatch(name) and name not in read]
    if kinds and table.names["kind"] not in table.columns.texts:
        notes.append(f"all are taken as cars: {kinds[0]} may be their kinds, and no mapping says so")
    words = set(table.columns.texts.get(table.names["kind"], ())) - table.mapping.kinds.keys() - {"other"}
    if unknown := sorted(word for word in words if kind_named(word) == "other"):
        notes.append(f"kinds without a meaning, taken as other: {listed(unknown, _NAMED)} (name them below [kinds])")
    return notes


def _origin(path: Path, table: _Table, x: np.ndarray, y: np.ndarray) -> UtmOrigin | None:
    """The place of the first sample of a table in degrees; None for one in metres or feet.

    Raises LogError where the names of the columns suggest another unit or order.
    """
    is_x, is_y = (_DEGREES.match(table.names[name]) for name in ("x", "y"))
    if table.mapping.position is None and (is_x or is_y):
        raise LogError(
            f"{path}: {table.names['x']} and {table.names['y']} may be degrees (say so with position = "
            '"deg", x the longitude and y the latitude; or "m", if they are metres)'
        )
    if table.mapping.position != "deg":
        return None
    if (is_x and is_x[1].lower() == "lat") or np.abs(y).max() > 90.0 or np.abs(x).max() > 180.0:
        raise LogError(f"{path}: x is {table.names['x']}, y is {table.names['y']}, expected longitude and latitude")
    zone = int((x[0] + 180.0) // 6.0) % 60 + 1
    return UtmOrigin(zone, *map(float, from_lat_lon(y[0], x[0], zone)))


def _instants(table: _Table, path: Path) -> tuple[np.ndarray, np.ndarray, float, float]:
    times, mapping = _known(table.numbers("time")), table.mapping
    if table.names["time"] in table.columns.dates:
        return steps_of(times)
    if mapping.time != "frames":
        return steps_of(_SECONDS[mapping.time] * times)
    if mapping.dt is None:
        raise LogError(f"{path}: time counts frames, so the mapping needs dt, the seconds between them")
    at = steps_of_frames(times, table.columns.codes[table.names["id"]], path)
    return at.step, at.late, at.stride * mapping.dt, at.first * mapping.dt


def _known(values: np.ndarray | None) -> np.ndarray:
    if values is None or not np.isfinite(values).all():
        raise LogError("a time or a place is empty")
    return values


def _heading_unit(mapping: _Mapping, heading: np.ndarray, rows: Rows) -> tuple[str, str]:
    """The unit that the mapping states, or the one that agrees best with the motion, and a note in that case.

    A stated unit is not checked here; `read_log` refuses a scene whose headings disagree with its motion.
    """
    if mapping.heading is not None:
        return mapping.heading, ""
    order = np.lexsort((rows.step, rows.who))
    follows = (np.diff(rows.who[order]) == 0) & (np.diff(rows.step[order]) == 1)
    return unit_of(moving(heading[order], rows.x[order], rows.y[order], follows))


def _kinds(table: _Table) -> np.ndarray:
    """The kind of road user in each row; cars in a table without kinds."""
    if table.names["kind"] not in table.columns.texts:
        return np.full(len(table.columns), "car", object)
    return table.columns.kinds(table.names["kind"], lambda word: table.mapping.kinds.get(word, kind_named(word)))


def _recognises(path: Path, head: bytes) -> bool:
    if path.suffix == ".toml":
        return False
    if path.with_name(path.name.partition(".")[0] + ".toml").is_file():
        return head[:4] == b"PAR1" or len(header_of(head)) >= len(_NEEDED)
    return head[:4] == b"PAR1" or set(_NEEDED) <= set(header_of(head))


FORMAT = LogFormat("table", "table (csv, parquet) with a TOML mapping of its columns", _recognises, read)
