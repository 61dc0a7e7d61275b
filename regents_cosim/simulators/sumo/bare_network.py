"""A SUMO network of bare lanes for maps that do not come from SUMO: vehicles are placed on it, SUMO cannot drive there.

Every lane is an edge between two dead ends; there are no junctions, connections or lights. A map without lanes gets one
lane across it, since SUMO accepts no network without an edge. The network is written here because netconvert, which
makes real networks, does not come with libsumo.

Source of the format: SUMO's documentation, "SUMO Road Networks".
"""

import gzip
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from jaxtyping import Float

from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.system.files.atomic import scratch_folder

_FASTEST_M_S = 60.0  # SUMO accepts no infinite limit
_LEAST_M = 0.1  # shortest lane
_WIDTH_M = 3.2  # SUMO's default
BARE_EDGE = "0"  # name of the first edge


def network_of(road: RoadMap) -> bytes:
    """The SUMO network (gzip) of a map: the one that it was read from, or one of its bare lanes."""
    return road.sumo_net or gzip.compress(_bare(road), mtime=0)


def lane_names(road: RoadMap) -> dict[str, str]:
    """SUMO's name of each lane in `network_of` the map: names in logs contain characters that SUMO does not accept."""
    if road.sumo_net:
        return {lane.id: lane.id for lane in road.lanes}
    return {lane.id: f"{number}_0" for number, lane in enumerate(road.lanes)}


def _bare(road: RoadMap) -> bytes:
    net = ET.Element("net", version="1.20")
    lanes = road.lanes or (_across(road),)
    points = np.concatenate([lane.centre for lane in lanes])
    bounds = ",".join(f"{value:.2f}" for value in (*points.min(axis=0), *points.max(axis=0)))
    ET.SubElement(net, "location", netOffset="0.00,0.00", convBoundary=bounds, origBoundary=bounds, projParameter="!")
    for number, lane in enumerate(lanes):
        net.append(_edge(str(number), lane))
    for number, lane in enumerate(lanes):
        net.append(_dead_end(f"{number}from", lane.centre[0], ""))
        net.append(_dead_end(f"{number}to", lane.centre[-1], f"{number}_0"))
    ET.indent(net)
    return ET.tostring(net, encoding="utf-8", xml_declaration=True)


def _across(road: RoadMap) -> Lane:
    """A lane from one corner of the drivable area to the opposite one."""
    west, south, east, north = road.drivable.bounds
    return Lane("across", np.array([[west, south], [east, north]]), _WIDTH_M, _FASTEST_M_S)


def _edge(name: str, lane: Lane) -> ET.Element:
    edge = ET.Element("edge", {"id": name, "from": f"{name}from", "to": f"{name}to", "priority": "1"})
    ET.SubElement(
        edge,
        "lane",
        id=f"{name}_0",
        index="0",
        speed=f"{min(lane.speed_limit, _FASTEST_M_S):.2f}",
        length=f"{max(lane.length, _LEAST_M):.3f}",
        width=f"{lane.width:.3f}",
        shape=" ".join(map(_place, lane.centre)),
    )
    return edge


def _dead_end(name: str, place: Float[np.ndarray, " 2"], arriving: str) -> ET.Element:
    x, y = _place(place).split(",")
    return ET.Element(
        "junction", id=name, type="dead_end", x=x, y=y, incLanes=arriving, intLanes="", shape=_place(place)
    )


def _place(point: Float[np.ndarray, " 2"]) -> str:
    return f"{point[0]:.3f},{point[1]:.3f}"


@contextmanager
def network_file(net: bytes) -> Iterator[Path]:
    """A temporary file with the unpacked network `net` (gzip)."""
    with scratch_folder() as folder:
        path = folder / "replay.net.xml.gz"
        path.write_bytes(net)
        yield path
