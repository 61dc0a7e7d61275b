"""The adversary touches no vehicle but the ego: whether it soon would, and how it stops instead."""

import numpy as np

from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.live.frame import Frame
from regents_cosim.live.moments import DT_S
from regents_cosim.live.plan import Plan

_CHECKED_S = (0.4, 0.8)  # ahead, beside the next step
_BRAKING_M_S2 = 7.0
_NEAR_M = 40.0


def would_touch_others(frame: Frame, plan: Plan, step_s: float) -> bool:
    """Whether the adversary soon touches a vehicle but the ego, if that goes straight on.

    False where they touch already, as SUMO has them.
    """
    boxes, own = frame.boxes, frame.number[plan.adversary]
    others = np.hypot(frame.x - frame.x[own], frame.y - frame.y[own]) < _NEAR_M
    others[[0, own]] = False
    kept = Boxes(*(np.broadcast_to(values, others.shape)[others] for values in boxes))
    mine, kind = Boxes(*(np.asarray(values)[own] for values in boxes)), frame.types[own]
    if not others.any() or np.any(overlap(mine, kept)):
        return False
    for ahead_s in (step_s, *_CHECKED_S):
        x, y, yaw, _ = plan.at(frame.time_s + ahead_s)
        way_m = frame.speed[others] * ahead_s
        there = kept._replace(x=kept.x + way_m * np.cos(kept.yaw), y=kept.y + way_m * np.sin(kept.yaw))
        if np.any(overlap(Boxes(x, y, yaw, kind.length, kind.width, frame.z[own]), there)):
            return True
    return False


def braking(plan: Plan, now_s: float) -> Plan:
    """Along a plan, but braking to a stop."""
    since = np.arange(len(plan.x)) * DT_S
    slower = np.maximum(plan.at(now_s)[3] - _BRAKING_M_S2 * since, 0.0)
    way = np.concatenate([[0.0], np.cumsum(0.5 * (slower[1:] + slower[:-1]) * DT_S)])
    ahead = np.array([plan.at(now_s + step * DT_S) for step in range(len(plan.x))])
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(ahead[:, :2], axis=0).T))])
    x, y, yaw = (np.interp(way, driven, ahead[:, k]) for k in range(3))
    return Plan(plan.adversary, now_s, x, y, yaw, slower, np.inf)
