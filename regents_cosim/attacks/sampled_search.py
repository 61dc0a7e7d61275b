"""Searches without a gradient: CMA-ES, with which `focused` begins, and random search.

They compare fairly with the descent: same cost, same candidates, same acceptance, same bounds of the actions, and as
many roll-outs as the descent may make updates. A change of the actions has ten numbers: accelerations and curvatures at
five times, linear in between, added to the actions that a descent would begin with, either the logged ones or those of
a lawful drive. Patience ends a search as it ends a descent.
"""

import zlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from regents_cosim.attacks.actions import allowed, to_actions
from regents_cosim.attacks.descent import ExtraCost
from regents_cosim.attacks.evolution import cma_es
from regents_cosim.attacks.job import SearchEnd, SearchJob
from regents_cosim.attacks.patience import decreases_enough, updates_to_wait
from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.attacks.search import LOOKED_AT, descend, look_and_descend, shared
from regents_cosim.attacks.search_state import SearchResult, StartLooks
from regents_cosim.attacks.searched_agents import SearchedAgents
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.compiled import compiled
from regents_cosim.mirror.on_device import on_device
from regents_cosim.mirror.rollout import LoopPlanner
from regents_cosim.mirror.world import World
from regents_cosim.norms.limits import ACCEL_LIMIT
from regents_cosim.scenario import Scenario

KNOTS = 5
_UNIT = (0.4, 0.06)  # shares of the limits for a coordinate of 1: 2.4 m/s^2, 0.018 1/m


class Sampler(Protocol):
    """Proposes the changes to try next."""

    def ask(self) -> Float[np.ndarray, "change coordinate"]:
        """Propose changes."""
        ...

    def tell(self, changes: Float[np.ndarray, "change coordinate"], costs: Float[np.ndarray, " change"]) -> None:
        """Learn what the changes cost."""
        ...


