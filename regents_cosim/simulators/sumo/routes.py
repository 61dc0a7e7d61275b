"""Routes for SUMO: the edges along an agent's track and beyond its end."""

import itertools

import numpy as np

from regents_cosim.geometry.frames import Pose, to_sumo
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.routes.ego_route import lanes_ahead, lanes_under, logged_path
from regents_cosim.scenario.scenario import Scenario, Tracks

_ON_M = 300.0  # beyond the last lane of a track: 8 s at 37 m/s


def route_of(scenario: Scenario, agent: int) -> list[str] | None:
    """The edges along `agent`'s track before any attack, extended by 300 m where the network continues.

    None where SUMO could not drive it: the agent is never present, begins beside all lanes, or the edges do not
    connect.
    """
    tracks = scenario.recorded_tracks
    if not tracks.valid[agent].any():
        return None
    # In SUMO the front follows the lane; the centre cuts curves, and may be nearer to another lane of a junction.
    own = slice(agent, agent + 1)
    centre = Pose(tracks.x[own], tracks.y[own], tracks.yaw[own])
    x, y, _ = np.stack(to_sumo(centre, scenario.agents[agent].length))
    front = Tracks(x, y, tracks.yaw[own], tracks.speed[own], tracks.valid[own])
    matched = lanes_under(scenario, agent, logged_path(front))
    if matched[0] is None:
        return None
    lanes = [lane for lane in matched if lane is not None]
    further = lanes_ahead(scenario.road, lanes[-1], lanes[-1].length + _ON_M)
    edges = edges_along(scenario.road, [*lanes, *further])
    joined = all(_follows(scenario.road, *pair) for pair in itertools.pairwise(edges))
    return edges if edges and joined else None


def edges_along(road: RoadMap, lanes: list[Lane]) -> list[str]:
    """The edges that `lanes` belong to; if they begin within a junction, the edge before it comes first."""
    first = lanes[0]
    before = {link.target: link.source for link in road.connections}
    while first.junction and first.id in before:
        first = road.lane[before[first.id]]
        lanes = [first, *lanes]
    names = [edge_of(lane) for lane in lanes if not lane.junction]
    return [name for index, name in enumerate(names) if index == 0 or name != names[index - 1]]


def edge_of(lane: Lane) -> str:
    """The edge of a lane; SUMO derives names of lanes from it."""
    return lane.id.rpartition("_")[0]


def _follows(road: RoadMap, edge: str, following: str) -> bool:
    """Whether a lane of `edge` leads to one of `following`, through at most a junction."""
    ahead = [lane for lane in road.lanes if edge_of(lane) == edge]
    seen = set[str]()
    while ahead:
        for link in road.exits[ahead.pop().id]:
            lane = road.lane[link.target]
            if not lane.junction and edge_of(lane) == following:
                return True
            if lane.junction and lane.id not in seen:
                seen.add(lane.id)
                ahead.append(lane)
    return False
