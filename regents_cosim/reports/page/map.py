"""A map on the page of the report: the parts around the cases, to a few centimetres."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry.base import BaseGeometry

from regents_cosim.cases.map_files import map_files
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.reports.drawing.road import lights_of, markings, polygons, stop_bar, stripes
from regents_cosim.reports.page.packing import line
from regents_cosim.scenario.scenario import Scenario

_AROUND_M = 45.0  # around everything that moves
_DETAIL_M = 0.04


@dataclass(frozen=True, eq=False)
class PageMap:
    """One map, and the places on it where cases happen."""

    index: int  # index of the map on the page
    road: RoadMap
    origin: Float[np.ndarray, " 2"]  # of the page's positions, in whole metres: a corner of the first case
    places: list[BaseGeometry]  # surroundings of everything that moves, by case

    @cached_property
    def area(self) -> BaseGeometry:
        """The surroundings of everything that moves [m]; complete once all cases are known."""
        return shapely.union_all(self.places)

    def content(self) -> dict[str, Any]:
        """Rings of the road, of walkways and of stripes; lines on the road, and stop bars with their lights."""
        dashed, solid = self._markings()
        walks, crossings = self._walkways()
        return {
            "rings": self._rings(self.road.drivable),
            "walks": walks,
            "stripes": crossings,
            "dashed": dashed,
            "solid": solid,
            "bars": list(self._bars()),
        }

    def _rings(self, area: BaseGeometry) -> list[Any]:
        near = shapely.simplify(shapely.intersection(area, self.area), _DETAIL_M)
        rings = (ring for part in polygons(near) for ring in (part.exterior, *part.interiors))
        return [line(shapely.get_coordinates(ring), self.origin) for ring in rings]

    def _walkways(self) -> tuple[list[Any], list[Any]]:
        near = [walkway for walkway in self.road.walkways if walkway.area.intersects(self.area)]
        crossings = [walkway for walkway in near if walkway.kind == "crossing"]
        beside = shapely.union_all([walkway.area for walkway in near if walkway.kind != "crossing"])
        return self._rings(beside), [line(one, self.origin) for crossing in crossings for one in stripes(crossing)]

    def _markings(self) -> tuple[list[Any], list[Any]]:
        kinds: tuple[list[Any], list[Any]] = ([], [])
        for index in np.sort(self.road.centre_lines.query(self.area, predicate="intersects")):
            lane = self.road.lanes[index]
            if not lane.junction:
                for kept, lines in zip(kinds, markings(lane), strict=True):
                    kept += [line(part, self.origin) for each in lines for part in self._inside(each)]
        return kinds

    def _inside(self, points: Float[np.ndarray, "point 2"]) -> Iterator[Float[np.ndarray, "point 2"]]:
        """The stretches of a line within the area."""
        near = shapely.intersection(shapely.simplify(shapely.LineString(points), _DETAIL_M), self.area)
        for part in shapely.get_parts(near):
            if part.geom_type == "LineString":
                yield shapely.get_coordinates(part)

    def _bars(self) -> Iterator[dict[str, Any]]:
        for lane in self.road.lanes:
            lights = lights_of(self.road.exits[lane.id])
            if lights and shapely.contains_xy(self.area, *lane.centre[-1]):
                for (signal, link), part in zip(lights, stop_bar(lane, len(lights))[1:], strict=True):
                    yield {"signal": signal, "link": link, "corners": line(part, self.origin)}


class PageMaps:
    """The maps of a page, each once, in the order of cases."""

    def __init__(self) -> None:
        self._by_name: dict[str, PageMap] = {}

    def home(self, case: Scenario) -> PageMap:
        """The map of a case, extended by the case's surroundings."""
        name, place = map_files(case.road).road, _surroundings(case)
        if name not in self._by_name:
            corner = np.floor(np.array(place.bounds[:2]))
            self._by_name[name] = PageMap(len(self._by_name), case.road, corner, [])
        self._by_name[name].places.append(place)
        return self._by_name[name]

    @property
    def maps(self) -> list[PageMap]:
        """All maps."""
        return list(self._by_name.values())


def _surroundings(case: Scenario) -> BaseGeometry:
    there = case.tracks.valid
    x, y = case.tracks.x[there], case.tracks.y[there]
    return shapely.box(x.min() - _AROUND_M, y.min() - _AROUND_M, x.max() + _AROUND_M, y.max() + _AROUND_M)
