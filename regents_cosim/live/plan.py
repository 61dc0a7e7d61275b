"""Plans of one adversary, found again and again while the traffic goes on: a moment in, a plan out. No SUMO here.

The same search as offline, with a short horizon and few iterations. A fresh plan begins with the lawful drives that
meet the ego (`attacks.starts`), of the candidates that are near enough; one that crashes it as wanted in the planner's
closed loop is taken, the best of the others is descended from. A plan that is being carried out is looked at again
from where everybody is by now, and descended from where it would miss.
"""

from collections.abc import Collection, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from regents_cosim.attacks.actions import to_actions
from regents_cosim.attacks.driving_limits import limits_by_kind, with_bounds
from regents_cosim.attacks.job import SearchEnd, SearchJob
from regents_cosim.attacks.lawful import under_the_law
from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.attacks.pursuit import DriveRequest, RunClosedLoops, in_compiled_loop, in_process, pursue
from regents_cosim.attacks.replanned import BackgroundTraffic
from regents_cosim.attacks.rules import candidates
from regents_cosim.attacks.search import descend
from regents_cosim.attacks.search_state import SearchResult
from regents_cosim.attacks.searched_agents import SearchedAgents
from regents_cosim.attacks.starts import Start, followed, starts
from regents_cosim.collisions import first_contact
from regents_cosim.errors import DriveError
from regents_cosim.live.moments import CELLS, DT_S, Drive, Moment
from regents_cosim.live.observed import OBSERVED, Observed
from regents_cosim.mirror.bicycle import Controls
from regents_cosim.mirror.compiled import compiled
from regents_cosim.mirror.rollout import with_ego
from regents_cosim.mirror.world import World, to_tracks
from regents_cosim.planners.host_pool import HostPool
from regents_cosim.planners.patience import ACT_TIMEOUT_S
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.scenario import Scenario, Tracks

_ASKED = 2  # candidates that are searched at one moment
_EARLIEST_S = 1.5  # nearer crashes leave nothing to plan
_GAINED_M_S2 = 2.5  # what a candidate could do to be elsewhere: so much more or less speed ...
_MOST_GAINED_M = 25.0  # ... up to so far
_NEAR_M = 8.0
_ALONE_M = 0.6  # off its own way, where it can only be driven faster or slower


@dataclass(frozen=True, eq=False)
class Plan:
    """What one adversary does from a time on: box centres in the map's frame, every `DT_S`."""

    adversary: str
    begun_s: float
    x: Float[np.ndarray, " time"]  # [m]
    y: Float[np.ndarray, " time"]  # [m]
    yaw: Float[np.ndarray, " time"]  # [rad] continuous
    speed: Float[np.ndarray, " time"]  # [m/s]
    meets_s: float  # when it would meet the ego
    iterations: int = 0
    rollouts: int = 1

    def at(self, time_s: float) -> tuple[float, float, float, float]:
        """X, y [m], yaw [rad] and speed [m/s] at a time; straight on after its end."""
        since = time_s - self.begun_s
        own = np.arange(len(self.x)) * DT_S
        x, y, yaw, speed = (float(np.interp(since, own, v)) for v in (self.x, self.y, self.yaw, self.speed))
        beyond = max(since - own[-1], 0.0) * speed
        return x + beyond * float(np.cos(yaw)), y + beyond * float(np.sin(yaw)), yaw, speed

    def rest(self, time_s: float, steps: int) -> Drive:
        """What is left of it from a time on, as long as `steps` instants."""
        return np.array([self.at(time_s + step * DT_S) for step in range(steps)]).T


