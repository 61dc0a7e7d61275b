"""Measure from the tracks how the adversary comes to its crash; saved with the case, so that maps need no tracks."""

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.cases.header import Behaviour
from regents_cosim.geometry.frames import wrap
from regents_cosim.norms.careful import CAREFUL
from regents_cosim.norms.limits import STANDING_M_S
from regents_cosim.scenario.attack_record import Collision
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.verdicts.careful.lane_keeping import from_lane_centre

_DECIMALS = 3  # millimetres and milliseconds: rounding makes the values the same on all processors
# A visible departure from the log:
_PLACE_M = 0.5
_HEADING_RAD = np.deg2rad(5.0)
_SPEED_M_S = 1.5


def behaviour_of(scenario: Scenario) -> Behaviour | None:
    """How the adversary comes to its crash; None for a case without a crash or without the tracks before the attack."""
    apart_m = deviation_m(scenario)
    hit = scenario.collision
    if apart_m is None or hit is None:
        return None
    agent = scenario.index(hit.agent)
    departs = departs_step(scenario, agent)
    seconds = None if departs is None else round((hit.step - departs) * scenario.dt, _DECIMALS)
    return Behaviour(seconds, round(apart_m, _DECIMALS))


def deviation_m(attacked: Scenario) -> float | None:
    """How far the agent that the ego collides with is from its log, in the mean up to the collision; None without."""
    hit = attacked.crash
    if hit is None or attacked.log is None:
        return None
    agent = attacked.index(hit.agent)
    now, log, until = attacked.tracks, attacked.log, np.s_[agent, : hit.step + 1]
    apart = np.hypot(now.x[until] - log.x[until], now.y[until] - log.y[until])[now.valid[until] & log.valid[until]]
    return float(apart.mean())


def departs_step(attacked: Scenario, agent: int) -> int | None:
    """The first step at which `agent` visibly departs from its log; None where it never does before the crash.

    A visible departure is 0.5 m, 5 degrees or 1.5 m/s off its log, or 0.375 m further from the middle of the lanes in
    its direction.
    """
    hit = attacked.collision
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


def death_risk(impact_m_s: float) -> float:
    """The share of adult pedestrians who die when the front of a car hits them at `impact_m_s` [m/s].

    Source: Rosén and Sander 2009, "Pedestrian fatality risk as a function of car impact speed" (Accident Analysis and
    Prevention 41), from 2,127 pedestrians in GIDAS, weighted to the national statistics: 1 / (1 + exp(6.9 - 0.090 v)),
    v in km/h.
    """
    return float(1.0 / (1.0 + np.exp(6.9 - 0.090 * 3.6 * impact_m_s)))


def death_risk_of(hit: Collision) -> float | None:
    """The `death_risk` in a collision; None where the ego's front hit no pedestrian, as the source covers only that."""
    return round(death_risk(hit.relative_speed), 4) if hit.collision_type == "person_by_front" else None
