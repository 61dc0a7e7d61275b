"""Two cars on a road or a crossroads, moved as a test says, and the collision that comes of it."""

from dataclasses import replace

import numpy as np
import shapely
from scenes import scene

from regents_cosim.attack_record import AttackRecord, Collision
from regents_cosim.collisions import collision_type_of, first_contact
from regents_cosim.maps.roadmap import Connection, Lane, RoadMap
from regents_cosim.scenario import Signal

TIME = 0.1 * np.arange(81)


def crashed(made):
    """`made` as if an attack had ended in its first contact."""
    agent, step = first_contact(made.agents, made.tracks)
    kind = collision_type_of(made.agents, made.tracks, agent, step)
    hit = Collision(made.agents[agent].id, step, 0.1 * step, kind, 5.0, True)
    agents = tuple(replace(a, role="adversary") if i == agent else a for i, a in enumerate(made.agents))
    record = AttackRecord(made.id, "king", "idm", "collision", 3, hit)
    return replace(made, agents=agents, attack=record, log=made.tracks)


def moving(made, agent, **tracks):
    """The scenario with another track of one agent."""
    changed = {name: np.array(getattr(made.tracks, name)) for name in tracks}
    for name, values in tracks.items():
        changed[name][agent] = values
    return replace(made, tracks=replace(made.tracks, **changed))


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

    def placed(x, y):
        return dx + cos * x - sin * side * y, dy + sin * x + cos * side * y

    x, y = placed(made.tracks.x, made.tracks.y)
    lanes = tuple(
        replace(lane, centre=np.stack(placed(*lane.centre.T), axis=-1), left=lane.right, right=lane.left)
        if side < 0
        else replace(lane, centre=np.stack(placed(*lane.centre.T), axis=-1))
        for lane in made.road.lanes
    )
    drivable = shapely.transform(made.road.drivable, lambda p: np.stack(placed(*p.T), axis=-1))
    road = RoadMap(lanes, made.road.connections, drivable)
    return replace(made, tracks=replace(made.tracks, x=x, y=y, yaw=turn + side * made.tracks.yaw), road=road)
