"""The lanes of a map as straight pieces, to find the lanes under a point, their direction, and their neighbours.

The pieces are built once per map. A point is in a lane if it lies beside the centre line, at most half the lane's width
away, and not before its begin or behind its end.
"""

import functools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from regents_cosim.geometry.boxes import Values, same_level
from regents_cosim.geometry.frames import wrap
from regents_cosim.geometry.lines import without_repeats
from regents_cosim.maps.roadmap import Lane, RoadMap

_SMOOTH_M = 0.05  # simplification may move a centre line by this much
_BEND_M = 1.0  # pieces extend beyond a bend, so that they leave no wedge
_PARALLEL_RAD = np.deg2rad(20.0)
_BESIDE_M = 1.0  # greatest gap between the edges of neighbours, on a map that names none


class LanesUnder(NamedTuple):
    """Pairs of a point and a lane under it."""

    point: Int[np.ndarray, " pair"]
    lane: Int[np.ndarray, " pair"]  # index into `RoadMap.lanes`
    left: Float[np.ndarray, " pair"]  # [m] offset from the centre line; negative to the right
    along: Float[np.ndarray, " pair"]  # [m] distance from the begin of the lane
    heading: Float[np.ndarray, " pair"]  # [rad] of the lane

    def take(self, chosen: np.ndarray) -> "LanesUnder":
        """Some of the pairs, by mask or index."""
        return LanesUnder(*(values[chosen] for values in self))


@dataclass(frozen=True, eq=False)
class LanePieces:
    """Straight pieces of centre lines, lane by lane."""

    lane: Int[np.ndarray, " piece"]
    start: Float[np.ndarray, "piece 2"]  # [m]
    ahead: Float[np.ndarray, "piece 2"]  # unit vector
    length: Float[np.ndarray, " piece"]  # [m]
    along: Float[np.ndarray, " piece"]  # [m] distance from the begin of the lane
    height: Float[np.ndarray, "piece 2"]  # [m] at either end
    begins: Bool[np.ndarray, " piece"]  # whether it is the first piece of its lane
    ends: Bool[np.ndarray, " piece"]
    half_width: Float[np.ndarray, " piece"]  # [m]
    tree: shapely.STRtree

    def under(
        self, points: Float[np.ndarray, "point 2"], z: Values = 0.0, beyond_m: Float[np.ndarray, " lane"] | float = 0.0
    ) -> LanesUnder:
        """The lanes under points [m] at height `z` [m], or beside them within `beyond_m`."""
        reach = float(self.half_width.max(initial=0.0) + np.max(beyond_m)) + _BEND_M
        point, piece = self.tree.query(shapely.points(points), predicate="dwithin", distance=reach)
        away = points[point] - self.start[piece]
        ahead = self.ahead[piece]
        along = (away * ahead).sum(axis=1)
        left = ahead[:, 0] * away[:, 1] - ahead[:, 1] * away[:, 0]
        room = self.half_width[piece] + (beyond_m if np.ndim(beyond_m) == 0 else np.asarray(beyond_m)[self.lane[piece]])
        inside = (np.abs(left) <= room) & self._abreast(piece, along) & self._level(piece, along, point, z)
        return self._nearest(point[inside], piece[inside], left[inside], along[inside])

    def _abreast(self, piece: np.ndarray, along: np.ndarray) -> Bool[np.ndarray, " pair"]:
        before = np.where(self.begins[piece], 0.0, -_BEND_M)
        behind = self.length[piece] + np.where(self.ends[piece], 0.0, _BEND_M)
        return (along >= before) & (along <= behind)

    def _level(self, piece: np.ndarray, along: np.ndarray, point: np.ndarray, z: Values) -> np.ndarray:
        part = np.clip(along / self.length[piece], 0.0, 1.0)
        height = (1.0 - part) * self.height[piece, 0] + part * self.height[piece, 1]
        return np.asarray(same_level(height, z if np.ndim(z) == 0 else np.asarray(z)[point]))

    def _nearest(self, point: np.ndarray, piece: np.ndarray, left: np.ndarray, along: np.ndarray) -> LanesUnder:
        """Keep for each lane at each point the nearest piece, since several pieces meet in a bend."""
        lane, over = self.lane[piece], np.maximum(np.maximum(-along, along - self.length[piece]), 0.0)
        order = np.lexsort((np.hypot(left, over), lane, point))
        first = np.ones(len(order), bool)
        first[1:] = (np.diff(point[order]) != 0) | (np.diff(lane[order]) != 0)
        kept = order[first]
        ahead = self.ahead[piece[kept]]
        onward = self.along[piece[kept]] + np.clip(along[kept], 0.0, self.length[piece[kept]])
        return LanesUnder(point[kept], lane[kept], left[kept], onward, np.arctan2(ahead[:, 1], ahead[:, 0]))


