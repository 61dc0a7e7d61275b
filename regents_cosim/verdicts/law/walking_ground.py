"""The ground on which the law lets a person walk, from the sidewalks, walking areas and crossings of a map.

It is everything except the carriageway near a crossing and off it: pedestrians "shall use a pedestrian crossing
whenever there is one nearby" (Vienna Convention on Road Traffic, art. 20(6)(a)). National law says how near: 50 m in
France (Code de la route, art. R412-37), which is used here; 20 m in Belgium.

The ground is known where a map tells its crossings, and has no roads above each other.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely
from jaxtyping import Bool, Float
from shapely.geometry.base import BaseGeometry

from regents_cosim.geometry.areas import prepared
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.maps.walkways import Walkway
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.verdicts.law.drive import AgentDrive, logged

NEAR_CROSSING_M = 50.0
_SEAM_M = 0.2  # between a crossing and the walking areas at its ends
_AROUND_M = 30.0  # around places whose distance is asked: no carriageway is deeper
_END_M = 1.0  # of a crossing: its corners reach into the walking area beside it
_GREEN = "gG"


@dataclass(frozen=True, eq=False)
class WalkingGround:
    """The walking ground of one map."""

    carriageway: BaseGeometry  # [m] including crossings
    forbidden: BaseGeometry  # [m] the part of it near a crossing and on none
    crossings: tuple[Walkway, ...]

    def off_m(self, points: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, " point"]:
        """Distance [m] of points from the allowed ground; 0 on it."""
        off = np.zeros(len(points))
        inside = np.flatnonzero(shapely.contains_xy(prepared(self.forbidden), *points.T))
        if len(inside):
            low, high = points[inside].min(axis=0) - _AROUND_M, points[inside].max(axis=0) + _AROUND_M
            edge = shapely.boundary(shapely.clip_by_rect(self.forbidden, *low, *high))
            off[inside] = shapely.distance(edge, shapely.points(points[inside]))
        return off

    def off_in_log_m(self, scenario: Scenario, agent: int) -> float:
        """Greatest distance from the allowed ground in a pedestrian's log; up to it there is no new offence."""
        return float(self.off_m(logged(scenario, agent).centre).max(initial=0.0))

    def allowed(self, low: Float[np.ndarray, " 2"], high: Float[np.ndarray, " 2"], off_m: float) -> BaseGeometry:
        """The allowed ground within bounds [m], extended by `off_m`."""
        reach = off_m + _AROUND_M
        forbidden = shapely.buffer(shapely.clip_by_rect(self.forbidden, *(low - reach), *(high + reach)), -off_m)
        return shapely.difference(shapely.box(*low, *high), forbidden)

    def on_carriageway(self, points: Float[np.ndarray, "point 2"]) -> Bool[np.ndarray, " point"]:
        """Whether points are on the carriageway, which includes crossings."""
        return shapely.contains_xy(prepared(self.carriageway), *points.T)

    def around(self, points: Float[np.ndarray, "point 2"]) -> list[Walkway]:
        """The crossings near some points."""
        (west, south), (east, north) = points.min(axis=0), points.max(axis=0)
        return [way for way in self.crossings if shapely.box(west, south, east, north).dwithin(way.area, way.width)]


@lru_cache(maxsize=16)
def walking_ground(road: RoadMap) -> WalkingGround | None:
    """The walking ground of a map; None where it does not tell its crossings, as a network from SUMO without any."""
    crossings = tuple(way for way in road.walkways if way.kind == "crossing")
    if not crossings and road.crossings is None:
        return None
    beside = shapely.union_all([way.area for way in road.walkways if way.kind != "crossing"])
    stripes = shapely.union_all([way.area for way in crossings])
    carriageway = shapely.difference(road.drivable, beside)
    near = shapely.intersection(carriageway, shapely.buffer(stripes, NEAR_CROSSING_M, quad_segs=4))
    return WalkingGround(carriageway, shapely.difference(near, shapely.buffer(stripes, _SEAM_M)), crossings)


def ground_of(scenario: Scenario) -> WalkingGround | None:
    """The walking ground of the scenario's map; None where unknown, or where roads lie above each other."""
    return None if scenario.heights.stacked else walking_ground(scenario.road)


def steppings(ground: WalkingGround, drive: AgentDrive) -> list[tuple[int, Walkway]]:
    """The steps at which the centre of a pedestrian enters crossings, in order, each with its crossing.

    The ends of a crossing lie in walking areas. A pedestrian that only cuts the corner of an end, as SUMO's persons do,
    does not use the crossing.
    """
    found, street = [], ground.on_carriageway(drive.centre)
    for crossing in ground.around(drive.centre):
        on = street & shapely.contains_xy(crossing.area, *drive.centre.T)
        far = np.asarray(shapely.line_locate_point(crossing.line, shapely.points(drive.centre)))
        length = crossing.line.length
        uses = np.minimum(far, length - far) > min(_END_M, 0.25 * length)
        edges = np.append(np.flatnonzero(np.diff(on.astype(int))), len(on) - 1)  # the last step before each change
        begins = np.flatnonzero(on[1:] & ~on[:-1]) + 1
        for begin in begins.tolist():
            end = edges[np.searchsorted(edges, begin)]
            if end == len(on) - 1 or uses[begin : end + 1].any():
                found.append((int(drive.steps[begin]), crossing))
    return sorted(found, key=lambda one: one[0])


def has_green(scenario: Scenario, ground: WalkingGround, place: Float[np.ndarray, " 2"], step: int) -> bool:
    """Whether a place is on a crossing whose light lets people cross."""
    here = [way for way in ground.around(place[None]) if way.area.covers(shapely.Point(place))]
    return any(scenario.shows(way.signal, way.link, step) in _GREEN for way in here)


def knows_crossing_lights(scenario: Scenario, ground: WalkingGround) -> bool:
    """Whether the lights of all crossings were recorded; logs hold none of them."""
    if scenario.road.crossings is not None:
        return False
    letters = {light.id: len(light.letters(0)) for light in scenario.signals}
    return all(way.link < letters.get(way.signal, 0) for way in ground.crossings if way.signal is not None)
