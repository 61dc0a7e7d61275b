"""FISS+ of `fiss-planner` (Sun et al., IROS 2023), at the wheel of an ego.

    pip install fiss-planner numpy msgspec shapely jaxtyping    # in an environment of its own, or in ours
    --planner python:ENVIRONMENT/bin/python:regents_cosim.planners.adapters.fiss:FissPlanner

It gets the map's lanes with their neighbours and limits and the lanes of `Scene.route`, changes lanes by itself,
expects the others to follow their lanes, and stops at red lights.
"""

from typing import Any

import fiss_planner as fp  # pyright: ignore[reportMissingImports]
import numpy as np

from regents_cosim.maps.lanelets import ribbons
from regents_cosim.planners.adapters.seen import near, red_light
from regents_cosim.planners.interface import (
    MOST_PATHS,
    MOST_POINTS,
    WHEELBASE,
    Control,
    Debug,
    Observation,
    Path,
    Scene,
)

_NO_LANE = -1
_HORIZON_S = 5.5  # of the others' expected ways, longer than a trajectory


class FissPlanner:
    """Asks the package at every step, and drives along its trajectory."""

    def reset(self, scene: Scene) -> None:
        """Begin a drive: a new planner with the map and the route."""
        vehicle = fp.VehicleParams()
        vehicle.length, vehicle.width = scene.ego.length, scene.ego.width
        vehicle.wheelbase = WHEELBASE * scene.ego.length
        vehicle.rear_axle_to_center = 0.0  # the model of the ego turns about the centre of its box
        vehicle.max_decel = scene.max_accel
        vehicle.max_steer = float(np.arctan(scene.max_curvature * vehicle.wheelbase))
        config = fp.LocalPlannerConfig()
        config.planner.keep_candidates = True
        self._planner = fp.LocalPlanner(config, vehicle)
        self._lanes, self._map = {lane.id: number for number, lane in enumerate(scene.road.lanes)}, fp.RoadMap()
        if scene.route.by_lanes:
            self._fill(scene)
            self._planner.set_map(self._map, [self._lanes[one.lane] for one in scene.route.lanes])
        else:
            self._planner.set_reference_path(*scene.route.points.T.tolist())
        self._curvature = 0.0

    def act(self, observation: Observation) -> Control:
        """The next control along the package's trajectory."""
        ego, scene, red = observation.ego, observation.scene, red_light(observation)
        for light in scene.route.lights:
            self._planner.set_stop_line_active(self._lanes[light.lane], red is not None and red.lane == light.lane)
        now = fp.EgoState(ego.x, ego.y, ego.yaw, ego.speed, observation.acceleration, self._curvature)
        expected = self._expected(observation)
        planned = self._planner.step(observation.time_s, now, expected)
        debug = _thought(planned, expected)
        if len(planned.trajectory.t) < 2:
            return Control(-min(scene.max_accel, ego.speed / scene.dt), self._curvature, debug)
        soon = planned.trajectory.sample(scene.dt)
        self._curvature = float(np.clip(soon.kappa, -scene.max_curvature, scene.max_curvature))
        accel = float(np.clip((soon.v - ego.speed) / scene.dt, -scene.max_accel, scene.max_accel))
        return Control(accel, self._curvature, debug)

    def _fill(self, scene: Scene) -> None:
        """The lanes, and a stop line at the end of those of the route that have a light."""
        road, sides = scene.road, ribbons(scene.road)
        for lane in road.lanes:
            one = fp.MapLane()
            one.id, one.speed_limit, one.centerline = self._lanes[lane.id], lane.speed_limit, lane.centre
            one.left, one.right = sides[lane.id]
            one.left_neighbor, one.right_neighbor = (
                _NO_LANE if name is None else self._lanes[name] for name in (lane.left, lane.right)
            )
            one.can_change_left, one.can_change_right = lane.left is not None, lane.right is not None
            one.successors = [self._lanes[link.target] for link in road.exits[lane.id]]
            one.predecessors = [self._lanes[link.source] for link in road.entries[lane.id]]
            self._map.add_lane(one)
        for light in scene.route.lights:
            number = self._lanes[light.lane]
            self._map.add_stop_line(fp.StopLine(number, number, road.lane[light.lane].length, False))
        self._map.finalize()

    def _expected(self, observation: Observation) -> list[fp.Obstacle]:
        """The others on their way along their lanes."""
        span = _HORIZON_S, observation.scene.dt
        return [
            fp.predict_lane_following(self._map, number, a.x, a.y, a.yaw, a.speed, a.length, a.width, *span)
            for number, a in enumerate(near(observation))
        ]


def _thought(planned: Any, expected: list[fp.Obstacle]) -> Debug:
    """The trajectories that it sampled, every few of them, with their costs, and where it expects the others."""
    every = [one for one in getattr(planned, "candidates", ()) if len(one.x) and np.isfinite(one.total_cost())]
    shown = every[:: -(-len(every) // MOST_PATHS) or 1]
    return Debug(
        candidates=[_path(one) for one in shown],
        costs=[one.total_cost() for one in shown],
        chosen=_path(planned.trajectory) if len(planned.trajectory.x) else None,
        predictions=[
            np.array([[state.x, state.y] for state in one.prediction])[:MOST_POINTS] for one in expected[:MOST_PATHS]
        ],
        text=f"{len(every)} trajectories",
    )


def _path(trajectory: Any) -> Path:
    return np.stack([trajectory.x, trajectory.y], axis=-1)[:MOST_POINTS]
