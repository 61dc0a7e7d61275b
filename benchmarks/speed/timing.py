"""Shared parts of the benchmarks of the attack: scenes of a given size, and timing."""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import numpy as np
from scenes import scene

from regents_cosim.attacks.accept.rules import of_kinds
from regents_cosim.attacks.descent.batched_search import SearchJob
from regents_cosim.attacks.descent.driving_limits import limits_by_kind, with_bounds
from regents_cosim.attacks.descent.search import descend
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.methods.presets import KING, AttackConfig
from regents_cosim.mirror.world import to_world
from regents_cosim.planners.jax_planner import CompiledScene, start
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.scenario.scenario import Scenario

# Steps so small that nothing is ever hit: every iteration is run.
STILL = KING.but(learning_rate=1e-9, iterations=100)


def dense_traffic(agents: int, steps: int = 80, seed: int = 0) -> Scenario:
    """Three full lanes, 14 m between neighbours: about as many pairs within reach as there are agents."""
    rng = np.random.default_rng(seed)
    cars = [(14.0 * (i // 3) + rng.uniform(0, 3), 3.2 * (i % 3), 8.0 + (i // 3) * 0.02) for i in range(agents)]
    return scene(*cars, steps=steps + 1, name=f"dense{agents}-{steps}-{seed}")


def job(scenario: Scenario, planner: str) -> tuple[Any, SearchJob]:
    """A planner and a joint search on it in which everybody but the ego is a candidate."""
    under_test, world = PlannerUnderTest.of(planner).loop, to_world(scenario)
    assert under_test is not None
    memory = start(under_test, CompiledScene(scenario, world), planner)
    return under_test, SearchJob(
        world, memory, SearchedAgents.among(world.vehicle & (np.arange(len(world.vehicle)) > 0))
    )


def bounded_job(scenario: Scenario, config: AttackConfig, agent: int | None) -> tuple[Any, SearchJob]:
    """A job with the bounds and kinds of a configuration; with an `agent`, a job for that agent alone."""
    under_test, wanted = job(scenario, "log_replay")
    world = with_bounds(wanted.world, scenario, config, limits_by_kind(scenario, config))
    everyone = SearchedAgents.among(
        of_kinds(world, config.candidates.adversary_kinds) & (np.arange(len(world.vehicle)) > 0)
    )
    searched = everyone if agent is None else SearchedAgents.only(agent, len(world.vehicle))
    return under_test, SearchJob(world, wanted.memory, searched)


def attack(planner: Any, wanted: SearchJob, config: AttackConfig = STILL) -> Any:
    """Run one search to its end."""
    return jax.block_until_ready(descend(wanted, planner, config, config.steps.iterations))


def seconds(work: Callable[[], Any], rounds: int = 7) -> float:
    """Least wall time of several runs, the first left out."""
    work()
    best = float("inf")
    for _ in range(rounds):
        begin = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - begin)
    return best


def in_threads(threads: int, work: Callable[[Any], Any], items: list[Any]) -> None:
    """Do all of it, on so many threads."""
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, items))
