"""Maps on disk: a RoadMap as two files named by their content, which the cases of a suite share."""

import copyreg
import functools
import gzip
import hashlib
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from weakref import WeakValueDictionary

import msgspec
import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from regents_cosim.checks.bounded import MIB, gunzip_bounded, read_bounded
from regents_cosim.checks.names import require_file_name, require_inside, require_no_link
from regents_cosim.checks.typed_values import from_json
from regents_cosim.checks.xml_input import most_unpacked
from regents_cosim.errors import CaseError, InputError, require
from regents_cosim.maps.net_elements import require_network_alone, unpacked_network
from regents_cosim.maps.roadmap import MOST_COORDINATE_M, Approach, Connection, Lane, RoadMap
from regents_cosim.maps.walkways import Walkway
from regents_cosim.system.files.atomic import clear_leftovers, write_atomic

# Read polygons in well-known binary, and check their structure before shapely (GEOS) sees them.
#
# GEOS follows nested collections by recursion, so 5 KB of gzip can overflow its stack and end the process.
_POLYGON, _MULTI_POLYGON = 3, 6
_HEAD_BYTES = 5  # byte order and type
_COUNT_BYTES = 4
_POINT_BYTES = 16  # x, y


def load_polygons(data: bytes) -> BaseGeometry:
    """A polygon or multipolygon in two dimensions. Raises InputError for anything else."""
    try:
        end = _whole_end(data)
        require(end == len(data), f"polygons end after {end} of {len(data)} bytes", InputError)
        return shapely.from_wkb(data)
    except struct.error as error:
        raise InputError("polygons are cut off") from error
    except shapely.errors.ShapelyError as error:
        raise InputError(f"polygons cannot be read ({error})") from error


def _whole_end(data: bytes) -> int:
    order, kind = _head(data, 0)
    if kind == _POLYGON:
        return _polygon_end(data, 0)
    require(kind == _MULTI_POLYGON, f"geometry of type {kind}, expected polygons", InputError)
    (count,) = struct.unpack_from(order + "I", data, _HEAD_BYTES)
    at = _HEAD_BYTES + _COUNT_BYTES
    for _ in range(count):
        at = _polygon_end(data, at)
    return at


def _polygon_end(data: bytes, at: int) -> int:
    order, kind = _head(data, at)
    require(kind == _POLYGON, f"geometry of type {kind} in a multipolygon, expected polygons", InputError)
    (rings,) = struct.unpack_from(order + "I", data, at + _HEAD_BYTES)
    at += _HEAD_BYTES + _COUNT_BYTES
    for _ in range(rings):
        (points,) = struct.unpack_from(order + "I", data, at)
        at += _COUNT_BYTES + points * _POINT_BYTES
    return at


def _head(data: bytes, at: int) -> tuple[str, int]:
    order = {0: ">", 1: "<"}.get(data[at] if at < len(data) else -1)
    if order is None:
        raise InputError("polygons are cut off, or no well-known binary")
    (kind,) = struct.unpack_from(order + "I", data, at + 1)
    return order, kind


# City networks (Luxembourg, Monaco, Berlin) have 30 to 250 MiB as XML, and a third of that as lanes.
_PACKED_BYTES = 64 * MIB
_ROAD_BYTES = 128 * MIB
_ROAD, _NET = ".road.json.gz", ".net.xml.gz"
_held: WeakValueDictionary[tuple[bytes, bytes | None], RoadMap] = WeakValueDictionary()
_NAME = re.compile(rf"[0-9a-f]{{16}}({re.escape(_ROAD)}|{re.escape(_NET)})")


@dataclass(frozen=True)
class MapFiles:
    """File names of one map."""

    road: str  # lanes, connections, drivable area
    sumo_net: str | None  # the network as SUMO reads it

    def __post_init__(self) -> None:
        for name in filter(None, (self.road, self.sumo_net)):
            require_file_name(name, "map")


@dataclass(frozen=True)
class _LaneEntry:
    id: str
    centre: tuple[tuple[float, float], ...]
    width: float
    speed_limit: float
    junction: bool
    left: str | None
    right: str | None


@dataclass(frozen=True)
class _CrossingEntry:
    id: str
    shape: tuple[tuple[float, float], ...]
    width: float


@dataclass(frozen=True)
class _RoadEntry:
    lanes: tuple[_LaneEntry, ...]
    connections: tuple[Connection, ...]
    drivable: bytes  # well-known binary

    heights: tuple[tuple[float, ...], ...] = ()  # [m] of the points of each lane; none where the map is flat
    approaches: dict[str, Approach] = field(default_factory=dict)  # of the lanes with signs, by id
    crossings: tuple[_CrossingEntry, ...] | None = None  # of a log


def map_files(road: RoadMap) -> MapFiles:
    """The file names of a map."""
    return _pack(road)[0]


def is_map_file(name: str) -> bool:
    """Whether a file name has the form of a map file's."""
    return _NAME.fullmatch(name) is not None


