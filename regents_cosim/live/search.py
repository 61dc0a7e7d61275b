"""Plans of one adversary, found again and again while the traffic goes on: a moment in, a plan out. No SUMO here.

The same search as offline, with a short horizon and few iterations. A fresh plan begins with the lawful drives that
meet the ego (`attacks.starts`), of a candidate that is near enough; one that crashes it as wanted in the planner's
closed loop is taken, the best of the others is descended from. A plan that is being carried out is looked at again
from where all vehicles are by now, and descended from where it would miss.
"""

import copy
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from jaxtyping import Array, Bool, Float

from regents_cosim.attacks.actions import to_actions
from regents_cosim.attacks.driving_limits import with_bounds
from regents_cosim.attacks.job import SearchEnd, SearchJob
from regents_cosim.attacks.lawful import LawfulRoad, lawful_road, under_the_law
from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.attacks.rules import candidates
from regents_cosim.attacks.search_state import SearchResult
from regents_cosim.attacks.searched_agents import SearchedAgents
from regents_cosim.attacks.starts import Start, followed, starts
from regents_cosim.collisions import first_contact
from regents_cosim.live.moments import DT_S, FIT_PASSES, Moment
from regents_cosim.live.observed import OBSERVED, Observed
from regents_cosim.live.plan import Plan
from regents_cosim.live.planner_in_loop import PlannerInLoop
from regents_cosim.mirror.bicycle import Controls
from regents_cosim.mirror.compiled import compiled
from regents_cosim.mirror.world import World, to_tracks
from regents_cosim.planners.host_pool import HostPool
from regents_cosim.planners.patience import ACT_TIMEOUT_S
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.scenario import Scenario, Tracks
from regents_cosim.verdicts.ways import ways_ahead

_LOOKED_AT = 8  # candidates whose ways are compared with the ego's at one look; the first that fits is searched
_EARLIEST_S = 1.5  # nearer crashes leave nothing to plan
_GAINED_M_S2 = 2.5  # what a candidate could do to be elsewhere: so much more or less speed ...
_MOST_GAINED_M = 25.0  # ... up to so far
_NEAR_M = 8.0
_BESIDE_M = 0.5  # between two bodies whose ways meet: ways are smoothed when they are driven
_ALONE_M = 1.1  # off its own way, where it can only be driven faster or slower
_ROAD_LASTS_S = 2.0  # that the adversary's road is kept: it reaches as far as it could come in the horizon


