"""Finds plans of one adversary, again and again while the traffic goes on. This module does not depend on SUMO.

It is the offline search with a short horizon. A few candidates that could meet the ego are checked for lawful drives
that do (`attacks.starts.timed_drives`), until one has any; the first of these that crashes the ego as wanted in the
planner's closed loop is the plan. If none does, changes of one of them are sampled in the next step, as offline but
fewer; where a search may not sample, the next search descends from it. Methods without such drives descend from the
prediction. All descents have few iterations. A plan in progress is checked again from the current state of all
vehicles, and descended from where it would miss.
"""

import copy
import itertools
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from regents_cosim.attacks.accept.lawful import LawfulRoad, lawful_road
from regents_cosim.attacks.candidates import may_attack, search_job
from regents_cosim.attacks.descent.search_state import SearchResult
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.job import SearchEnd, SearchJob
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.attacks.starts.timed_drives import Start, followed, starts
from regents_cosim.live.predict.forecast import Forecast
from regents_cosim.live.predict.moments import DT_S, Moment
from regents_cosim.live.predict.traffic import PredictedDrive
from regents_cosim.live.search.plan import Plan
from regents_cosim.live.search.planner_in_loop import PlannerInLoop
from regents_cosim.live.search.reach import could_meet, near_enough
from regents_cosim.mirror.world import to_tracks
from regents_cosim.norms.limits import STANDING_M_S
from regents_cosim.planners.hosting.host_pool import HostPool
from regents_cosim.planners.idm import IDM, IdmMemory
from regents_cosim.planners.jax_planner import CompiledScene
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.scenario.collisions import first_contact
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.verdicts.law.lawful_ways import ways_ahead


# A drive that did not crash the ego as wanted, from which the search continues.
@dataclass(frozen=True, eq=False)
class MissedDrive:
    """The drive, the moment in which it was tried, and its agent."""

    start: Start
    moment: Moment
    agent: int
    may_sample: bool  # whether its changes are sampled in the next step; else the next search descends from it

    @property
    def name(self) -> str:
        """The id of the vehicle."""
        return self.moment.scenario.agents[self.agent].id

    @property
    def plan(self) -> Plan:
        """The drive as a plan."""
        begun, start = self.moment.traffic.time_s, self.start
        drive = start.x, start.y, start.yaw, start.speed
        return Plan(self.name, begun, *drive, meets_s=begun + start.meets * DT_S)


_LOOKED_AT = 12  # candidates compared with the ego's path in one search; the first checks all for drives
_MOST_ASKED = 2  # a later search checks this many of those that could meet the ego, until one has any
_FEW_WAYS = 2  # or until one has more paths than this, since computing drives takes the time
_MOST_LINES = 12  # lines along which a candidate is driven, except in a first search that samples
_EARLIEST_S = 1.5  # earlier crashes leave no time to plan
_GAINED_M_S2 = 2.5  # change of acceleration that a candidate could use to be elsewhere
_MOST_GAINED_M = 25.0  # largest displacement by it
_ALONE_M = 1.1  # from its own path, on which it can only change its speed
_MOST_SAMPLED = 200  # roll-outs of one sampling search, which crashes rarely need
_SAMPLED_BETWEEN = 60  # roll-outs in a step between two searches; each takes 0.6 to 0.8 ms
_ROAD_LASTS_S = 2.0  # time for which the adversary's road is cached; it covers the whole horizon
_NO_ROAD: tuple[str, float, LawfulRoad | None] = "", -np.inf, None  # adversary, time of computation, road