def save_map(road: RoadMap, folder: Path) -> MapFiles:
    """Write the files of `road` that `folder` lacks or holds damaged."""
    files, content = _pack(road)
    require_no_link(folder)
    folder.mkdir(exist_ok=True)
    clear_leftovers(folder)
    for name, data in content.items():
        if not _is_whole(folder / name, data):
            write_atomic(folder / name, data)
    return files


def load_map(files: MapFiles, case: Path) -> RoadMap:
    """Read a map from the case folder or from `maps` beside it; equal files give one shared RoadMap."""
    net = _read(files.sumo_net, case) if files.sumo_net else None
    if net is not None:
        _require_network(net)
    return _unpack(_read(files.road, case), net)


@functools.lru_cache(maxsize=16)
def _pack(road: RoadMap) -> tuple[MapFiles, dict[str, bytes]]:
    lanes = [
        {"id": one.id, "centre": one.centre.tolist(), "width": one.width, "speed_limit": one.speed_limit,
         "junction": one.junction, "left": one.left, "right": one.right}
        for one in road.lanes
    ]  # fmt: skip
    entry = {"lanes": lanes, "connections": road.connections, "drivable": shapely.to_wkb(road.drivable)}
    # What a map lacks is left out, so that its digest is that of former versions.
    if road.raised:
        entry["heights"] = [lane.height.tolist() for lane in road.lanes]
    if approaches := {lane.id: lane.approach for lane in road.lanes if lane.approach}:
        entry["approaches"] = approaches
    if road.crossings is not None:
        entry["crossings"] = [{"id": one.id, "shape": one.shape.tolist(), "width": one.width} for one in road.crossings]
    plain = msgspec.json.encode(entry)
    content = {_digest(plain) + _ROAD: gzip.compress(plain, mtime=0)}
    net_name = None
    if road.sumo_net is not None:
        net_name = _digest(road.sumo_net) + _NET
        content[net_name] = road.sumo_net
    return MapFiles(next(iter(content)), net_name), content


def _unpack(road: bytes, sumo_net: bytes | None) -> RoadMap:
    """Return one RoadMap as long as any case holds it, since caches of drawings and searches go by identity."""
    found = _held.get((road, sumo_net))
    if found is None:
        _held[road, sumo_net] = found = _unpacked(road, sumo_net)
    return found


@functools.lru_cache(maxsize=16)  # keeps the latest maps while no case holds them
def _unpacked(road: bytes, sumo_net: bytes | None) -> RoadMap:
    entry = from_json(gunzip_bounded(road, most_unpacked(len(road), _ROAD_BYTES)), _RoadEntry)
    heights = entry.heights or (None,) * len(entry.lanes)
    told = entry.approaches
    lanes = tuple(_lane(one, height, told.get(one.id)) for one, height in zip(entry.lanes, heights, strict=True))
    crossings = None if entry.crossings is None else tuple(map(_crossing, entry.crossings))
    return RoadMap(lanes, entry.connections, load_polygons(entry.drivable), sumo_net, crossings)


@functools.lru_cache(maxsize=16)
def _require_network(sumo_net: bytes) -> None:
    """Raise InputError for the file of a network that is damaged, or not one alone; equal files are read once."""
    require_network_alone(unpacked_network(sumo_net), len(sumo_net))


# A map goes to another process as its files. Equal maps are one RoadMap there, from which all else is derived once.
def _as_files(road: RoadMap) -> tuple[Callable[..., RoadMap], tuple[bytes, bytes | None]]:
    files, content = _pack(road)
    return _unpack, (content[files.road], road.sumo_net)


copyreg.pickle(RoadMap, _as_files)


def _lane(entry: _LaneEntry, height: tuple[float, ...] | None, approach: Approach | None) -> Lane:
    z = np.zeros(len(entry.centre)) if height is None else np.array(height)
    about = entry.width, entry.speed_limit, entry.junction, entry.left, entry.right
    return Lane(entry.id, np.array(entry.centre), *about, z, approach)


def _crossing(entry: _CrossingEntry) -> Walkway:
    shape = np.array(entry.shape).reshape(-1, 2)
    least, most = len(shape) >= 2, np.isfinite(shape).all() and np.abs(shape).max(initial=0.0) <= MOST_COORDINATE_M
    require(least and bool(most) and 0.0 < entry.width <= MOST_COORDINATE_M, f"crossing {entry.id}: no line", CaseError)
    return Walkway(entry.id, "crossing", shape, entry.width)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


def _is_whole(path: Path, data: bytes) -> bool:
    """Whether a file holds `data`, or the same map as another zlib packs it: the name is a digest of the content."""
    try:
        found = read_bounded(path, _PACKED_BYTES)
        return found == data or (path.name.endswith(_ROAD) and _digest(gunzip_bounded(found, _ROAD_BYTES)) in path.name)
    except InputError:
        return False


def _read(name: str, case: Path) -> bytes:
    for path, home in ((case / name, case), (case.parent / "maps" / name, case.parent)):
        if path.exists():
            return read_bounded(require_inside(path, home), _PACKED_BYTES)
    raise CaseError(f"{case}: map {name} not found (expected in the case or in {case.parent / 'maps'})")