class Search:
    """Searches against one planner. A context manager: a planner outside JAX has a process."""

    def __init__(self, planner: AnyPlanner, config: AttackConfig, act_timeout_s: float = ACT_TIMEOUT_S) -> None:
        """Raises PlannerError where there is no such planner."""
        self.config = config
        given = PlannerUnderTest(OBSERVED, Observed()) if planner == OBSERVED else PlannerUnderTest.of(planner)
        self.planner_name, self.loop, self.hosts = given.name, given.loop, HostPool(given, act_timeout_s)
        self._asked: dict[str, float] = {}  # when a candidate was searched last

    def __enter__(self) -> "Search":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End the planner's process, if any."""
        self.hosts.__exit__()

    def fresh(self, moment: Moment, barred: Collection[str] = (), alone: bool = False) -> Plan | None:
        """A plan for one of the candidates, None where none leads to the crash that is wanted.

        `barred` are no candidates. `alone` is for simulations that drive the adversary along its own lane.
        """
        with _Wheel(self, moment) as wheel:
            ego = wheel.unattacked()
            for agent in self._candidates(moment, ego, barred):
                plan = self._plan_for(moment, wheel, agent, ego, alone)
                if plan is not None:
                    return plan
        return None

    def renewed(self, moment: Moment, adversary: str) -> Plan | None:
        """The plan that a moment knows its adversary to follow, changed where it would miss; None where it cannot be.

        Whether a careful driver would see it coming was asked when it began; by now there may be no time left to.
        """
        agent = moment.traffic.index(adversary)
        if agent is None:
            return None
        with _Wheel(self, moment) as wheel:
            job = self._job(moment, wheel, agent)
            return self._tried(moment, wheel, job, agent, [job.start], replace(self.config, accept="clean"))

    def _candidates(self, moment: Moment, ego: Tracks, barred: Collection[str]) -> list[int]:
        """Those that could be where the ego is soon, who were not asked lately first."""
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
        chosen = sorted(able, key=lambda k: (self._asked.get(names[k], -np.inf), least[k]))[:_ASKED]
        self._asked |= {names[k]: now for k in chosen}
        return chosen

    def _plan_for(self, moment: Moment, wheel: "_Wheel", agent: int, ego: Tracks, alone: bool) -> Plan | None:
        limits = limits_by_kind(moment.scenario, self.config)[moment.scenario.agents[agent].kind]
        found = starts(moment.scenario, agent, ego, self.config.starts, limits) if self.config.starts else []
        if alone:
            found = [start for start in found if _on_own_way(start, moment.scenario, agent)]
        if not found and (self.config.starts or alone):
            return None
        job = self._job(moment, wheel, agent)
        begun = followed(moment.scenario, job, found, self.config.starts) if found else []
        return self._tried(moment, wheel, job, agent, begun or [job.start], self.config)

    def _job(self, moment: Moment, wheel: "_Wheel", agent: int) -> SearchJob:
        """A search that moves one agent, and begins with what is predicted of it."""
        lawful = self.config.law == "strict"
        world = under_the_law(moment.with_lanes, moment.scenario, agent, CELLS) if lawful else moment.with_lanes
        world = with_bounds(world, moment.scenario, self.config, limits_by_kind(moment.scenario, self.config))
        searched = SearchedAgents.only(agent, len(world.valid))
        return SearchJob(world, wheel.memory, searched, searched.rows(to_actions(world.controls)))

    def _tried(
        self,
        moment: Moment,
        wheel: "_Wheel",
        job: SearchJob,
        agent: int,
        begun: Sequence[Controls | None],
        config: AttackConfig,
    ) -> Plan | None:
        """The first of some starts that crashes the ego as wanted; else what a short descent makes of the best."""
        best: Controls | None = None
        for rank, controls in enumerate(begun):
            ended = wheel.search(job._replace(start=controls), 0, config)
            plan = _plan(moment, job, agent, ended, config, rank + 1)
            if plan is not None:
                return plan
            if best is None or (isinstance(ended.found, SearchResult) and bool(ended.found.hit)):
                best = controls
        if not config.iterations or best is None:
            return None
        ended = wheel.search(job._replace(start=best), config.iterations, config)
        return _plan(moment, job, agent, ended, config, len(begun) + 1)


class _Wheel:
    """The planner at one moment: closed loops, and searches against it."""

    def __init__(self, search: Search, moment: Moment) -> None:
        self._search, self._moment = search, moment
        self.memory: Any = None
        self._lent = ExitStack()

    def __enter__(self) -> "_Wheel":
        loop, name = self._search.loop, self._search.planner_name
        if loop is not None:
            self.memory = self._moment.memory(loop, name)
            self._drives: RunClosedLoops = in_compiled_loop(loop, name)
        else:
            self._drives = in_process(self._lent.enter_context(self._search.hosts.lend()))
        return self

    def __exit__(self, *error: object) -> None:
        self._lent.close()

    def unattacked(self) -> Tracks:
        """Where the ego goes [1, time] if nobody attacks it. Raises DriveError."""
        moment, world = self._moment, self._moment.world
        job = SearchJob(world, self.memory, SearchedAgents.only(0, len(world.valid)))
        reacting = world.vehicle if self._search.config.background == "reactive" else None
        (driven,) = self._drives([DriveRequest(moment.scenario, job, BackgroundTraffic(moment.background, reacting))])
        if isinstance(driven, DriveError):
            raise driven
        return to_tracks(with_ego(moment.background, driven.ego.motion), world.controls, moment.scenario)

    def search(self, job: SearchJob, iterations: int, config: AttackConfig) -> SearchEnd:
        """A search of so many iterations at most. Raises DriveError."""
        loop = self._search.loop
        if loop is not None:
            found = descend(
                job.world, loop, job.memory, config.compiled(), job.searched, jnp.int32(iterations), job.start
            )
            return SearchEnd(jax.block_until_ready(found))
        (ended,) = pursue([(self._moment.scenario, job)], config, max(iterations, 1), self._drives, iterations)
        if isinstance(ended.found, DriveError):
            raise ended.found
        return ended


def _plan(
    moment: Moment, job: SearchJob, agent: int, ended: SearchEnd, config: AttackConfig, rollouts: int
) -> Plan | None:
    """What a search found, as a plan; None where it is not what is wanted, or the ego meets somebody else first."""
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


def _on_own_way(start: Start, scenario: Scenario, agent: int) -> bool:
    """Whether a drive keeps to the line that is predicted of its agent."""
    tracks, upto = scenario.tracks, slice(start.meets + 1)
    own = np.stack([tracks.x[agent], tracks.y[agent]], axis=1)
    mine = np.stack([start.x[upto], start.y[upto]], axis=1)
    along = np.concatenate([own, own[-1] + np.arange(1, 61)[:, None] * _ahead(tracks, agent)])
    return bool(np.linalg.norm(mine[:, None] - along[None], axis=-1).min(axis=1).max() < _ALONE_M + 0.5)


def _ahead(tracks: Tracks, agent: int) -> Float[np.ndarray, " 2"]:
    yaw = tracks.yaw[agent, -1]
    return np.array([np.cos(yaw), np.sin(yaw)])


@compiled
def _allowed(world: World, config: AttackConfig) -> Bool[Array, " agent"]:
    return candidates(world, config)
