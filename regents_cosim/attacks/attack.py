"""Scenarios in, attacked Scenarios out: one scenario per thread or many in one program, results as values."""

import dataclasses
import itertools
import os
import re
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.attacks import published
from regents_cosim.attacks.costs import pooled_ego_distances
from regents_cosim.attacks.descent import ExtraCost, Found
from regents_cosim.attacks.lanes import Job, search_in_lanes
from regents_cosim.attacks.movers import Movers
from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.attacks.rules import candidates
from regents_cosim.attacks.search import descend
from regents_cosim.collisions import collision_kind, first_contact, relative_speed
from regents_cosim.errors import RegentsError
from regents_cosim.mirror.world import World, to_tracks, to_world
from regents_cosim.planners.interface import JaxPlanner, Scene, find_planner, start
from regents_cosim.scenario import AttackRecord, Collision, Dynamics, Outcome, Scenario, Tracks

_COST_TERMS = ("ego", "pair", "road")

Engine = Literal["auto", "threads", "lanes"]


def attack(
    scenarios: Iterable[Scenario],
    config: AttackConfig,
    planner: str = "idm",
    batch: int = 32,
    extra_cost: ExtraCost | None = None,
    engine: Engine = "auto",
) -> Iterator[Scenario]:
    """All results of `attack_each`, one after the other."""
    for results in attack_each(scenarios, config, planner, batch, extra_cost, engine):
        yield from results


def attack_each(
    scenarios: Iterable[Scenario],
    config: AttackConfig,
    planner: str = "idm",
    batch: int = 32,
    extra_cost: ExtraCost | None = None,
    engine: Engine = "auto",
) -> Iterator[list[Scenario]]:
    """Attack every scenario, in order; yields the results of each as soon as it is done.

    A joint search gives one result, a search per candidate one for every distinct adversary that
    succeeds, or one without a collision. The search never fails: how it ended is
    `attack.outcome`. At most `batch` scenarios are held on the device at once. Raises
    PlannerError where the planner cannot be found, RegentsError for a scenario that was attacked
    before.

    `engine` is "threads", one scenario per core, or "lanes", `batch` searches in one program;
    "auto" takes threads on a CPU and lanes on an accelerator.

    `extra_cost` of (World, Motion [agent, time] with the ego in row 0, Controls [agent, step]) is
    added to the cost, to ask for more than a collision; it must be differentiable by JAX.
    """
    under_test = find_planner(planner)
    if engine == "auto":
        engine = "threads" if jax.default_backend() == "cpu" else "lanes"
    run = _in_threads if engine == "threads" else _in_lanes
    yield from run(scenarios, _Attack(config, under_test, planner, extra_cost), max(batch, 1))


@dataclass(frozen=True)
class _Attack:
    """What is the same for all scenarios of an attack."""

    config: AttackConfig
    planner: JaxPlanner
    planner_name: str
    extra_cost: ExtraCost | None

    def dynamics(self, scenario: Scenario) -> Dynamics:
        """The model by which vehicles move in `scenario`."""
        return scenario.dynamics if self.config.dynamics == "recorded" else self.config.dynamics

    def jobs(self, scenario: Scenario) -> list[Job]:
        """The descents that a scenario takes: one, or one for each of the nearest candidates."""
        if scenario.attack is not None:
            raise RegentsError(
                f"case {scenario.id} was attacked already (by {scenario.attack.method}); attack its original recording"
            )
        world = to_world(scenario, self.dynamics(scenario))
        memory = start(self.planner, Scene(scenario, world), self.planner_name)
        allowed = np.asarray(_candidates(world, self.config))
        if self.config.search == "joint" or not allowed.any():
            return [Job(world, memory, Movers.among(jnp.asarray(allowed)))]
        nearest = _nearest(world, allowed, self.config)
        return [Job(world, memory, Movers.only(agent, len(allowed))) for agent in nearest]

    def run(self, scenario: Scenario) -> list[Scenario]:
        """One result, or one for every distinct adversary."""
        jobs = self.jobs(scenario)
        found = [descend(job.world, self.planner, job.memory, self.config, job.movers, self.extra_cost) for job in jobs]
        return self.results(scenario, jobs, found)

    def results(self, scenario: Scenario, jobs: list[Job], found: list[Found]) -> list[Scenario]:
        """What the descents found, as cases."""
        config = replace(self.config, dynamics=self.dynamics(scenario))
        attacked = [
            _attacked(scenario, config, self.planner_name, one, np.flatnonzero(job.movers.candidate))
            for job, one in zip(jobs, found, strict=True)
        ]
        by_adversary: dict[str, Scenario] = {}
        for case in attacked:
            record = case.attack
            if len(attacked) == 1 or record is None or record.outcome == "already_colliding":
                return [case]
            by_adversary.setdefault(record.collision.agent if record.collision else "", case)
        missed = by_adversary.pop("", scenario)
        return [_named_after_adversary(hit) for hit in by_adversary.values()] or [missed]


