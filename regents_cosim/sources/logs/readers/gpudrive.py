"""GPUDrive / Nocturne / PufferDrive JSON, all three generations, plain or gzip.

The unit of headings is decided per file: with `metadata` they are radians, otherwise degrees if any valid one is beyond
2 pi, and in doubt the unit that agrees better with the vehicles' motion. Positions of invalid steps are sentinels; only
`valid` counts. The ego is `sdc_track_index` where there is one. The files hold no time, so the step is Waymo's 0.1 s.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import numpy as np
from jaxtyping import Float

from regents_cosim.checks.typed_values import from_json
from regents_cosim.checks.work import Work
from regents_cosim.sources.logs.files.text import as_utf8
from regents_cosim.sources.logs.formats import CompanionFiles, LogFormat, unpacked
from regents_cosim.sources.logs.headings import joined as joined_ways
from regents_cosim.sources.logs.headings import moving, to_radians, unit_of
from regents_cosim.sources.logs.kinds import kind_named
from regents_cosim.sources.logs.roads.road import crossings_of
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
)
from regents_cosim.sources.logs.waymo_codes import LETTERS, UNKNOWN, letter_of, lights, stopping


class _Point(msgspec.Struct, gc=False):
    x: float
    y: float
    z: float | None = None


class _Object(msgspec.Struct):
    position: list[_Point]
    heading: list[float]
    valid: list[bool | int]
    length: float | list[float]
    width: float | list[float]
    type: str | int = "other"
    id: int | str | None = None


class _Road(msgspec.Struct):
    type: str | int
    geometry: list[_Point] | _Point
    id: int | str | None = None


class _Metadata(msgspec.Struct):
    sdc_track_index: int | None = None


class _File(msgspec.Struct):
    objects: list[_Object]
    roads: list[_Road]
    name: str = ""
    scenario_id: str | None = None
    tl_states: dict[str, "_Light"] | None = None
    metadata: _Metadata | None = None


class _Light(msgspec.Struct):
    state: list[str | int] = []
    time_index: list[int] = []
    x: list[float] = []
    y: list[float] = []


def read(path: Path, beside: CompanionFiles) -> Iterator[LoggedScene]:
    """Read the one scenario of a file."""
    content = from_json(as_utf8(unpacked(path)), _File)
    steps = max((len(one.valid) for one in content.objects), default=0)
    unit, note = _heading_unit(content)
    tracks = [_track(one, index, steps, unit) for index, one in enumerate(content.objects)]
    ego = content.metadata.sdc_track_index if content.metadata else None
    mine = tracks[ego] if ego is not None and 0 <= ego < len(tracks) else None
    work = Work.of(path)
    road = _map(content.roads, work)
    yield LoggedScene(
        name=content.scenario_id or Path(content.name or path.name).name.partition(".")[0],
        dt=0.1,
        tracks=tuple(track for track in tracks if track is not None),
        road=road,
        ego=mine.agent.id if mine else None,
        signals=_signals(content.tl_states or {}, road.lanes, steps, work),
        notes=("the log holds no time: 0.1 s between its instants", note, "one size per agent for all steps"),
    )


# --- tracks -----------------------------------------------------------------------------------


def _track(one: _Object, index: int, steps: int, unit: str) -> Track | None:
    if not len(one.position) == len(one.heading) == len(one.valid) == steps:
        raise ValueError(f"object {index} has {len(one.position)} positions, {len(one.heading)} headings, "
                         f"{len(one.valid)} flags, expected {steps} of each")  # fmt: skip
    valid, points = np.array(one.valid, bool), _points(one.position)
    name, kind = str(index if one.id is None else one.id), kind_named(str(one.type))
    size = _over_time(one.length, steps), _over_time(one.width, steps)
    heading = to_radians(np.array(one.heading, float), unit)
    return dense_track(name, kind, size, valid, points[:, 0], points[:, 1], heading, heights_of(points, valid))


def _over_time(size: float | list[float], steps: int) -> Float[np.ndarray, " time"]:
    values = np.array(size if isinstance(size, list) else [size] * steps, float)
    if len(values) != steps:
        raise ValueError(f"{len(values)} sizes of an object, expected {steps}")
    return values


def _points(points: Sequence[_Point]) -> Float[np.ndarray, "point 3"]:
    rows = [(p.x, p.y, np.nan if p.z is None else p.z) for p in points]
    return np.array(rows, float).reshape(-1, 3)


def _heading_unit(content: _File) -> tuple[str, str]:
    if content.metadata is not None:
        return "rad", "headings in radians (the file has metadata)"
    found = [(np.array(o.heading, float), _points(o.position), np.array(o.valid, bool)) for o in content.objects]
    found = [f for f in found if len(f[0]) == len(f[1]) == len(f[2])]
    most = max((float(np.abs(heading[valid]).max(initial=0.0)) for heading, _, valid in found), default=0.0)
    if most > 2.0 * np.pi + 1e-3:
        return "deg", f"headings in degrees (the largest is {most:.0f})"
    ways = (moving(heading, xy[:, 0], xy[:, 1], valid[1:] & valid[:-1]) for heading, xy, valid in found)
    return unit_of(joined_ways(ways), ("rad", "deg"))


# --- map --------------------------------------------------------------------------------------


def _map(roads: Sequence[_Road], work: Work) -> LoggedMap:
    lanes, edges, crossings, signs = [], [], [], []
    for index, road in enumerate(roads):
        points = _points(road.geometry if isinstance(road.geometry, list) else [road.geometry])
        if road.type == "stop_sign":
            signs += [point[:2] for point in points[:1] if np.isfinite(point[:2]).all()]
        if len(points) < 2:
            continue
        z = heights_of(points)
        if road.type == "road_edge":
            edges.append(RoadEdge(points[:, :2], z))
        elif road.type == "crosswalk":
            crossings.append(points)
        elif road.type == "lane":
            name = f"road{index}" if road.id is None else str(road.id)  # lights name the ids of lanes
            lanes.append(LoggedLane(name, points[:, :2], z=z))
    return LoggedMap(joined(stopping(lanes, (), signs, work), work), tuple(edges), crossings=crossings_of(crossings))


def _signals(
    states: dict[str, _Light], lanes: Sequence[LoggedLane], steps: int, work: Work
) -> tuple[LoggedSignal, ...]:
    work.spend("lights x instants", len(states), steps)
    letters, stops = {}, {}
    for name, light in states.items():
        shown = [UNKNOWN] * steps
        times = light.time_index or range(len(light.state))
        for step, state in zip(times, light.state, strict=False):
            if 0 <= step < steps:
                shown[step] = letter_of(state) if isinstance(state, str) else LETTERS.get(state, UNKNOWN)
        letters[name] = shown
        if light.x and light.y:
            stops[name] = np.array([light.x[0], light.y[0]])
    return lights(letters, stops, lanes)


def _recognises(path: Path, head: bytes) -> bool:
    start = head.lstrip()
    return start[:1] == b"{" and any(word in start for word in (b'"objects"', b'"roads"', b'"tl_states"'))


FORMAT = LogFormat("gpudrive", "GPUDrive / Nocturne JSON", _recognises, read)
