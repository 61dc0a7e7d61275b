"""Find the step at which a driver can see that the adversary departs from its log."""

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.geometry.frames import wrap
from regents_cosim.norms.careful import CAREFUL
from regents_cosim.norms.limits import STANDING_M_S
from regents_cosim.scenario import Scenario, Tracks
from regents_cosim.verdicts.careful.lane_keeping import from_lane_centre

_PLACE_M = 0.5
_HEADING_RAD = np.deg2rad(5.0)
_SPEED_M_S = 1.5


def departs_step(attacked: Scenario, agent: int) -> int | None:
    """The first step at which `agent` visibly departs from its log; None where it never does before the crash.

    A visible departure is 0.5 m, 5 degrees or 1.5 m/s off its log, or 0.375 m further from the middle of the lanes in
    its direction.
    """
    hit = attacked.attack.collision if attacked.attack else None
    if attacked.log is None or hit is None:
        return None
    seen = _departs(attacked, attacked.log, agent)[: hit.step + 1]
    return int(np.argmax(seen)) if seen.any() else None


def _departs(attacked: Scenario, log: Tracks, agent: int) -> Bool[np.ndarray, " time"]:
    now = attacked.tracks
    moves = (now.speed[agent] > STANDING_M_S) & (log.speed[agent] > STANDING_M_S)
    off = np.hypot(now.x[agent] - log.x[agent], now.y[agent] - log.y[agent]) > _PLACE_M
    off |= moves & (np.abs(wrap(now.yaw[agent] - log.yaw[agent])) > _HEADING_RAD)
    off |= np.abs(now.speed[agent] - log.speed[agent]) > _SPEED_M_S
    wander = _from_lane(attacked, now, agent)
    logged = _from_lane(attacked, log, agent)
    off |= moves & np.isfinite(logged) & (wander > np.where(np.isfinite(logged), logged, 0.0) + CAREFUL.wandering_m)
    return off & now.valid[agent] & log.valid[agent]


def _from_lane(attacked: Scenario, tracks: Tracks, agent: int) -> Float[np.ndarray, " time"]:
    place = (values[agent] for values in (tracks.x, tracks.y, tracks.yaw, tracks.z))
    return np.abs(from_lane_centre(attacked.road, *place))
