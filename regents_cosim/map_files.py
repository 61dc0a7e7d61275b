"""Maps on disk: one RoadMap as two files named by their content, shared by the cases of a suite."""

import functools
import gzip
import hashlib
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import shapely

from regents_cosim.atomic import write_atomic
from regents_cosim.errors import CaseError
from regents_cosim.names import require_file_name, require_inside, require_no_link
from regents_cosim.roadmap import Connection, Lane, RoadMap


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
class _RoadEntry:
    lanes: tuple[_LaneEntry, ...]
    connections: tuple[Connection, ...]
    drivable: bytes  # well-known binary


@dataclass(frozen=True)
class _RaisedRoadEntry(_RoadEntry):
    heights: tuple[tuple[float, ...], ...] = ()  # [m] of the points of each lane; none where the map is flat


def map_files(road: RoadMap) -> MapFiles:
    """The names under which `road` is kept."""
    return _pack(road)[0]


def save_map(road: RoadMap, folder: Path) -> MapFiles:
    """Write the files of `road` that `folder` does not hold yet."""
    files, content = _pack(road)
    require_no_link(folder)
    folder.mkdir(exist_ok=True)
    for name, data in content.items():
        if not (folder / name).exists():
            write_atomic(folder / name, data)
    return files


def load_map(files: MapFiles, case: Path) -> RoadMap:
    """Read a map from the case folder or from `maps` beside it; equal files give one shared RoadMap."""
    return _unpack(_read(files.road, case), _read(files.sumo_net, case) if files.sumo_net else None)


@functools.lru_cache(maxsize=16)
def _pack(road: RoadMap) -> tuple[MapFiles, dict[str, bytes]]:
    lanes = tuple(_lane_entry(lane) for lane in road.lanes)
    entry = lanes, road.connections, shapely.to_wkb(road.drivable)
    heights = tuple(tuple(lane.height.tolist()) for lane in road.lanes)
    plain = msgspec.json.encode(_RaisedRoadEntry(*entry, heights) if road.raised else _RoadEntry(*entry))
    content = {f"{_digest(plain)}.road.json.gz": gzip.compress(plain, mtime=0)}
    net_name = None
    if road.sumo_net is not None:
        net_name = f"{_digest(road.sumo_net)}.net.xml.gz"
        content[net_name] = road.sumo_net
    return MapFiles(next(iter(content)), net_name), content


@functools.lru_cache(maxsize=16)
def _unpack(road: bytes, sumo_net: bytes | None) -> RoadMap:
    entry = msgspec.json.decode(gzip.decompress(road), type=_RaisedRoadEntry)
    heights = entry.heights or (None,) * len(entry.lanes)
    lanes = tuple(_lane(one, height) for one, height in zip(entry.lanes, heights, strict=True))
    return RoadMap(lanes, entry.connections, shapely.from_wkb(entry.drivable), sumo_net)


def _lane(entry: _LaneEntry, height: tuple[float, ...] | None) -> Lane:
    z = np.zeros(len(entry.centre)) if height is None else np.array(height)
    return Lane(
        entry.id, np.array(entry.centre), entry.width, entry.speed_limit, entry.junction, entry.left, entry.right, z
    )


def _lane_entry(lane: Lane) -> _LaneEntry:
    points = tuple((x, y) for x, y in lane.centre.tolist())
    return _LaneEntry(lane.id, points, lane.width, lane.speed_limit, lane.junction, lane.left, lane.right)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


def _read(name: str, case: Path) -> bytes:
    for path, home in ((case / name, case), (case.parent / "maps" / name, case.parent)):
        if path.is_file():
            return require_inside(path, home).read_bytes()
    raise CaseError(f"{case}: map {name} not found (expected in the case or in {case.parent / 'maps'})")
