"""Car-following models: how vehicles accelerate and brake behind leaders, for the prediction of traffic.

Sources: Krauss 1998, with the expected dawdling; Treiber, Hennecke and Helbing 2000 (Intelligent Driver Model, `idm`);
Treiber and Kesting 2013, chapter 11 (`improved_idm`, which reaches the wanted speed behind a leader).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.live.predict.traffic import Following
from regents_cosim.norms.following import LEAST_GAP_M, desired_gap

_EXPONENT = 4.0  # exponent of the speed in the Intelligent Driver Model
_LEAST_FREE = 0.01  # share of the acceleration that is left at the wanted speed
_LEAST_M_S = 0.1
_MOST_JERK = 3.0  # [m/s^3] of drivers with the improved model
_STOPPING_S = 0.1  # headway of Krauss' model before a place to stop, where it brakes as late as it can
_SLACK_S = 0.1  # times the speed: distance by which a vehicle stops shorter than by its square
_EASY = 1.5  # [m/s^2] braking of drivers with the improved model for a lower limit


def stops_within(speed: Float[np.ndarray, " n"], decel: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """The stopping distance [m] of vehicles that brake with `decel` [m/s^2], in SUMO's steps (speed at their end)."""
    return speed**2 / (2.0 * decel) - _SLACK_S * speed


@dataclass(frozen=True, eq=False)
class CarFollowing:
    """Car-following parameters and models of several road users."""

    krauss: Bool[np.ndarray, " user"]
    improved: Bool[np.ndarray, " user"]
    accel: Float[np.ndarray, " user"]  # [m/s^2]
    decel: Float[np.ndarray, " user"]  # [m/s^2]
    tau: Float[np.ndarray, " user"]  # [s]
    min_gap: Float[np.ndarray, " user"]  # [m]
    sigma: Float[np.ndarray, " user"]

    @classmethod
    def of(cls, users: Sequence[Following]) -> "CarFollowing":
        """The parameters of some users."""
        model = np.array([one.model for one in users])
        values = (np.array([getattr(one, name) for one in users])
                  for name in ("accel", "decel", "tau_s", "min_gap_m", "sigma"))  # fmt: skip
        return cls(model == "krauss", model == "improved_idm", *values)

    @property
    def most_jerk(self) -> Float[np.ndarray, " user"]:
        """The highest jerk when they begin to accelerate [m/s^3]."""
        return np.where(self.improved, _MOST_JERK, np.inf)

    @property
    def eases(self) -> Float[np.ndarray, " user"]:
        """Their braking for a lower limit [m/s^2]."""
        return np.where(self.improved, np.minimum(_EASY, self.decel), self.decel)

    def accelerations(
        self,
        speed: Float[np.ndarray, " user"],
        gap: Float[np.ndarray, " user"],
        lead: Float[np.ndarray, " user"],
        wanted: Float[np.ndarray, " user"],
        dt: float,
    ) -> Float[np.ndarray, " user"]:
        """The accelerations [m/s^2] for `dt` [s] at a distance `gap` [m] behind a leader.

        `speed` is their own, `lead` the leader's, `wanted` the one without a leader [m/s].
        """
        plain, found = ~(self.krauss | self.improved), np.zeros(len(speed))
        for mine, model in ((self.krauss, self._krauss), (plain, self._idm), (self.improved, self._improved_idm)):
            if mine.any():
                found = np.where(mine, model(speed, gap, lead, wanted, dt), found)
        return found

    def stopping(
        self,
        speed: Float[np.ndarray, " user"],
        stop: Float[np.ndarray, " user"],
        wanted: Float[np.ndarray, " user"],
        dt: float,
        early: bool = False,
    ) -> Float[np.ndarray, " user"]:
        """The highest accelerations [m/s^2] for `dt` [s] at a distance `stop` [m] before a place where they have to
        stop.

        In Krauss' model such a place differs from a standing leader: it brakes as late as it can. The other models see
        a leader that stands beyond the place. `early` makes the improved model brake like the plain one, and accelerate
        no more.
        """
        late = (self._safe(_STOPPING_S, np.maximum(stop, 0.0), 0.0) - speed) / dt
        if self.krauss.all():
            return late
        stands = speed, stop + self.min_gap, np.zeros_like(speed), wanted, dt
        others = np.minimum(self._idm(*stands), 0.0) if early else self.accelerations(*stands)
        return np.where(self.krauss, late, others)

    def _krauss(
        self, speed: np.ndarray, gap: np.ndarray, lead: np.ndarray, wanted: np.ndarray, dt: float
    ) -> np.ndarray:
        """Accelerate or brake to the highest speed from which one can still stop behind the leader."""
        safe = self._safe(self.tau, np.maximum(gap - self.min_gap, 0.0), lead)
        gained = self.accel * (1.0 - 0.5 * self.sigma)
        return np.minimum(gained, (np.minimum(safe, wanted) - speed) / dt)

    def _safe(self, headway_s: np.ndarray | float, room: np.ndarray, lead: np.ndarray | float) -> np.ndarray:
        """The speed [m/s] from which one stops within `room` [m] and the leader's stopping distance."""
        brakes = self.decel * headway_s
        return np.sqrt(brakes**2 + 2.0 * self.decel * room + lead**2) - brakes

    def _idm(self, speed: np.ndarray, gap: np.ndarray, lead: np.ndarray, wanted: np.ndarray, _: float) -> np.ndarray:
        free = np.maximum(1.0 - (speed / wanted) ** _EXPONENT, -self.decel / self.accel)
        return self.accel * (free - self._near(speed, gap, lead) ** 2)

    def _improved_idm(
        self, speed: np.ndarray, gap: np.ndarray, lead: np.ndarray, wanted: np.ndarray, _: float
    ) -> np.ndarray:
        near = self._near(speed, gap, lead)
        follows = self.accel * (1.0 - near**2)
        slower = np.maximum(1.0 - (speed / wanted) ** _EXPONENT, _LEAST_FREE)
        eased = self.accel * slower * (1.0 - np.minimum(near, 1.0) ** (2.0 / slower))
        share = np.minimum(wanted / np.maximum(speed, _LEAST_M_S), 1.0)
        faster = self.decel * (1.0 - share ** (_EXPONENT * self.accel / self.decel))
        return np.where(
            speed <= wanted, np.where(near >= 1.0, follows, eased), np.where(near >= 1.0, follows, 0.0) - faster
        )

    def _near(self, speed: np.ndarray, gap: np.ndarray, lead: np.ndarray) -> np.ndarray:
        """The wanted gaps, divided by the actual ones."""
        wanted = desired_gap(np, speed, speed - lead, self.tau, self.min_gap, self.accel, self.decel)
        return wanted / np.maximum(gap, LEAST_GAP_M)
