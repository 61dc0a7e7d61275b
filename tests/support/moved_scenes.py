"""Moves, turns or mirrors a whole scene; its network is dropped."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import shapely

from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.scenario.scenario import Scenario, Tracks


def turned(points: np.ndarray, quarters: int) -> np.ndarray:
    """Points [m] turned to the left, exactly."""
    for _ in range(quarters % 4):
        points = np.stack([-points[..., 1], points[..., 0]], axis=-1)
    return points


def moved_scene(scenario: Scenario, by: tuple[float, float], quarters: int = 0) -> Scenario:
    """`scenario` turned to the left, then moved `by` so much [m]."""
    return carried(scenario, lambda points: turned(np.asarray(points, float), quarters) + by, 0.5 * np.pi * quarters)


def carried(
    scenario: Scenario, there: Callable[[np.ndarray], np.ndarray], turn: float = 0.0, side: int = 1
) -> Scenario:
    """The scene with all points [m] taken `there`: mirrored if `side` is -1, then turned by `turn` [rad]."""

    def of(tracks: Tracks | None) -> Tracks | None:
        if tracks is None:
            return None
        x, y = np.moveaxis(there(np.stack([tracks.x, tracks.y], axis=-1)), -1, 0)
        curvature = None if tracks.curvature is None else side * tracks.curvature
        return replace(tracks, x=x, y=y, yaw=side * tracks.yaw + turn, curvature=curvature)

    lanes = (replace(lane, centre=there(lane.centre)) for lane in scenario.road.lanes)
    if side < 0:
        lanes = (replace(lane, left=lane.right, right=lane.left) for lane in lanes)
    road = RoadMap(tuple(lanes), scenario.road.connections, shapely.transform(scenario.road.drivable, there))
    x, y = there(np.array(scenario.target)).tolist()
    return replace(
        scenario, tracks=of(scenario.tracks), log=of(scenario.log), evasion=of(scenario.evasion),
        road=road, target=(x, y),
    )  # fmt: skip
