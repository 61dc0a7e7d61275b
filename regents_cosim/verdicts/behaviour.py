"""Measure from the tracks how the adversary comes to its crash; saved with the case, so that maps need no tracks."""

from dataclasses import dataclass

import numpy as np

from regents_cosim.attack_record import Collision
from regents_cosim.cases.header import Behaviour
from regents_cosim.scenario import Scenario
from regents_cosim.verdicts.careful.perception import departs_step

_DECIMALS = 3  # millimetres and milliseconds: rounding makes the values the same on all processors


def behaviour_of(scenario: Scenario) -> Behaviour | None:
    """How the adversary comes to its crash; None for a case without a crash or without the tracks before the attack."""
    found = deviation(scenario)
    hit = scenario.attack.collision if scenario.attack else None
    if found is None or hit is None:
        return None
    agent = next(i for i, one in enumerate(scenario.agents) if one.id == hit.agent)
    departs = departs_step(scenario, agent)
    seconds = None if departs is None else round((hit.step - departs) * scenario.dt, _DECIMALS)
    return Behaviour(seconds, round(found.mean_m, _DECIMALS))


@dataclass(frozen=True)
class Deviation:
    """Distance to the log over the steps up to the collision."""

    mean_m: float
    max_m: float


def deviation(attacked: Scenario) -> Deviation | None:
    """The deviation of the agent that the ego collides with; None where the attack found no collision."""
    hit = attacked.attack.collision if attacked.attack and attacked.attack.outcome == "collision" else None
    if hit is None or attacked.log is None:
        return None
    agent = next(i for i, a in enumerate(attacked.agents) if a.id == hit.agent)
    now, log, until = attacked.tracks, attacked.log, np.s_[agent, : hit.step + 1]
    apart = np.hypot(now.x[until] - log.x[until], now.y[until] - log.y[until])[now.valid[until] & log.valid[until]]
    return Deviation(float(apart.mean()), float(apart.max()))


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
