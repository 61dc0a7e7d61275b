"""The routes of a pedestrian to crossings on the ego's way, over ground on which the law lets it walk."""

from collections.abc import Iterator

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.attacks.starts.drive_lines import ContactRange
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.verdicts.law.walking_ground import WalkingGround

_MOST_PLACES = 80  # in one route: the nearest


class Routes:
    """Shortest routes of straight pieces between the ends and bends of sidewalks and crossings.

    A piece is possible where all of it is on allowed ground, extended by `off_m` [m].
    """

    def __init__(
        self, road: RoadMap, ground: WalkingGround, place: Float[np.ndarray, " 2"], reach_m: float, off_m: float
    ) -> None:
        self._allowed = ground.allowed(place - reach_m, place + reach_m, off_m)
        shapely.prepare(self._allowed)
        around = shapely.Point(place)
        self._crossings = [way for way in ground.crossings if shapely.dwithin(way.area, around, reach_m)]
        beside = [way for way in road.walkways if way.kind != "crossing" and shapely.dwithin(way.area, around, reach_m)]
        points = [_places(way.kind == "walkingarea", way.shape) for way in beside]
        ends = np.array([way.shape[at] for way in self._crossings for at in (0, -1)]).reshape(-1, 2)
        others = np.vstack([np.empty((0, 2)), *points])
        near = np.argsort(np.hypot(*(others - place).T), kind="stable")[:_MOST_PLACES]
        self._places = np.vstack([ends, others[near]])
        self._apart = np.stack([self._away(one) for one in self._places]) if len(self._places) else np.empty((0, 0))

    def over_crossings(
        self, place: Float[np.ndarray, " 2"], near: ContactRange, left_m: float
    ) -> Iterator[Float[np.ndarray, "point 2"]]:
        """Routes from a place over each crossing that comes `near` the ego, if its begin is within `left_m` [m]."""
        wanted = [i for i, way in enumerate(self._crossings) if near.is_met_by(shapely.LineString(way.shape))]
        if not wanted:
            return
        from scipy.sparse.csgraph import dijkstra  # takes long to import, and few attack on foot

        count = len(self._places)
        apart = np.zeros((count + 1, count + 1))  # 0: no way
        apart[:count, :count], apart[count, :count] = self._apart, self._away(place)
        away, before = dijkstra(apart, indices=count, return_predecessors=True)
        for crossing in wanted:
            for end in (2 * crossing, 2 * crossing + 1):
                if away[end] > left_m:
                    continue
                chain = [end]
                while before[chain[-1]] not in (count, -9999):
                    chain.append(int(before[chain[-1]]))
                shape = self._crossings[crossing].shape[:: 1 if end % 2 == 0 else -1]
                yield np.vstack([self._places[chain[:0:-1]], shape])

    def _away(self, place: Float[np.ndarray, " 2"]) -> Float[np.ndarray, " place"]:
        """Distances [m] to the places that can be reached straight from `place`; 0 for others."""
        straight = shapely.linestrings(np.stack([np.broadcast_to(place, self._places.shape), self._places], axis=1))
        can_go = shapely.covers(self._allowed, straight)
        return np.where(can_go, np.maximum(shapely.length(straight), 1e-6), 0.0)


def _places(area: bool, shape: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "place 2"]:
    """The places of a walkway: the line of a sidewalk, or the middle of a walking area."""
    return shape if not area else shapely.get_coordinates(shapely.point_on_surface(shapely.Polygon(shape).buffer(0.0)))