class Search:
    """Searches against one planner. A context manager: a planner outside JAX has a process."""

    def __init__(self, planner: AnyPlanner, config: AttackConfig, act_timeout_s: float = ACT_TIMEOUT_S) -> None:
        """Raises PlannerError where there is no such planner."""
        self.config = config
        # Whether a careful driver would see it coming was asked when it began; by now there may be no time left to.
        self._renewing = replace(config, accept="clean") if config.accept == "telling" else config
        given = PlannerUnderTest(OBSERVED, Observed()) if planner == OBSERVED else PlannerUnderTest.of(planner)
        self.planner_name, self.loop, self.hosts = given.name, given.loop, HostPool(given, act_timeout_s)
        self._warm = False  # all programs are compiled
        self._asked: dict[str, float] = {}  # when a candidate was looked at last
        self._road: tuple[str, float, LawfulRoad | None] = "", -np.inf, None  # of which adversary, and since when

    def __deepcopy__(self, memo: dict[int, Any]) -> "Search":
        """One that goes on by itself, against the same planner."""
        other = copy.copy(self)
        other._asked = dict(self._asked)
        return other

    def __enter__(self) -> "Search":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End the planner's process, if any."""
        self.hosts.__exit__()

    def forget(self) -> None:
        """Another run begins: nothing is known of its vehicles."""
        self._asked, self._road = {}, ("", -np.inf, None)

    def fresh(self, moment: Moment, barred: Collection[str] = (), speed_only: bool = False) -> Plan | None:
        """A plan for one of the candidates, None where none leads to the crash that is wanted.

        `barred` are no candidates. With `speed_only` the adversary keeps to its lane. One
        candidate is searched at a look; the others have their turn at the next.
        """
        with self._in_loop(moment) as loop:
            ego = loop.unattacked()
            self._warm_up(loop)
            agent = self._candidate(moment, ego, barred)
            found = None if agent is None else self._starts(loop, agent, ego, speed_only)
            return None if agent is None or found is None else self._plan_from(loop, agent, found)

    def renewed(self, moment: Moment, adversary: str) -> Plan | None:
        """The plan that a moment knows its adversary to follow, changed where it would miss; None if it cannot be."""
        agent = moment.traffic.index(adversary)
        if agent is None:
            return None
        with self._in_loop(moment) as loop:
            job = self._job(loop, agent)
            return self._tried(loop, job, agent, [job.start], self._renewing)

    def _in_loop(self, moment: Moment) -> PlannerInLoop:
        return PlannerInLoop(moment, self.config, self.planner_name, self.loop, self.hosts)

    def _warm_up(self, loop: PlannerInLoop) -> None:
        """Compile all that later plans need, so that none has to wait for it."""
        if self._warm or len(loop.moment.scenario.agents) < 2:
            return
        job, tracks = self._job(loop, 1), loop.moment.scenario.tracks
        onward = Start(tracks.x[1], tracks.y[1], tracks.yaw[1], tracks.speed[1], 0, (0.0, 0.0, 0.0), 0.0)
        if self.config.starts:
            followed(loop.moment.scenario, job, [onward], self.config.starts, FIT_PASSES)
        for config in dict.fromkeys((self.config, self._renewing)):
            loop.search(job, 0, config)
        self._warm = True

    # --- who attacks -----------------------------------------------------------------------------

    def _candidate(self, moment: Moment, ego: Tracks, barred: Collection[str]) -> int | None:
        """One that could be where the ego is soon; first those that were not looked at lately."""
        allowed = np.asarray(_allowed(moment.world, self.config))
        tracks, now = moment.scenario.tracks, moment.traffic.time_s
        ahead_s = np.arange(tracks.steps) * DT_S
        apart = np.hypot(tracks.x - ego.x, tracks.y - ego.y) - np.minimum(
            0.5 * _GAINED_M_S2 * ahead_s**2, _MOST_GAINED_M
        )
        least = np.where(tracks.valid & (ahead_s >= _EARLIEST_S), apart, np.inf).min(axis=1)
        names = [agent.id for agent in moment.scenario.agents]
        able = [k for k in range(1, len(names)) if allowed[k] and names[k] not in barred and least[k] < _NEAR_M]
        self._asked = {name: asked for name, asked in self._asked.items() if name in names}
        for k in sorted(able, key=lambda k: (self._asked.get(names[k], -np.inf), least[k]))[:_LOOKED_AT]:
            self._asked[names[k]] = now
            if not self.config.starts or _ways_meet(moment.scenario, k, ego):
                return k
        return None

    # --- plans -----------------------------------------------------------------------------------

    def _starts(self, loop: PlannerInLoop, agent: int, ego: Tracks, speed_only: bool) -> list[Start] | None:
        """Drives with which a search may begin: no drive where it begins with the prediction, None for no search."""
        if not self.config.starts:
            return None if speed_only else []
        scenario = loop.moment.scenario
        limits = loop.limits[scenario.agents[agent].kind]
        found = starts(scenario, agent, ego, self.config.starts, limits)
        if speed_only:
            found = [start for start in found if _on_own_way(start, scenario, agent)]
        return found or None

    def _plan_from(self, loop: PlannerInLoop, agent: int, found: Sequence[Start]) -> Plan | None:
        job = self._job(loop, agent)
        begun = followed(loop.moment.scenario, job, found, self.config.starts, FIT_PASSES)
        return self._tried(loop, job, agent, begun or [job.start], self.config)

    def _job(self, loop: PlannerInLoop, agent: int) -> SearchJob:
        """A search that moves one agent, and begins with what is predicted of it."""
        moment = loop.moment
        world = moment.with_lanes
        if self.config.law == "strict":
            world = under_the_law(world, moment.scenario, agent, self._road_of(moment, agent))
        world = with_bounds(world, moment.scenario, self.config, loop.limits)
        searched = SearchedAgents.only(agent, len(world.valid))
        return SearchJob(world, loop.memory, searched, searched.rows(to_actions(world.controls)))

    def _road_of(self, moment: Moment, agent: int) -> LawfulRoad | None:
        """Where the agent may drive lawfully; of the vehicle that was asked for last it is known for a while."""
        name, now = moment.scenario.agents[agent].id, moment.traffic.time_s
        known, since, road = self._road
        if name != known or not 0.0 <= now - since <= _ROAD_LASTS_S:
            road = lawful_road(moment.scenario, agent)
            self._road = name, now, road
        return road

    def _tried(
        self, loop: PlannerInLoop, job: SearchJob, agent: int, begun: Sequence[Controls | None], config: AttackConfig
    ) -> Plan | None:
        """The first of some starts that crashes the ego as wanted; else what a short descent makes of the best."""
        best: Controls | None = None
        for rank, controls in enumerate(begun):
            ended = loop.search(job._replace(start=controls), 0, config)
            plan = _plan(loop.moment, agent, ended, rank + 1)
            if plan is not None:
                return plan
            if best is None or (isinstance(ended.found, SearchResult) and bool(ended.found.hit)):
                best = controls
        if not config.iterations or best is None:
            return None
        ended = loop.search(job._replace(start=best), config.iterations, config)
        return _plan(loop.moment, agent, ended, len(begun) + 1)


