"""Makes plans from frames: the first plan of an attack, its changes, and the return to the lane."""

import dataclasses
from collections.abc import Collection

import numpy as np

from regents_cosim.live.host.interface import Frame, History, Host
from regents_cosim.live.predict.forecast import Forecast
from regents_cosim.live.predict.moments import DT_S, MOST_AGENTS, Moments
from regents_cosim.live.predict.traffic import TrafficState
from regents_cosim.live.search.plan import Plan
from regents_cosim.live.search.plans import LEAST_OBSERVED_M_S, OBSERVED, Search


class Replanner:
    """Makes plans against one ego in one simulation."""

    def __init__(self, host: Host, search: Search, moments: Moments, history: History) -> None:
        self._host, self._search, self._moments, self._history = host, search, moments, history

    def prepare(self, frame: Frame) -> None:
        """Prepare data for the next plan, in a step without one."""
        self._moments.prepare(self._host.road, float(frame.x[0]), float(frame.y[0]))
        self._search.prepare()

    def fresh(self, frame: Frame, barred: Collection[str], at_once: bool = False) -> tuple[Plan, Forecast] | None:
        """A plan for a vehicle that is not barred, and the prediction without the attack; None where none is found.

        Unless `at_once`, the sampling that belongs to the search is done by `sampled` in the next step.
        """
        moment = self._moments.of(self._traffic(frame))
        plan = self._search.fresh(moment, barred, self._host.speed_only, at_once)
        return None if plan is None else (plan, moment.forecast)

    def sampled(self) -> tuple[Plan, Forecast] | None:
        """A plan, as by `fresh`, from samples around the drive that the last search missed with."""
        found = self._search.sampled()
        return None if found is None else (found[0], found[1].forecast)

    def renewed(self, frame: Frame, plan: Plan) -> Plan | None:
        """The plan, changed if it would miss; None if it cannot be changed."""
        known = {plan.adversary: plan.rest(frame.time_s, self._moments.steps)}
        return self._search.renewed(self._moments.of(self._traffic(frame), known), plan.adversary)

    def redrawn(self, frame: Frame, adversary: str) -> Plan | None:
        """Another plan for a vehicle whose plan could not be changed; None where there is none."""
        if not self._search.config.tries.starts:  # without other drives the prediction would be useless
            return None
        return self._search.redrawn(self._moments.of(self._traffic(frame)), adversary, self._host.speed_only)

    def homeward(self, frame: Frame, name: str) -> Plan | None:
        """A drive of a vehicle back to the middle of its lane, behind its leader."""
        traffic = self._traffic(frame)
        index = traffic.index(name)
        if index is None:
            return None
        tracks = self._moments.predictor.predict(traffic, DT_S, self._moments.steps)
        there = int(tracks.valid[index].sum())
        if there < 2:
            return None
        x, y, yaw, speed = (v[index, :there] for v in (tracks.x, tracks.y, tracks.yaw, tracks.speed))
        return Plan(name, frame.time_s, x, y, np.unwrap(yaw), speed, meets_s=np.inf)

    def forecast(self, frame: Frame, plan: Plan | None = None, seconds: float | None = None) -> Forecast:
        """The predicted motion of all, for `seconds` or as long as plans last; the adversary follows its `plan`."""
        traffic, steps = self._traffic(frame), self._moments.steps if seconds is None else round(seconds / DT_S) + 1
        known = {} if plan is None else {plan.adversary: plan.rest(frame.time_s, steps)}
        ids = tuple(user.agent.id for user in traffic.users)
        return Forecast(frame.time_s, DT_S, ids, self._moments.foreseen(traffic, steps, known))

    def _traffic(self, frame: Frame) -> TrafficState:
        """The traffic around; an ego that is only observed keeps its recent speed, whatever it does now."""
        traffic = self._host.traffic(frame, MOST_AGENTS, self._moments.horizon_s)
        if self._search.planner_name != OBSERVED:
            return traffic
        ego = traffic.ego
        recent = max(self._history.recent_m_s(), LEAST_OBSERVED_M_S)
        most = min(recent / max(ego.following.speed_factor, 0.01), ego.following.max_speed_m_s)
        slow = dataclasses.replace(ego.following, max_speed_m_s=most)
        kept = dataclasses.replace(ego, following=slow, accel=np.nan)
        return dataclasses.replace(traffic, users=(kept, *traffic.users[1:]))
