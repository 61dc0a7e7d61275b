"""Finds lanes of a SUMO network that a vehicle class may use, since SUMO inserts no vehicle on a closed lane."""

from functools import cache
from pathlib import Path

import shapely
import sumolib


class PermittedLanes:
    """The lanes of a network file (.net.xml.gz)."""

    def __init__(self, network: Path) -> None:
        self._net = sumolib.net.readNet(str(network), withInternal=True)
        self.nearest = cache(self._nearest)
        self.line = cache(self._line)

    def _nearest(self, lane: str, vehicle_class: str) -> str:
        """The lane if it is open to a SUMO vehicle class, else the next open one of its edge, else the lane itself."""
        given = self._net.getLane(lane)
        beside = sorted(given.getEdge().getLanes(), key=lambda one: abs(one.getIndex() - given.getIndex()))
        return next((one.getID() for one in beside if one.allows(vehicle_class)), lane)

    def _line(self, lane: str) -> shapely.LineString:
        """The centre line of a lane [m]."""
        return shapely.LineString(self._net.getLane(lane).getShape())
