"""ScenarioNet / MetaDrive pickles, read by `unpickle`, so that a hostile file is refused and never run.

Waymo's scenes have oriented kerbs. nuScenes and nuPlan have lanes, some with an area: the drivable area is the union of
those areas and of 2 m on either side of every centre line. nuScenes swaps length and width of the ego, which
`agent_with_size` sets right. The lights of nuPlan have colours, those of Waymo the words of its enumeration.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.checks.work import STEPS, Work
from regents_cosim.errors import LogError
from regents_cosim.geometry.areas import require_few_crossings
from regents_cosim.norms.limits import ASSUMED_LIMIT_M_S
from regents_cosim.sources.logs.files.unpickle import unpickle
from regents_cosim.sources.logs.formats import CompanionFiles, LogFormat, explained, unpacked
from regents_cosim.sources.logs.kinds import kind_named
from regents_cosim.sources.logs.roads.road import KMH, crossings_of, largest
from regents_cosim.sources.logs.rows import steady_step
from regents_cosim.sources.logs.scene import (
    LoggedLane,
    LoggedMap,
    LoggedScene,
    LoggedSignal,
    RoadEdge,
    Track,
    dense_track,
    heights_of,
    joined,
    with_openings,
)
from regents_cosim.sources.logs.waymo_codes import letter_of, lights, stopping

_BESIDE_CENTRE_M = 2.0
_LONGEST_STEP_S = 1.5


def read(path: Path, beside: CompanionFiles) -> Iterator[LoggedScene]:
    """Read the one scene of a file."""
    content = unpacked(path)
    with explained(path, "ScenarioNet pickle"):
        scene = unpickle(content)
        if not isinstance(scene, dict) or not {"tracks", "map_features", "metadata"} <= set(scene):
            raise LogError("not a ScenarioNet file (expected tracks, map_features and metadata)")
        yield _Reader(scene, Work.of(path)).scene(path)


class _Reader:
    """Reads one file; `work` bounds the effort, since a file may refer to one value many times."""

    def __init__(self, content: dict[str, Any], work: Work) -> None:
        self._content, self._work = content, work

    def scene(self, path: Path) -> LoggedScene:
        """The scene of the file at `path`."""
        metadata = self._content["metadata"]
        times = self._array(metadata["ts"]).astype(float).ravel()
        if len(times) > 1 and np.median(np.diff(times)) >= _LONGEST_STEP_S:
            times = 1e-6 * times  # some files count microseconds
        dt = steady_step(times, decimals=3)
        tracks = [self._track(_text(name), track, len(times)) for name, track in self._content["tracks"].items()]
        kept = tuple(track for track in tracks if track is not None)
        ego = _text(metadata.get("sdc_id"))
        road = self._map()
        return LoggedScene(
            name=_text(metadata.get("scenario_id") or self._content.get("id") or path.stem),
            dt=dt,
            tracks=kept,
            road=road,
            ego=ego if any(track.agent.id == ego for track in kept) else None,
            signals=self._signals(road.lanes, len(times)),
            begin_s=float(times[0]) if times[0] < 1e6 else 0.0,
            notes=("the map is partial: lanes without an area count 2 m to either side",) if road.areas else (),
        )

    def _array(self, value: Any) -> np.ndarray:
        if isinstance(value, list | tuple):
            self._work.spend("numbers of one more list", 3 * len(value))
            value = np.array([_row(entry) for entry in value], float)
        elif isinstance(value, np.ndarray):
            self._work.spend("numbers of one more array", value.size + 10 * STEPS)
        else:
            raise ValueError("no array where one is expected")
        return value

    def _track(self, name: str, track: dict[str, Any], steps: int) -> Track | None:
        state = track["state"]
        position = self._array(state["position"])
        heading, valid = (self._array(state[key]).ravel() for key in ("heading", "valid"))
        if position.shape[0] != steps or len(heading) != steps or len(valid) != steps:
            raise ValueError(f"track {name[:40]} has {len(heading)} instants, expected {steps}")
        there = valid > 0
        if not there.any():
            return None
        kind = kind_named(_text(track["type"]))
        length, width = (self._size(state.get(key), steps) for key in ("length", "width"))
        z = heights_of(position, there)
        return dense_track(name, kind, (length, width), there, position[:, 0], position[:, 1], heading, z)

    def _size(self, value: Any, steps: int) -> float | Float[np.ndarray, " time"]:
        if value is None or isinstance(value, int | float):
            return float(value or 0.0)
        sizes = self._array(value).ravel().astype(float)
        return sizes if len(sizes) == steps else 0.0

    # --- map ----------------------------------------------------------------------------------

    def _map(self) -> LoggedMap:
        lanes, edges, areas, crossings, has_exits, stops, places = [], [], [], [], False, set[str](), []
        for name, feature in self._content["map_features"].items():
            kind = _text(feature.get("type"))
            if kind in ("ROAD_EDGE_BOUNDARY", "ROAD_EDGE_MEDIAN", "BOUNDARY_LINE") and "polyline" in feature:
                points = self._points(feature["polyline"])
                if len(points) > 1:
                    edges.append(RoadEdge(points[:, :2], heights_of(points)))
            elif kind == "STOP_SIGN" and isinstance(feature.get("lane"), list | tuple):
                stops.update(map(_text, feature["lane"]))
                places += self._place(feature.get("position"))
            elif kind == "CROSSWALK" and "polygon" in feature:
                crossings.append(self._points(feature["polygon"]))
            elif kind.startswith("LANE_") and "BIKE" not in kind:
                lane = self._lane(_text(name), feature)
                has_exits |= bool(feature.get("exit_lanes"))
                lanes += [lane] if lane else []
                areas += self._areas(feature, lane)
        lanes = stopping(lanes, stops, places, self._work)
        linked = with_openings(lanes) if has_exits else joined(lanes, self._work)
        told = crossings_of(crossings) or None  # files of older converters have none anywhere
        return LoggedMap(linked, tuple(edges), () if edges else tuple(areas), told)

    def _points(self, value: Any) -> Float[np.ndarray, "point axis"]:
        points = self._array(value).astype(float)
        if points.ndim != 2 or points.shape[1] < 2 or not np.isfinite(points[:, :2]).all():
            raise ValueError(f"a line of shape {points.shape}, expected points [x, y] or [x, y, z]")
        return points

    def _place(self, value: Any) -> list[Float[np.ndarray, " 2"]]:
        there = isinstance(value, list | tuple | np.ndarray)
        place = self._array(value).ravel().astype(float) if there else np.zeros(0)
        return [place[:2]] if len(place) >= 2 and np.isfinite(place[:2]).all() else []

    def _lane(self, name: str, feature: dict[str, Any]) -> LoggedLane | None:
        if "polyline" not in feature or not len(feature["polyline"]):
            return None
        points = self._points(feature["polyline"])
        if len(points) < 2:
            return None
        limit, exits = feature.get("speed_limit_kmh"), feature.get("exit_lanes") or ()
        self._work.spend("lanes that one leads to", len(exits))
        left, right = (_neighbour(feature.get(f"{side}_neighbor")) for side in ("left", "right"))
        return LoggedLane(
            id=name,
            centre=points[:, :2],
            z=heights_of(points),
            speed_limit=limit * KMH if isinstance(limit, int | float) and limit > 0 else ASSUMED_LIMIT_M_S,
            exits=tuple(map(_text, exits)),
            left=left,
            right=right,
        )

    def _areas(self, feature: dict[str, Any], lane: LoggedLane | None) -> list[shapely.Polygon]:
        found = []
        if "polygon" in feature and len(feature["polygon"]) > 2:
            area = largest(self._points(feature["polygon"])[:, :2])
            found += [area] if area is not None else []
        if lane is not None:
            line = shapely.LineString(lane.centre)
            require_few_crossings([line])
            strip = line.buffer(_BESIDE_CENTRE_M, cap_style="flat", quad_segs=3)
            found += [part for part in shapely.get_parts(strip) if part.geom_type == "Polygon"]
        return found

    # --- signals ------------------------------------------------------------------------------

    def _signals(self, lanes: tuple[LoggedLane, ...], steps: int) -> tuple[LoggedSignal, ...]:
        letters, stops = {}, {}
        for name, light in self._content.get("dynamic_map_states", {}).items():
            states = light["state"].get("object_state")
            if not isinstance(states, list | tuple | np.ndarray) or len(states) != steps:
                continue
            self._work.spend("instants of one more light", steps)
            lane = _text(light.get("lane", name))
            letters[lane] = [letter_of(_text(state)) for state in states]
            if isinstance(light.get("stop_point"), np.ndarray) and light["stop_point"].size >= 2:
                stops[lane] = self._array(light["stop_point"]).ravel()[:2].astype(float)
        return lights(letters, stops, lanes)


def _text(value: Any) -> str:
    """A text. A list is refused unprinted, as it may contain itself a billion times."""
    if isinstance(value, str):
        return value
    if value is None or isinstance(value, int | float):
        return str(value)
    raise ValueError(f"a {type(value).__name__} where a name is expected")


def _row(entry: Any) -> tuple[float, ...]:
    """An entry of a list as numbers: its first three, or the one number that it is."""
    row = tuple(entry[:3]) if isinstance(entry, list | tuple | np.ndarray) else (entry,)
    if not all(isinstance(number, int | float | np.number | np.bool_) for number in row):
        raise ValueError("a list of something else than numbers")
    return row


def _neighbour(value: Any) -> str | None:
    """The first neighbour in a list of ids or of dictionaries with an id; else None."""
    first = value[0] if isinstance(value, list | tuple) and value else None
    first = first.get("feature_id") if isinstance(first, dict) else first
    return _text(first) if isinstance(first, str | int) else None


_INDICES = ("dataset_summary.pkl", "dataset_mapping.pkl")  # index files that lie in a folder of scenarios


def _recognises(path: Path, head: bytes) -> bool:
    return len(head) > 2 and head[0] == 0x80 and head[1] in (2, 3, 4, 5) and path.name not in _INDICES


FORMAT = LogFormat("scenarionet", "ScenarioNet pickle", _recognises, read)