class AtRandom:
    """Changes from a normal distribution that never learns."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def ask(self) -> Float[np.ndarray, "change coordinate"]:
        """Propose changes."""
        return self._rng.normal(size=(LOOKED_AT, 2 * KNOTS))

    def tell(self, changes: Float[np.ndarray, "change coordinate"], costs: Float[np.ndarray, " change"]) -> None:
        """Learn nothing."""


class ByEvolution:
    """CMA-ES around the first actions."""

    def __init__(self, seed: int) -> None:
        self._cma = cma_es(np.zeros(2 * KNOTS), 0.5, LOOKED_AT, seed)

    def ask(self) -> Float[np.ndarray, "change coordinate"]:
        """Propose a generation of changes."""
        return np.stack([self._cma.ask() for _ in range(LOOKED_AT)])

    def tell(self, changes: Float[np.ndarray, "change coordinate"], costs: Float[np.ndarray, " change"]) -> None:
        """Learn the costs of a generation."""
        self._cma.tell([(change, float(cost)) for change, cost in zip(changes, costs, strict=True)])


def search_by_samples(
    jobs: Sequence[tuple[Scenario, SearchJob]],
    planner: LoopPlanner,
    config: AttackConfig,
    most: int,
    extra_cost: ExtraCost | None,
) -> list[SearchEnd]:
    """Look at the start of each job, then try changes of it until one is accepted or `most` roll-outs are spent."""
    return [SearchEnd(_search(scenario, job, planner, config, most, extra_cost)) for scenario, job in jobs]


def _search(
    scenario: Scenario,
    job: SearchJob,
    planner: LoopPlanner,
    config: AttackConfig,
    most: int,
    extra_cost: ExtraCost | None,
) -> SearchResult:
    begun = descend(job, planner, config, 0, extra_cost)
    if most == 0 or config.optimiser == "none" or bool(begun.accepted) or not bool(begun.any_candidate):
        return begun
    seed = zlib.crc32(f"{scenario.id} {int(job.searched.first)}".encode())
    sampler: Sampler = AtRandom(seed) if config.optimiser == "random" else ByEvolution(seed)
    bare = job._replace(world=replace(job.world.without_road(), bounds=job.world.bounds), memory=None)
    program, history = shared(config), np.zeros(begun.history.shape, np.float32)
    best, least, tried = np.zeros(2 * KNOTS), np.inf, 0
    nearest, nearest_at = np.float32(np.inf), 0  # the ego's cost at its last decrease, and the roll-out of that
    while tried < most and (not config.patience or tried - nearest_at <= updates_to_wait(config, nearest)):
        changes = sampler.ask()[: most - tried]
        found, looks = _look(job, bare, planner, program, extra_cost, changes)
        seen = (looks.cost, looks.terms, looks.accepted)
        costs, terms, accepted = (np.asarray(values)[: len(changes)] for values in seen)
        made = int(np.argmax(accepted)) + 1 if accepted.any() else len(changes)
        history[tried : tried + made] = terms[:made]
        tried += made
        if accepted.any():
            return _after(found, tried, history)
        if costs.min() < least:
            best, least = changes[np.argmin(costs)], float(costs.min())
        if decreases_enough(config, terms[:, 0].min(), nearest, most - tried + made):
            nearest, nearest_at = terms[:, 0].min(), tried
        if len(changes) == LOOKED_AT:
            sampler.tell(changes, costs)
    found, _ = _look(job, bare, planner, program, extra_cost, best[None])
    return _after(found, tried, history)


def _look(
    job: SearchJob,
    bare: SearchJob,
    planner: LoopPlanner,
    program: AttackConfig,
    extra_cost: ExtraCost | None,
    changes: Float[np.ndarray, "change coordinate"],
) -> tuple[SearchResult, StartLooks]:
    """Try changes, up to the first that is accepted, and give the last of these as a search result.

    `bare` is the job without the road, which the changed actions do not depend on.
    """
    padded = np.pad(changes, ((0, LOOKED_AT - len(changes)), (0, 0)), mode="edge")
    made = _changed(bare, program, on_device(padded, np.float32))
    # What another program returns is bound to its device, which would make JAX compile another program for it.
    starts = jax.tree.map(lambda actions: on_device(actions, np.float32), made)
    count, none = on_device(len(changes), np.int32), on_device(0, np.int32)
    return look_and_descend(job.world, planner, job.memory, program, job.searched, starts, count, none, extra_cost)


def _after(found: SearchResult, tried: int, history: Float[np.ndarray, "iteration term"]) -> SearchResult:
    """The result as the end of `tried` roll-outs."""
    return replace(found, iterations=on_device(tried, np.int32), history=on_device(history, np.float32))


@compiled
def _changed(job: SearchJob, config: AttackConfig, changes: Float[Array, "change coordinate"]) -> ControlArrays:
    """The actions [change searched step] of some changes, within the configuration and the law."""
    logged = job.searched.rows(to_actions(job.world.controls))
    first = logged if job.start is None else job.start
    at_its_pace = pace(job.world, job.searched)
    return jax.vmap(
        lambda change: allowed(with_change(first, change, at_its_pace), logged, job.world, job.searched, config)
    )(changes)


def with_change(
    first: ControlArrays, change: Float[Array, " coordinate"], at_its_pace: Float[Array, "searched 1"] | float
) -> ControlArrays:
    """Actions [searched step] plus a change [2 * KNOTS], scaled by the agents' pace."""
    units = _UNIT[0] * at_its_pace, _UNIT[1]
    steps = first.accel.shape[1]
    knots, times = jnp.linspace(0.0, steps - 1.0, KNOTS), jnp.arange(steps)
    return ControlArrays(
        *(
            own + unit * jnp.interp(times, knots, part)
            for own, unit, part in zip(
                (first.accel, first.curvature), units, (change[:KNOTS], change[KNOTS:]), strict=True
            )
        )
    )


def pace(world: World, searched: SearchedAgents) -> Float[Array, "searched 1"] | float:
    """The pace of each searched agent: its greatest acceleration, as a share of a coordinate of 1; for cars 1."""
    if world.walks is None or world.bounds is None:
        return 1.0
    walks, most = searched.rows(world.walks), searched.rows(world.bounds.accel)
    return jnp.where(walks, most / (_UNIT[0] * ACCEL_LIMIT), 1.0)[:, None]
