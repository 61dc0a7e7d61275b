"""Moves a scene, or turns it by quarter turns about the map's origin; its network is dropped."""

from dataclasses import replace

import numpy as np
import shapely

from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.scenario import Scenario, Tracks


def turned(points: np.ndarray, quarters: int) -> np.ndarray:
    """Points [m] turned to the left, exactly."""
    for _ in range(quarters % 4):
        points = np.stack([-points[..., 1], points[..., 0]], axis=-1)
    return points


def moved_scene(scenario: Scenario, by: tuple[float, float], quarters: int = 0) -> Scenario:
    """`scenario` turned to the left, then moved `by` so much [m]."""

    def there(points: np.ndarray) -> np.ndarray:
        return turned(np.asarray(points, float), quarters) + by

    def of(tracks: Tracks | None) -> Tracks | None:
        if tracks is None:
            return None
        x, y = np.moveaxis(there(np.stack([tracks.x, tracks.y], axis=-1)), -1, 0)
        return replace(tracks, x=x, y=y, yaw=tracks.yaw + 0.5 * np.pi * quarters)

    road = RoadMap(
        tuple(replace(lane, centre=there(lane.centre)) for lane in scenario.road.lanes),
        scenario.road.connections,
        shapely.transform(scenario.road.drivable, there),
    )
    x, y = there(np.array(scenario.target)).tolist()
    return replace(
        scenario, tracks=of(scenario.tracks), log=of(scenario.log), evasion=of(scenario.evasion),
        road=road, target=(x, y),
    )  # fmt: skip
