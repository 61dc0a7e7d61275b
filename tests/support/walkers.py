"""Scenes with a pedestrian or a cyclist."""

import gzip
from dataclasses import replace

import numpy as np
import shapely
from scenes import DT, moved

from regents_cosim.maps.roadmap import Connection, Lane, RoadMap

SIZES = {"pedestrian": (0.5, 0.6), "bicycle": (1.8, 0.65)}


def as_kind(made, agent, kind):
    """`made` with an agent of another kind and of its size."""
    length, width = SIZES[kind]
    agents = (replace(a, kind=kind, length=length, width=width) if i == agent else a for i, a in enumerate(made.agents))
    return replace(made, agents=tuple(agents))


def moved_through(made, agent, x, y):
    """The tracks of `made` with an agent that goes through these places, facing where it goes."""
    vx, vy = np.gradient(x) / DT, np.gradient(y) / DT
    return moved(made, agent, x=x, y=y, yaw=np.unwrap(np.arctan2(vy, vx)), speed=np.hypot(vx, vy))


def walked(made, agent, x, y):
    """`made` with a pedestrian that walks through these places in place of an agent."""
    return replace(as_kind(made, agent, "pedestrian"), tracks=moved_through(made, agent, x, y))


ZEBRA = """<net><edge id=":J_0" function="internal"><lane id=":J_0_0" index="0" shape="36,0 44,0"/></edge>
<edge id=":J_c0" function="crossing" crossingEdges="out"><lane id=":J_c0_0" shape="40,-1.6 40,4.8" width="4"/></edge>
<edge id=":J_w0" function="walkingarea"><lane id=":J_w0_0" shape="34,-4.6 46,-4.6 46,-1.6 34,-1.6"/></edge>
<edge id=":J_w1" function="walkingarea"><lane id=":J_w1_0" shape="34,4.8 46,4.8 46,7.8 34,7.8"/></edge>
<junction id="J" type="priority" intLanes=":J_0_0 :J_c0_0">
<request index="0" response="{vehicle}0" foes="10"/><request index="1" response="0{person}" foes="01"/></junction>
<connection from=":J_w0" to=":J_c0" fromLane="0" toLane="0" {light}/></net>"""


def zebra(light=False, person_first=True):
    """A street along x from -200 to 600 m, the lane to the east at y = 0, with a crossing at x = 38 to 42 m."""
    east, there, west = (
        np.array(ends, float) for ends in ([[-200, 0], [36, 0]], [[36, 0], [44, 0]], [[44, 0], [600, 0]])
    )
    lanes = [Lane("in", east, 3.2, 15.0), Lane(":J_0_0", there, 3.2, 15.0, junction=True), Lane("out", west, 3.2, 15.0)]
    lanes.append(Lane("back", np.array([[600.0, 3.2], [-200.0, 3.2]]), 3.2, 15.0))
    links = (Connection("in", ":J_0_0", "J" if light else None), Connection(":J_0_0", "out"))
    net = ZEBRA.format(vehicle=int(person_first), person=int(not person_first), light='tl="J" linkIndex="1"' * light)
    return RoadMap(tuple(lanes), links, shapely.box(-200.0, -1.6, 600.0, 4.8), gzip.compress(net.encode(), mtime=0))
