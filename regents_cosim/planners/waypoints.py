"""Turn waypoints into a control: pure pursuit for the curvature, the pace of the points for the speed."""

import numpy as np

from regents_cosim.planners.interface import AgentState, Control, Scene, Waypoints

_MIN_AHEAD_M = 3.0  # least distance of the point that pure pursuit aims at
_AHEAD_S = 0.5


def follow(waypoints: Waypoints, ego: AgentState, scene: Scene) -> Control:
    """The control that brings `ego` along `waypoints`, within the limits of `scene`.

    The wanted speed is the mean pace up to the second point; the curvature leads through the first point that is far
    enough ahead (Coulter 1992).
    """
    points = np.asarray(waypoints.points, float)
    ahead = points - [ego.x, ego.y]
    horizon = min(len(points), 2)
    length = np.hypot(*np.diff(np.vstack([[0.0, 0.0], ahead[:horizon]]), axis=0).T).sum()
    wanted = length / (horizon * waypoints.spacing_s)
    # Under constant acceleration the speed half-way through the horizon is the mean pace.
    accel = 2.0 * (wanted - ego.speed) / (horizon * waypoints.spacing_s)
    accel = max(accel, -ego.speed / scene.dt)
    return Control(
        float(np.clip(accel, -scene.max_accel, scene.max_accel)),
        float(np.clip(_curvature(ahead, ego), -scene.max_curvature, scene.max_curvature)),
    )


def _curvature(ahead: np.ndarray, ego: AgentState) -> float:
    away = np.hypot(*ahead.T)
    far_enough = np.flatnonzero(away >= max(_MIN_AHEAD_M, _AHEAD_S * ego.speed))
    aim = int(far_enough[0]) if len(far_enough) else len(ahead) - 1
    if away[aim] < 0.1:
        return 0.0
    dx, dy = ahead[aim]
    left = dy * np.cos(ego.yaw) - dx * np.sin(ego.yaw)
    return 2.0 * float(left) / max(float(away[aim]) ** 2, 1.0)
