"""The limits of ordinary driving: from the traffic of the scene, and at least those known for the kind of vehicle."""

from dataclasses import dataclass, replace

import numpy as np

from regents_cosim.norms.careful import CAREFUL
from regents_cosim.norms.limits import ACCEL_LIMIT, MOST_ACCEL_M_S2, STANDING_M_S
from regents_cosim.scenario.collisions import collides_since
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.verdicts.handling import Handling, handling

AT_ONCE_M_S3 = CAREFUL.jerk_m_s3  # within a second accelerations change no faster than in emergency braking


@dataclass(frozen=True)
class DrivingLimits:
    """The greatest accelerations of ordinary drivers, each a mean over a second."""

    accel: float  # [m/s^2]
    braking: float  # [m/s^2]
    lateral_accel: float  # [m/s^2] to either side
    jerk: float  # [m/s^3] longitudinal change of acceleration over a second

    @property
    def jerk_at_once(self) -> float:
        """The greatest change of acceleration within a second [m/s^3]."""
        return max(self.jerk, AT_ONCE_M_S3)


# 99th percentiles over the steps of moving vehicles in crossing, signals and grid (seed 100) and eight scenes of the
# Waymo Open Motion Dataset: acceleration 1.6 to 2.5, braking 2.4 to 3.7, sideways 2.5 to 3.1 m/s^2, jerk 1.3 to 3.3.
# Cruise controls may do as much: 2 to 4 and 3.5 to 5 m/s^2 over 2 s, 2.5 to 5 m/s^3 over 1 s, the less the faster
# (ISO 15622:2018, 6.4);
# drivers take 2 to 3 m/s^2 sideways in cities (Treiber and Kesting 2013), lane keeping may 3 (UN R79).
CAR = DrivingLimits(accel=2.5, braking=3.5, lateral_accel=3.0, jerk=3.0)
# SUMO's trucks and buses accelerate by 1.2 to 1.3 (its vehicle type defaults); UN R79 lets them take 2.5 sideways.
HEAVY = replace(CAR, accel=1.3, lateral_accel=2.5)
# SUMO's bicycles accelerate by 1.2 and brake by 3.0 (its vehicle type defaults); leaning by 15 degrees, which bicycle
# ways are designed for (AASHTO 1999, Guide for the Development of Bicycle Facilities), holds 2.6 sideways. The four
# cyclists of eight Waymo and two Argoverse 2 scenes stay far below (99th percentiles: 0.9, 0.9, 0.3, jerk 1.7).
CYCLIST = DrivingLimits(accel=1.2, braking=3.0, lateral_accel=2.5, jerk=2.0)
# 99th percentiles over the moving steps of the 19 pedestrians of those scenes.
PEDESTRIAN = DrivingLimits(accel=0.85, braking=0.83, lateral_accel=0.91, jerk=1.4)

# Percentiles of noisy tracks are capped by what the mirror's controls, and tyres on dry asphalt, can do.
_CEILING = DrivingLimits(accel=ACCEL_LIMIT, braking=ACCEL_LIMIT, lateral_accel=MOST_ACCEL_M_S2, jerk=AT_ONCE_M_S3)
_PERCENTILE = 99.0
_ENOUGH_S = 60.0  # [s] of vehicles in motion: 0.6 of them are above the percentile


_OF_KIND = {"truck": HEAVY, "bus": HEAVY, "bicycle": CYCLIST, "pedestrian": PEDESTRIAN}


def ordinary(scenario: Scenario, kind: str) -> DrivingLimits:
    """The limits of ordinary driving for one kind, from the scenario's traffic as it was recorded.

    They are 99th percentiles over the steps in motion, and at least the limits known for the kind: a window of some
    seconds may hold nobody that has to brake. Where too few of the kind move, and for pedestrians always, only the
    known limits count: simulated pedestrians turn on the spot, which no recorded one does. Steps after a collision do
    not count.
    """
    if kind == "pedestrian":
        return PEDESTRIAN
    known, until, tracks = _OF_KIND.get(kind, CAR), collides_since(scenario), scenario.recorded_tracks
    alike = [index for index, one in enumerate(scenario.agents) if one.kind == kind]
    felt = [one for agent in alike for one in handling(tracks, agent, scenario.dt, int(until[agent]))]
    if not felt:
        return known
    moving = np.concatenate([one.speed for one in felt]) > STANDING_M_S
    if moving.sum() * scenario.dt < _ENOUGH_S:
        return known
    seen = {name: float(np.percentile(values[moving], _PERCENTILE)) for name, values in _magnitudes(felt).items()}
    within = {name: min(max(getattr(known, name), value), getattr(_CEILING, name)) for name, value in seen.items()}
    return DrivingLimits(**within)


def _magnitudes(felt: list[Handling]) -> dict[str, np.ndarray]:
    """The values of each limited quantity at all steps of some drives."""
    accel = np.concatenate([one.accel for one in felt])
    return {
        "accel": np.maximum(accel, 0.0),
        "braking": np.maximum(-accel, 0.0),
        "lateral_accel": np.concatenate([one.aside for one in felt]),
        "jerk": np.abs(np.concatenate([one.jerk for one in felt])),
    }
