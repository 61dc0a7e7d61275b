"""The plan of an adversary."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from regents_cosim.errors import RegentsError
from regents_cosim.live.predict.forecast import Forecast
from regents_cosim.live.predict.moments import DT_S
from regents_cosim.live.predict.traffic import PredictedDrive
from regents_cosim.scenario.scenario import Scenario


@dataclass(frozen=True, eq=False)
class Plan:
    """The motion of one adversary from a time on: box centres in the map's frame, every `DT_S`."""

    adversary: str
    begun_s: float
    x: Float[np.ndarray, " time"]  # [m]
    y: Float[np.ndarray, " time"]  # [m]
    yaw: Float[np.ndarray, " time"]  # [rad] continuous
    speed: Float[np.ndarray, " time"]  # [m/s]
    meets_s: float  # [s] time of the planned contact with the ego
    iterations: int = 0
    rollouts: int = 1
    foreseen: Forecast | None = None  # the predicted motion of all others, if known

    def at(self, time_s: float) -> tuple[float, float, float, float]:
        """X, y [m], yaw [rad] and speed [m/s] at a time; straight on after its end."""
        x, y, yaw, speed = self.at_times(np.array([time_s]))[:, 0].tolist()
        return x, y, yaw, speed

    def at_times(self, times_s: Float[np.ndarray, " time"]) -> PredictedDrive:
        """The states at several times, as in `at`."""
        since = times_s - self.begun_s
        own = np.arange(len(self.x)) * DT_S
        x, y, yaw, speed = (np.interp(since, own, values) for values in (self.x, self.y, self.yaw, self.speed))
        beyond = np.maximum(since - own[-1], 0.0) * speed
        return np.stack([x + beyond * np.cos(yaw), y + beyond * np.sin(yaw), yaw, speed])

    def rest(self, time_s: float, steps: int) -> PredictedDrive:
        """The rest of the plan from a time on, as `steps` instants."""
        return self.at_times(time_s + np.arange(steps) * DT_S)


def plan_of_case(case: Scenario, begun_s: float) -> Plan:
    """The plan of the adversary in a case, whose first step is at `begun_s` [s] of the simulation.

    Raises RegentsError for a case without a crash.
    """
    hit = case.collision
    if hit is None:
        raise RegentsError(f"case {case.id}: no crash, expected one whose adversary can be followed")
    row = case.index(hit.agent)
    tracks, there = case.tracks, np.flatnonzero(case.tracks.valid[row])
    at = np.arange(round((there[-1] - there[0]) * case.dt / DT_S) + 1) * DT_S
    own = slice(there[0], there[-1] + 1)
    rows = tracks.x[row, own], tracks.y[row, own], np.unwrap(tracks.yaw[row, own]), tracks.speed[row, own]
    x, y, yaw, speed = (np.interp(at, np.arange(len(one)) * case.dt, one) for one in rows)
    begun = begun_s + there[0] * case.dt
    return Plan(hit.agent, begun, x, y, yaw, speed, begun_s + hit.time_s)
