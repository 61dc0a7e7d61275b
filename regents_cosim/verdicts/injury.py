"""The risk of death of a pedestrian who is hit by a car."""

import numpy as np

from regents_cosim.attack_record import Collision


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
