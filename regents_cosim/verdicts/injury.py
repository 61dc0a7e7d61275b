"""What being hit does to a pedestrian."""

import numpy as np


def death_risk(impact_m_s: float) -> float:
    """The share of adult pedestrians who die when the front of a car hits them at so many m/s.

    Source: Rosén and Sander 2009, "Pedestrian fatality risk as a function of car impact speed" (Accident Analysis and
    Prevention 41), from 2,127 pedestrians in GIDAS, weighted to the national statistics: 1 / (1 + exp(6.9 - 0.090 v)),
    v in km/h.
    """
    return float(1.0 / (1.0 + np.exp(6.9 - 0.090 * 3.6 * impact_m_s)))