class Search:
    """Searches against one planner; close it, since a planner outside JAX has a process."""

    def __init__(self, planner: AnyPlanner, config: AttackConfig, act_timeout_s: float = ACT_TIMEOUT_S) -> None:
        """Raises PlannerError for an unknown planner."""
        self.config = config
        # Whether a careful driver would react in time was checked at the begin; later there may be no time left.
        self._renewing = config.but(accept="clean") if config.acceptance.accept == "telling" else config
        given = PlannerUnderTest(OBSERVED, Observed()) if planner == OBSERVED else PlannerUnderTest.of(planner)
        self.planner_name, self.loop, self.hosts = given.name, given.loop, HostPool(given, act_timeout_s)
        self._side_by_side = ThreadPoolExecutor(2)
        self._warm = False  # whether all programs are compiled
        self._asked: dict[str, float] = {}  # time of the last check of each candidate
        self._missed: MissedDrive | None = None  # the next search continues with it
        self._road = _NO_ROAD

    def __deepcopy__(self, memo: dict[int, Any]) -> "Search":
        """An independent copy against the same planner."""
        other = copy.copy(self)
        other._asked, other._side_by_side = dict(self._asked), ThreadPoolExecutor(2)
        return other

    def close(self) -> None:
        """End the planner's process, if any, and the threads."""
        self.hosts.__exit__()
        self._side_by_side.shutdown()

    def forget(self) -> None:
        """Forget the vehicles of the last run."""
        self._asked, self._missed, self._road = {}, None, _NO_ROAD

    def prepare(self) -> None:
        """Compute the road of the vehicle that the next search will descend with."""
        if self._missed is not None and self.config.bound:
            self._road_of(self._missed.moment, self._missed.agent)

    def fresh(
        self, moment: Moment, barred: Collection[str] = (), speed_only: bool = False, at_once: bool = False
    ) -> Plan | None:
        """A plan for one of the candidates; None where none leads to the wanted crash.

        `barred` vehicles are not candidates. With `speed_only` the adversary keeps to its lane. The first search checks
        all candidates that could meet the ego, a later one stops at the first with drives. If none of these is a plan,
        their changes are sampled: at once in the first search and with `at_once`, else by `sampled`. A search that may
        not sample descends next time. An ego that will stand all the time is not attacked.
        """
        with self._in_loop(moment) as loop:
            ego = loop.unattacked()
            self._warm_up(loop)
            if ego.speed.max() < STANDING_M_S:
                return None
            missed, self._missed = self._missed, None
            agent = None if missed is None or missed.name in barred else moment.traffic.index(missed.name)
            if missed is not None and agent is not None and not missed.may_sample:
                return self._descended(loop, agent, missed.plan)
            return self._among_candidates(loop, ego, barred, speed_only, at_once)

    def sampled(self) -> tuple[Plan, Moment] | None:
        """A plan from samples around the drive that the last search missed with, in the moment of that search."""
        missed = self._missed
        if missed is None or not missed.may_sample:
            return None
        self._missed = None
        with self._in_loop(missed.moment) as loop:
            plan = self._sampled(loop, missed, _SAMPLED_BETWEEN)
            return None if plan is None else (plan, missed.moment)

    def renewed(self, moment: Moment, adversary: str) -> Plan | None:
        """The plan that the adversary follows now, changed if it would miss; None if it cannot be changed."""
        agent = moment.traffic.index(adversary)
        if agent is None:
            return None
        with self._in_loop(moment) as loop:
            job = self._job(loop, agent, continues=True)
            return self._tried(loop, job, agent, self._renewing)

    def redrawn(self, moment: Moment, adversary: str, speed_only: bool = False) -> Plan | None:
        """Another plan for an adversary whose plan could not be changed: the first of its drives that crashes as
        wanted.
        """
        agent = moment.traffic.index(adversary)
        if agent is None:
            return None
        with self._in_loop(moment) as loop:
            found = self._starts(loop, agent, loop.unattacked(), speed_only)
            return self._plan_from(loop, agent, found) if found else None

    def _in_loop(self, moment: Moment) -> PlannerInLoop:
        return PlannerInLoop(moment, self.config, self.planner_name, self.loop, self.hosts)

    def _warm_up(self, loop: PlannerInLoop) -> None:
        """Compile all programs that later plans need, so that none has to wait."""
        if self._warm or len(loop.moment.scenario.agents) < 2:
            return
        job, tracks = self._job(loop, 1), loop.moment.scenario.tracks
        if self.config.tries.starts:
            onward = _start(np.stack([tracks.x[1], tracks.y[1], tracks.yaw[1], tracks.speed[1]]))
            followed(loop.moment.scenario, job, [onward], self.config.tries.starts)
        loop.search(job, 0, self.config)
        loop.search(self._job(loop, 1, continues=True), 0, self._renewing)
        if loop.samples:
            loop.sampled(job, 1)
        self._warm, self._road = True, _NO_ROAD  # the first run may not depend on it: later ones do not

    # --- who attacks -----------------------------------------------------------------------------

    def _candidates(self, loop: PlannerInLoop, ego: Tracks, barred: Collection[str]) -> Iterator[int]:
        """The agents that could soon be where the ego is; those not checked lately come first."""
        scenario, now = loop.moment.scenario, loop.moment.traffic.time_s
        names = [agent.id for agent in scenario.agents]
        able = np.asarray(may_attack(loop.moment.world, self.config))[: len(names)]
        able = able & near_enough(scenario, ego, _EARLIEST_S, loop.limits)
        others = [k for k in np.flatnonzero(able).tolist() if names[k] not in barred]
        least = _least_apart(scenario, ego)
        self._asked = {name: asked for name, asked in self._asked.items() if name in names}
        for k in sorted(others, key=lambda k: (self._asked.get(names[k], -np.inf), least[k]))[:_LOOKED_AT]:
            self._asked[names[k]] = now
            kind = scenario.agents[k].kind
            if not self.config.tries.starts or could_meet(scenario, k, ego, _EARLIEST_S, loop.limits[kind]):
                yield k

    def _takes_long(self, loop: PlannerInLoop, agent: int) -> bool:
        """Whether checking this agent takes the time of a whole search."""
        return len(ways_ahead(loop.moment.scenario, agent)) > _FEW_WAYS

    # --- plans -----------------------------------------------------------------------------------

    def _among_candidates(
        self, loop: PlannerInLoop, ego: Tracks, barred: Collection[str], speed_only: bool, at_once: bool
    ) -> Plan | None:
        """The first drive of a candidate that crashes as wanted, else the best of samples around the others."""
        is_first = not self._asked  # nothing is known yet of the vehicles around this ego
        most = 1 if not self.config.tries.starts else _LOOKED_AT if is_first else _MOST_ASKED
        may_sample = loop.samples and not speed_only  # samples change the steering
        missing = list[MissedDrive]()
        for agent in itertools.islice(self._candidates(loop, ego, barred), most):
            found = self._starts(loop, agent, ego, speed_only, None if is_first and loop.samples else _MOST_LINES)
            plan = None if found is None else self._plan_from(loop, agent, found)
            if plan is not None:
                return plan
            if found:
                missing.append(MissedDrive(found[0], loop.moment, agent, may_sample))
            if not is_first and (found or self._takes_long(loop, agent)):
                break
        if (is_first or at_once) and may_sample:
            plans = (self._sampled(loop, missed, _MOST_SAMPLED) for missed in missing)
            return next((plan for plan in plans if plan is not None), None)
        self._missed = missing[0] if missing else None
        return None

    def _starts(
        self, loop: PlannerInLoop, agent: int, ego: Tracks, speed_only: bool, most_lines: int | None = _MOST_LINES
    ) -> list[Start] | None:
        """Drives from which a search may begin; empty where it begins with the prediction, None where it is not
        searched.
        """
        if not self.config.tries.starts:
            return None if speed_only else []
        scenario = loop.moment.scenario
        limits = loop.limits[scenario.agents[agent].kind]
        found = starts(scenario, agent, ego, self.config.tries.starts, limits, most_lines=most_lines)
        if speed_only:
            found = [start for start in found if _on_own_way(start, scenario, agent)]
        return found or None

    def _plan_from(self, loop: PlannerInLoop, agent: int, found: Sequence[Start]) -> Plan | None:
        """The first of the starts that crashes the ego as wanted; without starts the result of a short descent."""
        if not found:
            return self._tried(loop, self._job(loop, agent), agent, self.config)
        job = self._job(loop, agent, everywhere=True)
        begun = followed(loop.moment.scenario, job, found, self.config.tries.starts)
        for rank in loop.wanted(job, begun, self.config):
            # The lawful road takes time to compute, so it is done only for these few.
            job = self._job(loop, agent)._replace(start=begun[rank])
            plan = _plan(loop.moment, agent, loop.search(job, 0, self.config), rank + 2)
            if plan is not None:
                return plan
        return None

    def _sampled(self, loop: PlannerInLoop, missed: MissedDrive, most: int) -> Plan | None:
        """The best of samples around a drive that missed, and around the prediction.

        Both are searched in parallel, each with at most `most` roll-outs, since one alone uses one core.
        """
        job, moment = self._job(loop, missed.agent), loop.moment
        begun = (*followed(moment.scenario, job, [missed.start], self.config.tries.starts), job.start)
        ends = self._side_by_side.map(lambda start: loop.sampled(job._replace(start=start), most), begun)
        plans = (_plan(moment, missed.agent, ended, 2) for ended in ends)
        return next((plan for plan in plans if plan is not None), None)

    def _descended(self, loop: PlannerInLoop, agent: int, missed: Plan) -> Plan | None:
        """The result of a short descent from the drive that missed in the search before."""
        if not self.config.steps.iterations:
            return None
        job, moment = self._job(loop, agent), loop.moment
        rest = missed.rest(moment.traffic.time_s, moment.scenario.tracks.steps)
        (begun,) = followed(moment.scenario, job, [_start(rest)], self.config.tries.starts)
        end = loop.search(job._replace(start=begun), self.config.steps.iterations, self.config)
        return _plan(moment, agent, end, 2)

    def _job(self, loop: PlannerInLoop, agent: int, everywhere: bool = False, continues: bool = False) -> SearchJob:
        """A search that moves one agent, beginning with its prediction; `everywhere` makes the whole plane its road.

        `continues` means that the agent is attacking already.
        """
        moment = loop.moment
        road = None if everywhere or not self.config.bound else self._road_of(moment, agent)
        searched = SearchedAgents.only(agent, len(loop.world.valid), continues)
        return search_job(self.config, moment.scenario, loop.world, loop.memory, searched, road)

    def _road_of(self, moment: Moment, agent: int) -> LawfulRoad | None:
        """The area where the agent may drive lawfully; the last one is cached for a while."""
        name, now = moment.scenario.agents[agent].id, moment.traffic.time_s
        known, since, road = self._road
        if name != known or not 0.0 <= now - since <= _ROAD_LASTS_S:
            road = lawful_road(moment.scenario, agent)
            self._road = name, now, road
        return road

    def _tried(self, loop: PlannerInLoop, job: SearchJob, agent: int, config: AttackConfig) -> Plan | None:
        """The job's initial drive if it crashes the ego as wanted, else the result of a short descent."""
        plan = _plan(loop.moment, agent, loop.search(job, 0, config), 1)
        if plan is not None or not config.steps.iterations:
            return plan
        return _plan(loop.moment, agent, loop.search(job, config.steps.iterations, config), 2)


