"""Numbers of the competent and careful driver, with their sources."""

from dataclasses import dataclass

import numpy as np

from regents_cosim.norms.limits import GRAVITY_M_S2


@dataclass(frozen=True)
class CarefulParameters:
    """The competent and careful human driver of UN Regulation 157.

    Source: UN R157, Annex 4, Appendix 3 (Annex 3 in the 01 series), performance models: a lane change is perceived
    0.375 m from the middle of the lane; 0.4 s to evaluate the risk; 0.75 s until the deceleration begins; 0.774 g,
    built up in 0.6 s (12.65 m/s^3); a cut-in is a danger below 2 s to collision, a leader once it brakes by more than
    5 m/s^2. The rest is ours: what it looks at on
    roads that are no motorway, that it dismisses a danger which it has not seen for as long as it takes to evaluate
    one, that it relies on its priority while others need no more than a comfortable deceleration to wait (3.4 m/s^2:
    AASHTO, A Policy on Geometric Design of Highways and Streets, 2018, 3.2.2), and swerves of half a car and a car,
    which the regulation's driver does not make.
    """

    wandering_m: float = 0.375
    lead_braking_m_s2: float = 5.0
    evaluation_s: float = 0.4
    dismissal_s: float = 0.4
    comfortable_m_s2: float = 3.4
    delay_s: float = 0.75
    most_braking_m_s2: float = 0.774 * GRAVITY_M_S2
    jerk_m_s3: float = 12.65
    swerves_m: tuple[float, ...] = (0.9, -0.9, 1.8, -1.8)
    swerve_m_s2: float = 4.0


@dataclass(frozen=True)
class Foresight:
    """How far ahead the driver looks, and how it samples that time."""

    ahead_s: float = 4.0
    lead_s: float = 2.0  # for road users that keep to the ego's lane and do not brake hard
    spacing_s: float = 0.25
    slack: int = 2  # spacings by which the ego may be earlier or later than expected
    over_s: float = 0.3  # past time over which turn and braking are measured
    along_rad: float = float(np.deg2rad(30.0))  # a road user whose heading differs by more crosses ...
    against_rad: float = float(np.deg2rad(150.0))  # ... and by more than this is oncoming

    @property
    def times_s(self) -> np.ndarray:
        """The times [s] from now at which the others are expected."""
        return self.spacing_s * np.arange(round(self.ahead_s / self.spacing_s) + 1)

    @property
    def ego_times_s(self) -> np.ndarray:
        """The times [s] from now at which the ego is expected, longer than `times_s` by the slack."""
        return self.spacing_s * np.arange(len(self.times_s) + self.slack)


CAREFUL = CarefulParameters()
FORESIGHT = Foresight()
