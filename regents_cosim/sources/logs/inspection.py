"""Statistics of a log for `regents inspect`."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.errors import LogError
from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.geometry.lines import steps_along
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.scenario.scenario import VEHICLE_KINDS
from regents_cosim.sources.logs.roads.road import build_road
from regents_cosim.sources.logs.scene import LoggedScene, Track

_MOVING_MPS = 1.0
_ON_MAP_M = 10.0  # from the nearest lane; farther places are not on the map
_FAST_MPS = 60.0
_FEW_PAIRS = 20_000  # most pairs to check for overlaps, plus one for each sample


@dataclass(frozen=True)
class Inspection:
    """The statistics of one scene of a log."""

    scenario: str
    format: str
    agents: int
    kinds: str  # the number of road users of each kind
    duration_s: float
    dt_s: float
    ego: str | None
    lanes: int
    edges: int
    areas: int
    signals: int
    mean_m_s: float  # of moving vehicles
    max_m_s: float
    overlaps: int  # pairs of agents whose boxes overlap at some instant
    off_road_percent: float | None  # of the centres of moving vehicles
    off_road_on_map_percent: float | None  # of those that are within 10 m of a mapped lane
    notes: tuple[str, ...]


def inspect_scene(scene: LoggedScene, format: str) -> Inspection:
    """The statistics of `scene`; without a road the shares are None, and the notes say why."""
    notes = list(scene.notes)
    centres, speeds = moving_centres(scene)
    most, pairs = _FEW_PAIRS + sum(len(track.step) for track in scene.tracks), _near(scene.tracks)
    overlaps = sum(_overlap(scene.tracks[i], scene.tracks[j], reach_m) for i, j, reach_m in islice(pairs, most))
    if next(pairs, None) is not None:
        notes.append(f"overlaps are counted among the first {most:,} pairs that come near each other")
    off = off_on_map = None
    try:
        road = build_road(scene)
        off, off_on_map = (
            None if share is None else round(100.0 * (1.0 - share), 2) for share in on_road(road, centres)
        )
    except LogError as error:
        notes.append(str(error))
    kinds = Counter(track.agent.kind for track in scene.tracks)
    if len(speeds) and speeds.max() > _FAST_MPS:
        notes.append(f"a vehicle moves at {speeds.max():.0f} m/s: the log has jumps")
    return Inspection(
        scenario=scene.name,
        format=format,
        agents=len(scene.tracks),
        kinds=", ".join(f"{number} {kind}" for kind, number in kinds.most_common()),
        duration_s=round(scene.duration_s, 3),
        dt_s=round(scene.dt, 6),
        ego=scene.ego,
        lanes=len(scene.road.lanes),
        edges=len(scene.road.edges),
        areas=len(scene.road.areas),
        signals=len(scene.signals),
        mean_m_s=round(float(speeds.mean()), 2) if len(speeds) else 0.0,
        max_m_s=round(float(speeds.max()), 2) if len(speeds) else 0.0,
        overlaps=overlaps,
        off_road_percent=off,
        off_road_on_map_percent=off_on_map,
        notes=tuple(notes),
    )


def moving_centres(scene: LoggedScene) -> tuple[Float[np.ndarray, "sample 2"], Float[np.ndarray, " sample"]]:
    """Centres [m] and speeds [m/s] of motor vehicles faster than 1 m/s, between samples that follow each other."""
    centres, found = [np.zeros((0, 2))], [np.zeros(0)]
    for track in scene.tracks:
        if track.agent.kind in VEHICLE_KINDS and track.agent.id != (scene.ego if scene.target else None):
            speed = steps_along(track.x, track.y) / (np.diff(track.step) * scene.dt)
            moving = (np.diff(track.step) == 1) & (speed > _MOVING_MPS)
            centres.append(np.stack([track.x, track.y], axis=-1)[:-1][moving])
            found.append(speed[moving])
    return np.concatenate(centres), np.concatenate(found)


def on_road(road: RoadMap, centres: Float[np.ndarray, "sample 2"]) -> tuple[float | None, float | None]:
    """The share of `centres` on the drivable area, from 0 to 1: of all, and of those within 10 m of a lane."""
    if not len(centres):
        return None, None
    inside = road.contains(centres)
    if not road.lanes:
        return float(inside.mean()), None
    near = np.unique(road.centre_lines.query(shapely.points(centres), predicate="dwithin", distance=_ON_MAP_M)[0])
    return float(inside.mean()), float(inside[near].mean()) if len(near) else None


def _near(tracks: Sequence[Track]) -> Iterator[tuple[int, int, float]]:
    """Pairs that share instants and extents, and the distance of their centres [m] below which boxes can touch."""
    reach = np.array([0.5 * np.hypot(t.agent.length, t.agent.width) for t in tracks])
    spans = np.array([(t.step[0], t.step[-1]) for t in tracks])
    low = np.array([(t.x.min(), t.y.min()) for t in tracks]) - reach[:, None]
    high = np.array([(t.x.max(), t.y.max()) for t in tracks]) + reach[:, None]
    for i in range(len(tracks)):
        meet = (spans[i, 0] <= spans[i + 1 :, 1]) & (spans[i + 1 :, 0] <= spans[i, 1])
        meet &= ((low[i] <= high[i + 1 :]) & (low[i + 1 :] <= high[i])).all(axis=1)
        for j in (i + 1 + np.flatnonzero(meet)).tolist():
            yield i, j, float(reach[i] + reach[j])


def _overlap(a: Track, b: Track, reach_m: float) -> bool:
    _, mine, theirs = np.intersect1d(a.step, b.step, assume_unique=True, return_indices=True)
    near = np.hypot(a.x[mine] - b.x[theirs], a.y[mine] - b.y[theirs]) <= reach_m
    if not near.any():
        return False
    first, second = _boxes(a, mine[near]), _boxes(b, theirs[near])
    return bool(np.any(overlap(first, second)))


def _boxes(track: Track, at: np.ndarray) -> Boxes:
    return Boxes(track.x[at], track.y[at], track.yaw[at], track.agent.length, track.agent.width)