def _plan(moment: Moment, agent: int, ended: SearchEnd, rollouts: int) -> Plan | None:
    """What a search found, as a plan; None where it is not what is wanted, or the ego meets another vehicle first."""
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
    rows = (np.asarray(values[agent], float) for values in (found.motion.x, found.motion.y, found.motion.yaw))
    x, y, yaw = rows
    return Plan(
        scenario.agents[agent].id, begun, x + moment.origin[0], y + moment.origin[1], yaw,
        np.maximum(np.asarray(found.motion.speed[agent], float), 0.0), begun + contact[1] * DT_S,
        int(found.iterations), rollouts + int(found.iterations),
    )  # fmt: skip


def _ways_meet(scenario: Scenario, agent: int, ego: Tracks) -> bool:
    """Whether a lawful way of an agent, with a change of lane at most, comes onto the ego's."""
    reach_m = 0.5 * (scenario.ego.width + scenario.agents[agent].width) + _BESIDE_M
    own = shapely.LineString(np.stack([ego.x[0], ego.y[0]], axis=1))
    ways = [way.points for way in ways_ahead(scenario, agent) if way.changes <= 1 and len(way.points) > 1]
    ways = ways or [np.stack([scenario.tracks.x[agent], scenario.tracks.y[agent]], axis=1)]
    return bool(shapely.dwithin([shapely.LineString(points) for points in ways], own, reach_m).any())


def _on_own_way(start: Start, scenario: Scenario, agent: int) -> bool:
    """Whether a drive keeps to the line that is predicted of its agent."""
    tracks, upto = scenario.tracks, slice(start.meets + 1)
    own = np.stack([tracks.x[agent], tracks.y[agent]], axis=1)
    mine = np.stack([start.x[upto], start.y[upto]], axis=1)
    along = np.concatenate([own, own[-1] + np.arange(1, 61)[:, None] * _ahead(tracks, agent)])
    return bool(np.linalg.norm(mine[:, None] - along[None], axis=-1).min(axis=1).max() < _ALONE_M)


def _ahead(tracks: Tracks, agent: int) -> Float[np.ndarray, " 2"]:
    yaw = tracks.yaw[agent, -1]
    return np.array([np.cos(yaw), np.sin(yaw)])


@compiled
def _allowed(world: World, config: AttackConfig) -> Bool[Array, " agent"]:
    return candidates(world, config)
