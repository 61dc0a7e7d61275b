"""Scenarios in, attacked Scenarios out: one scenario per thread, results as values."""

import dataclasses
import os
import re
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.attacks.costs import pooled_ego_distances
from regents_cosim.attacks.descent import ExtraCost, Found, descend
from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.attacks.rules import candidates
from regents_cosim.collisions import collision_kind, first_contact, relative_speed
from regents_cosim.errors import RegentsError
from regents_cosim.mirror.world import World, to_tracks, to_world
from regents_cosim.planners.interface import JaxPlanner, Scene, find_planner, start
from regents_cosim.scenario import AttackRecord, Collision, Outcome, Scenario, Tracks

_COST_TERMS = ("ego", "pair", "road")


def attack(
    scenarios: Iterable[Scenario],
    config: AttackConfig,
    planner: str = "idm",
    batch: int = 32,
    extra_cost: ExtraCost | None = None,
) -> Iterator[Scenario]:
    """All results of `attack_each`, one after the other."""
    for results in attack_each(scenarios, config, planner, batch, extra_cost):
        yield from results


def attack_each(
    scenarios: Iterable[Scenario],
    config: AttackConfig,
    planner: str = "idm",
    batch: int = 32,
    extra_cost: ExtraCost | None = None,
) -> Iterator[list[Scenario]]:
    """Attack every scenario, in order; yields the results of each as soon as it is done.

    A joint search gives one result, a search per candidate one for every distinct adversary that
    succeeds, or one without a collision. The search never fails: how it ended is
    `attack.outcome`. At most `batch` scenarios are held on the device at once. Raises
    PlannerError where the planner cannot be found, RegentsError for a scenario that was attacked
    before.

    `extra_cost` of (World, Motion [agent, time] with the ego in row 0, Controls [agent, step]) is
    added to the cost, to ask for more than a collision; it must be differentiable by JAX.
    """
    under_test = find_planner(planner)
    threads = os.cpu_count() or 1
    with ThreadPoolExecutor(threads) as pool:
        waiting: deque[Future[list[Scenario]]] = deque()
        for scenario in scenarios:
            waiting.append(pool.submit(attack_one, scenario, config, under_test, planner, extra_cost))
            if len(waiting) >= max(batch, 1):
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def attack_one(
    scenario: Scenario,
    config: AttackConfig,
    planner: JaxPlanner,
    planner_name: str,
    extra_cost: ExtraCost | None = None,
) -> list[Scenario]:
    """Attack one scenario: one result, or one for every distinct adversary."""
    if scenario.attack is not None:
        raise RegentsError(
            f"case {scenario.id} was attacked already (by {scenario.attack.method}); attack its original recording"
        )
    dynamics = scenario.dynamics if config.dynamics == "recorded" else config.dynamics
    config = replace(config, dynamics=dynamics)
    world = to_world(scenario, dynamics)
    memory = start(planner, Scene(scenario, world), planner_name)
    allowed = np.asarray(_candidates(world, config))
    if config.search == "joint" or not allowed.any():
        found = descend(world, planner, memory, config, jnp.asarray(allowed), extra_cost)
        return [_attacked(scenario, config, planner_name, found, np.flatnonzero(allowed))]
    results: dict[str, Scenario] = {}
    for agent in _nearest(world, allowed, config):
        found = descend(world, planner, memory, config, jnp.arange(len(allowed)) == agent, extra_cost)
        attacked = _attacked(scenario, config, planner_name, found, np.array([agent]))
        record = attacked.attack
        if record is None or record.outcome == "already_colliding":
            return [attacked]
        results.setdefault(record.collision.agent if record.collision else "", attacked)
    missed = results.pop("", None)
    return [_named_after_adversary(hit) for hit in results.values()] or [missed or scenario]


def _nearest(world: World, allowed: Bool[np.ndarray, " agent"], config: AttackConfig) -> list[int]:
    """The candidates that come nearest to the ego in the log, the nearest first."""
    distances = np.asarray(_logged_distances(world, config))
    order = np.argsort(np.where(allowed, distances, np.inf), kind="stable")
    return [int(agent) for agent in order[: config.nearest] if allowed[agent]]


# Compiled as a whole: op by op, the first call of a process would compile each of them alone.
_candidates = eqx.filter_jit(candidates)


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
    tracks = scenario.tracks if outcome == "diverged" else to_tracks(found.motion, found.controls, scenario)
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
    name = f"{scenario.id}-{config.method}-{_label(planner_name)}"
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
    rounded = np.asarray(found.history, float)[:iterations].round(6)
    return [tuple(term.tolist()) for term in rounded.T]