@functools.lru_cache(maxsize=64)
def lane_pieces(road: RoadMap) -> LanePieces:
    """The pieces of all lanes of a map."""
    lines = [_line(lane) for lane in road.lanes]
    count = np.array([max(len(line) - 1, 0) for line in lines], int)
    lane = np.repeat(np.arange(len(lines)), count)
    start = np.concatenate([np.zeros((0, 3)), *(line[:-1] for line in lines)])
    end = np.concatenate([np.zeros((0, 3)), *(line[1:] for line in lines)])
    way = end[:, :2] - start[:, :2]
    length = np.hypot(*way.T)
    upto = np.concatenate([[0.0], np.cumsum(length)])[:-1]
    begins, ends = np.diff(lane, prepend=-1) != 0, np.diff(lane, append=-1) != 0
    return LanePieces(
        lane=lane,
        start=start[:, :2],
        ahead=way / length[:, None],
        length=length,
        along=upto - np.repeat(upto[begins], count[count > 0]),
        height=np.stack([start[:, 2], end[:, 2]], axis=-1),
        begins=begins,
        ends=ends,
        half_width=np.array([0.5 * road.lanes[index].width for index in lane.tolist()]),
        tree=shapely.STRtree(np.asarray(shapely.linestrings(np.stack([start[:, :2], end[:, :2]], axis=1)))),
    )


@functools.lru_cache(maxsize=64)
def lane_lines(road: RoadMap) -> dict[str, shapely.LineString]:
    """The simplified centre line of every lane, by lane id."""
    return {lane.id: _smooth(lane) for lane in road.lanes}


def _smooth(lane: Lane) -> shapely.LineString:
    line = lane.line
    fewer = shapely.simplify(line, _SMOOTH_M, preserve_topology=False)
    return line if fewer.is_empty else fewer


def _line(lane: Lane) -> Float[np.ndarray, "point 3"]:
    """The points of a centre line with heights, without repeated points."""
    points = np.column_stack([lane.centre, lane.height])
    if not lane.height.any():
        flat = shapely.get_coordinates(_smooth(lane))
        points = np.column_stack([flat, np.zeros(len(flat))])
    return without_repeats(points)


@functools.lru_cache(maxsize=64)
def neighbours(road: RoadMap) -> dict[str, tuple[str, ...]]:
    """For every lane the ids of the lanes of the same direction that one may change to.

    On a map that names no neighbours they are found by position; a SUMO network names all neighbours.
    """
    named = {lane.id: tuple(filter(None, (lane.left, lane.right))) for lane in road.lanes}
    if road.sumo_net is None and not any(named.values()):
        return _beside(road)
    return {
        name: tuple(b for b in others if _same_way(road.lane[name], road.lane[b])) for name, others in named.items()
    }


def _same_way(one: Lane, other: Lane) -> bool:
    a, b = (lane.centre[-1] - lane.centre[0] for lane in (one, other))
    return float(a @ b) > 0.0


def _beside(road: RoadMap) -> dict[str, tuple[str, ...]]:
    """Lanes that run beside the middle of a lane, in the same direction, with at most a small gap between them."""
    pieces = lane_pieces(road)
    middle = np.array([lane.line.interpolate(0.5, normalized=True).coords[0] for lane in road.lanes])
    height = np.array([lane.height[len(lane.height) // 2] for lane in road.lanes])
    width = np.array([lane.width for lane in road.lanes])
    at = pieces.under(middle.reshape(-1, 2), height, 0.5 * width.max(initial=0.0) + _BESIDE_M)
    own = at.lane == at.point
    heading = np.zeros(len(road.lanes))
    heading[at.point[own]] = at.heading[own]
    apart = np.abs(at.left)
    sides = 0.5 * (width[at.point] + width[at.lane])
    parallel = np.abs(wrap(at.heading - heading[at.point])) < _PARALLEL_RAD
    beside = ~own & parallel & (apart <= sides + _BESIDE_M) & (apart >= 0.6 * sides)
    found: dict[str, list[str]] = {lane.id: [] for lane in road.lanes}
    for point, lane in zip(at.point[beside].tolist(), at.lane[beside].tolist(), strict=True):
        found[road.lanes[point].id].append(road.lanes[lane].id)
        found[road.lanes[lane].id].append(road.lanes[point].id)
    return {name: tuple(dict.fromkeys(others)) for name, others in found.items()}
