"""Keeps the adversary from touching vehicles other than the ego: detects such contacts, and brakes.

The others are predicted in two ways. First as when the plan was made, so that a leader that is about to start or a
vehicle that is about to turn is not an obstacle. Second along their paths at their current speed; by this one the
adversary brakes in the last step in which braking still helps.
"""

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.geometry.lines import distances_along, way_at
from regents_cosim.live.host.interface import Frame
from regents_cosim.live.predict.forecast import Forecast
from regents_cosim.live.predict.moments import DT_S
from regents_cosim.live.search.plan import Plan

_FORESEEN_S = 0.8  # time for which the plan's prediction counts
_BRAKING_M_S2 = 7.0
_STOPPED_S = 0.3  # after a stop
_SPACING_S = 0.1
_APART_M = 0.02  # by which its box is enlarged, for rounding errors
_NEAR_M = 40.0  # around the braking path, where others matter


def would_touch_others(frame: Frame, plan: Plan, step_s: float) -> bool:
    """Whether the adversary has to brake now to avoid touching a vehicle other than the ego.

    False where they touch already in SUMO.
    """
    own = frame.number[plan.adversary]
    near_m = _NEAR_M + frame.speed[own] ** 2 / (2.0 * _BRAKING_M_S2)
    others = np.hypot(frame.x - frame.x[own], frame.y - frame.y[own]) < near_m
    others[[0, own]] = False
    rows = np.flatnonzero(others)
    if not len(rows) or np.any(overlap(frame.boxes.at(own), frame.boxes.at(rows))):
        return False
    kind, now = frame.types[own], frame.time_s

    def touches(driven: Plan, ahead_s: Float[np.ndarray, " time"], there: Boxes) -> Bool[np.ndarray, " time"]:
        x, y, yaw, _ = driven.at_times(now + ahead_s)
        mine = Boxes(x, y, yaw, kind.length + _APART_M, kind.width + _APART_M, frame.z[own])
        return np.any(overlap(mine, there), axis=0)

    soon = _instants(step_s, _FORESEEN_S)
    if touches(plan, soon, _moved(frame, rows, soon, plan.foreseen)).any():
        return True
    braked = _instants(step_s, step_s + plan.at(now)[3] / _BRAKING_M_S2 + _STOPPED_S)
    there = _moved(frame, rows, braked, plan.foreseen, at_their_speed=True)
    onward = touches(plan, braked, there)
    if onward[0] or not onward.any():
        return bool(onward[0])
    later = touches(braking(plan, now + step_s), braked, there)
    return bool(later.any()) and not touches(braking(plan, now), braked, there).any()


def braking(plan: Plan, now_s: float) -> Plan:
    """The plan with braking to a stop from `now_s` on."""
    since = np.arange(len(plan.x)) * DT_S
    slower = np.maximum(plan.at(now_s)[3] - _BRAKING_M_S2 * since, 0.0)
    way = way_at(slower, DT_S)
    ahead = plan.rest(now_s, len(plan.x))
    driven = distances_along(*ahead[:2])
    x, y, yaw = (np.interp(way, driven, values) for values in ahead[:3])
    return Plan(plan.adversary, now_s, x, y, yaw, slower, np.inf)


def _instants(step_s: float, last_s: float) -> Float[np.ndarray, " time"]:
    """Instants from the next step to `last_s`, at least one."""
    return np.arange(step_s, max(last_s, step_s) + 0.5 * _SPACING_S, _SPACING_S)


def _moved(
    frame: Frame, rows: np.ndarray, ahead_s: np.ndarray, foreseen: Forecast | None, at_their_speed: bool = False
) -> Boxes:
    """The boxes of some vehicles [row time], moved from their current pose as predicted.

    With `at_their_speed` they keep their current speed along the predicted paths. Without a prediction they go straight
    on.
    """
    boxes, now = frame.boxes.at(rows[:, None]), frame.time_s
    straight_m = frame.speed[rows, None] * ahead_s
    x, y = boxes.x + straight_m * np.cos(boxes.yaw), boxes.y + straight_m * np.sin(boxes.yaw)
    moved = {"x": x, "y": y, "yaw": boxes.yaw + np.zeros_like(straight_m)}
    since_s = np.concatenate([[0.0], ahead_s])
    for k, row in enumerate(rows):
        name = frame.ids[row]
        if foreseen is None or not foreseen.there(name, now if at_their_speed else now + ahead_s[-1]):
            continue
        way = (
            foreseen.along(name, now, frame.speed[row] * since_s)
            if at_their_speed
            else foreseen.at(name, now + since_s)
        )
        for key, values in moved.items():
            values[k] = getattr(frame, key)[row] + way[key][1:] - way[key][0]
    return boxes._replace(**moved)
