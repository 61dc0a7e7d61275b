"""How the adversary moves before and after the attack."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from regents_cosim.scenario import Scenario, Tracks

_LATE = 95.0  # percentile


@dataclass(frozen=True)
class MotionRow:
    """One quantity of the adversary's motion: 95th percentile and maximum of its magnitude."""

    quantity: str
    unit: str
    before: tuple[float, float]
    after: tuple[float, float]


def motion_sheet(scenario: Scenario) -> list[MotionRow]:
    """The adversary's speed, accelerations, jerk and yaw rate up to the crash; nothing without an adversary."""
    agent = next((i for i, a in enumerate(scenario.agents) if a.role == "adversary"), None)
    if agent is None or scenario.original is None:
        return []
    hit = scenario.attack.collision if scenario.attack else None
    end = hit.step + 1 if hit else scenario.tracks.steps
    before = _quantities(scenario.original, agent, end, scenario.dt)
    after = _quantities(scenario.tracks, agent, end, scenario.dt)
    return [MotionRow(name, unit, _late(before[name, unit]), _late(after[name, unit])) for name, unit in before]


def _quantities(tracks: Tracks, agent: int, end: int, dt: float) -> dict[tuple[str, str], Float[np.ndarray, " time"]]:
    """Finite differences between the steps at which the agent is there."""
    valid = tracks.valid[agent, :end]
    speed, yaw = (np.where(valid, values[agent, :end], np.nan) for values in (tracks.speed, tracks.yaw))
    accel = np.diff(speed) / dt
    turn = np.diff(yaw)
    yaw_rate = np.arctan2(np.sin(turn), np.cos(turn)) / dt
    return {
        ("Speed", "m/s"): speed,
        ("Acceleration", "m/s²"): np.maximum(accel, 0.0),
        ("Braking", "m/s²"): np.maximum(-accel, 0.0),
        ("Lateral acceleration", "m/s²"): np.abs(0.5 * (speed[1:] + speed[:-1]) * yaw_rate),
        ("Jerk", "m/s³"): np.abs(np.diff(accel) / dt),
        ("Yaw rate", "rad/s"): np.abs(yaw_rate),
    }


def _late(values: Float[np.ndarray, " time"]) -> tuple[float, float]:
    there = values[np.isfinite(values)]
    if not len(there):
        return 0.0, 0.0
    return round(float(np.percentile(there, _LATE)), 2), round(float(there.max()), 2)
