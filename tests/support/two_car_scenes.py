"""Two cars on a road or a crossroads, moved as a test says, and the collision that comes of it."""

import numpy as np
import shapely
from moved_scenes import carried
from scenes import TIME, moving, scene

from regents_cosim.maps.roadmap import Connection, Lane, RoadMap
from regents_cosim.scenario.scenario import Signal


def lane_change(begin, y0, y1, seconds=1.0):
    return y0 + (y1 - y0) * np.clip((TIME - begin) / seconds, 0.0, 1.0)


def crossroads(west="r", south="G"):
    """Two roads that cross at the origin under one signal: from the west, and from the south."""
    line = {
        "west": ((-200.0, 0.0), (-10.0, 0.0)),
        "ew": ((-10.0, 0.0), (10.0, 0.0)),
        "east": ((10.0, 0.0), (200.0, 0.0)),
    }
    line |= {
        name: tuple(p[::-1] for p in line[twin]) for name, twin in (("south", "west"), ("sn", "ew"), ("north", "east"))
    }
    lanes = tuple(
        Lane(name, np.array(points), 3.4, 14.0, junction=name in ("ew", "sn")) for name, points in line.items()
    )
    links = (
        Connection("west", "ew", "light", 0), Connection("ew", "east"),
        Connection("south", "sn", "light", 1), Connection("sn", "north"),
    )  # fmt: skip
    road = RoadMap(lanes, links, shapely.box(-200, -10, 200, 10) | shapely.box(-10, -200, 10, 200))
    made = scene((-30, 0, 10), (0, -30, 10), road=road, signals=(Signal("light", ((0, west + south),)),))
    return moving(made, 1, x=np.zeros(81), y=-30 + 10 * TIME, yaw=np.full(81, np.pi / 2))


def transformed(made, turn, dx, dy, side):
    """The scene turned, moved and, for side = -1, mirrored."""
    cos, sin = np.cos(turn), np.sin(turn)

    def placed(points):
        x, y = np.moveaxis(points, -1, 0)
        return np.stack([dx + cos * x - sin * side * y, dy + sin * x + cos * side * y], axis=-1)

    return carried(made, placed, turn, side)