def _in_threads(scenarios: Iterable[Scenario], attack: _Attack, batch: int) -> Iterator[list[Scenario]]:
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        waiting: deque[Future[list[Scenario]]] = deque()
        for scenario in scenarios:
            waiting.append(pool.submit(attack.run, scenario))
            if len(waiting) >= batch:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _in_lanes(scenarios: Iterable[Scenario], attack: _Attack, batch: int) -> Iterator[list[Scenario]]:
    rest = iter(scenarios)
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        while some := list(itertools.islice(rest, batch)):
            jobs = list(pool.map(attack.jobs, some))
            in_a_row = list(itertools.chain.from_iterable(jobs))
            found = iter(search_in_lanes(in_a_row, attack.planner, attack.config, batch, attack.extra_cost))
            for scenario, mine in zip(some, jobs, strict=True):
                yield attack.results(scenario, mine, list(itertools.islice(found, len(mine))))


def _nearest(world: World, allowed: Bool[np.ndarray, " agent"], config: AttackConfig) -> list[int]:
    """The candidates that come nearest to the ego in the log, the nearest first."""
    distances = np.asarray(_logged_distances(world, config))
    order = np.argsort(np.where(allowed, distances, np.inf), kind="stable")
    return [int(agent) for agent in order[: config.nearest] if allowed[agent]]


# Compiled as a whole: op by op, the first call of a process would compile each of them alone.
@eqx.filter_jit
def _candidates(world: World, config: AttackConfig) -> Bool[Array, " agent"]:
    return published.candidates(world, config) if config.as_published else candidates(world, config)


@eqx.filter_jit
def _logged_distances(world: World, config: AttackConfig) -> Float[Array, " agent"]:
    return pooled_ego_distances(world, world.boxes(world.log), config)


def _named_after_adversary(attacked: Scenario) -> Scenario:
    adversary = next(agent.id for agent in attacked.agents if agent.role == "adversary")
    return replace(attacked, id=f"{attacked.id}-{_label(adversary)}")


def _attacked(
    scenario: Scenario, config: AttackConfig, planner_name: str, found: Found, candidate: Int[np.ndarray, " candidate"]
) -> Scenario:
    outcome = _outcome(found)
    present = published.stay(scenario) if config.as_published else scenario
    tracks = scenario.tracks if outcome == "diverged" else to_tracks(found.motion, found.controls, present)
    collision = _collision(scenario, tracks, found) if found.hit else None
    struck = collision.agent if collision and outcome == "collision" else None
    agents = tuple(replace(a, role="adversary") if a.id == struck else a for a in scenario.agents)
    iterations = int(found.iterations)
    record = AttackRecord(
        case=scenario.id,
        method=config.method,
        planner=planner_name,
        outcome=outcome,
        iterations=iterations,
        collision=collision,
        candidates=tuple(scenario.agents[index].id for index in candidate),
        settings={k: v for k, v in dataclasses.asdict(config).items() if k != "method"},
        cost_history=dict(zip(_COST_TERMS, _history(found, iterations), strict=True)),
    )
    name = f"{scenario.id}-{config.label}-{_label(planner_name)}"
    return replace(scenario, id=name, agents=agents, tracks=tracks, attack=record, original=scenario.tracks)


def _label(planner: str) -> str:
    """The last part of a planner's name, in letters that every file system takes."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", planner.rpartition(":")[2])


def _outcome(found: Found) -> Outcome:
    if not found.finite:
        return "diverged"
    if found.hit:
        return "collision" if found.iterations > 0 else "already_colliding"
    return "no_collision" if found.any_candidate else "no_candidate"


def _collision(scenario: Scenario, tracks: Tracks, found: Found) -> Collision:
    """The first contact, by the exact boxes of the host."""
    contact = first_contact(scenario.agents, tracks)
    if contact is None:
        raise RuntimeError(f"case {scenario.id}: the mirror saw a collision that the exact boxes do not confirm")
    agent, step = contact
    return Collision(
        agent=scenario.agents[agent].id,
        step=step,
        time_s=round(step * scenario.dt, 9),
        kind=collision_kind(scenario.agents, tracks, agent, step),
        relative_speed=relative_speed(tracks, agent, step),
        attributed=bool(found.changed[agent]),
    )


def _history(found: Found, iterations: int) -> list[tuple[float, ...]]:
    """Costs before each update; those that blew up, which JSON cannot hold, are left out."""
    rounded = np.asarray(found.history, float)[:iterations].round(6)
    rounded = rounded[np.isfinite(rounded).all(axis=1)]
    return [tuple(term.tolist()) for term in rounded.T]