def _plan(moment: Moment, agent: int, ended: SearchEnd, rollouts: int) -> Plan | None:
    """The result of a search as a plan; None if it is not as wanted, or the ego meets another vehicle first."""
    found = ended.found
    assert isinstance(found, SearchResult)
    if not bool(found.accepted) or not bool(found.finite):
        return None
    scenario = moment.scenario
    tracks = to_tracks(found.motion, found.controls, scenario)
    contact = first_contact(scenario.agents, tracks)
    if contact is None or contact[0] != agent:
        return None
    begun = moment.traffic.time_s
    x, y, yaw, speed = (np.asarray(values[agent], float) for values in jax.tree.leaves(found.motion))
    return Plan(
        scenario.agents[agent].id, begun, x + moment.origin[0], y + moment.origin[1], yaw, np.maximum(speed, 0.0),
        begun + contact[1] * DT_S, int(found.iterations), rollouts + int(found.iterations),
        Forecast(begun, DT_S, tuple(one.id for one in scenario.agents), tracks),
    )  # fmt: skip


def _start(drive: PredictedDrive) -> Start:
    """A drive as a start of a search; its time of contact is not used."""
    return Start(*drive, meets=0, contact=(0.0, 0.0, 0.0), promise=0.0)


def _least_apart(scenario: Scenario, ego: Tracks) -> Float[np.ndarray, " agent"]:
    """The least distance [m] of each agent to the ego [1, time] as predicted, minus what it could gain."""
    tracks, ahead_s = scenario.tracks, np.arange(ego.steps) * DT_S
    gained = np.minimum(0.5 * _GAINED_M_S2 * ahead_s**2, _MOST_GAINED_M)
    apart = np.hypot(tracks.x - ego.x, tracks.y - ego.y) - gained
    return np.where(tracks.valid & (ahead_s >= _EARLIEST_S), apart, np.inf).min(axis=1)


def _on_own_way(start: Start, scenario: Scenario, agent: int) -> bool:
    """Whether a drive keeps to the predicted line of its agent."""
    tracks, upto = scenario.tracks, slice(start.meets + 1)
    own = np.stack([tracks.x[agent], tracks.y[agent]], axis=1)
    mine = np.stack([start.x[upto], start.y[upto]], axis=1)
    yaw = tracks.yaw[agent, -1]
    along = np.concatenate([own, own[-1] + np.arange(1, 61)[:, None] * [np.cos(yaw), np.sin(yaw)]])
    return bool(np.linalg.norm(mine[:, None] - along[None], axis=-1).min(axis=1).max() < _ALONE_M)


OBSERVED = "observed"
LEAST_OBSERVED_M_S = 2.0  # a standing ego is assumed to start


class Observed(IDM):
    """IDM with the ego's recent speed as wanted speed, which is also the predicted one."""

    def init(self, scene: CompiledScene) -> IdmMemory:
        """The memory with the ego's route and its recent speed."""
        memory = super().init(scene)
        recent = max(float(scene.scenario.tracks.speed[0].max()), LEAST_OBSERVED_M_S)
        return eqx.tree_at(lambda m: m.speed, memory, jnp.minimum(memory.speed, recent))
