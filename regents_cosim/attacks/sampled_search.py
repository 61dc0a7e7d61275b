"""Searches that know the cost and not its gradient: CMA-ES, with which `focused` begins, and random search.

Against the descent they compare fairly: same cost, same candidates, same acceptance, same bounds of the actions, and
as many roll-outs as the descent may make updates. A change of the actions has ten numbers: accelerations and
curvatures at five times, linear in between, added to those that a descent would begin with: the logged ones, or those
of a drive along a lawful way. Patience ends a search as it does there.

Source: Hansen 2016, "The CMA Evolution Strategy: A Tutorial" (package `cmaes`).
"""

import zlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import jax
import jax.numpy as jnp
import numpy as np
from cmaes import CMA
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.attacks.descent import PROGRESS, Descent, ExtraCost
from regents_cosim.attacks.job import SearchEnd, SearchJob
from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.attacks.search import descend, set_up
from regents_cosim.attacks.search_state import SearchResult
from regents_cosim.mirror.bicycle import ACCEL_LIMIT, Controls
from regents_cosim.mirror.compiled import compiled
from regents_cosim.mirror.rollout import LoopPlanner
from regents_cosim.scenario import Scenario

KNOTS = 5
_UNIT = (0.4, 0.06)  # shares of the limits that a coordinate of 1 stands for: 2.4 m/s^2, 0.018 1/m
_BATCH = 10  # roll-outs between two looks; CMA-ES's own choice for ten coordinates


class Sampler(Protocol):
    """Where to look next."""

    def ask(self) -> Float[np.ndarray, "change coordinate"]:
        """Some changes to try."""
        ...

    def tell(self, changes: Float[np.ndarray, "change coordinate"], costs: Float[np.ndarray, " change"]) -> None:
        """What they cost."""
        ...


class AtRandom:
    """Changes from a normal distribution that never learns."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def ask(self) -> Float[np.ndarray, "change coordinate"]:
        """Some changes to try."""
        return self._rng.normal(size=(_BATCH, 2 * KNOTS))

    def tell(self, changes: Float[np.ndarray, "change coordinate"], costs: Float[np.ndarray, " change"]) -> None:
        """Nothing is learnt."""


class ByEvolution:
    """CMA-ES, from the log."""

    def __init__(self, seed: int) -> None:
        self._cma = CMA(mean=np.zeros(2 * KNOTS), sigma=0.5, population_size=_BATCH, seed=seed)

    def ask(self) -> Float[np.ndarray, "change coordinate"]:
        """A generation."""
        return np.stack([self._cma.ask() for _ in range(_BATCH)])

    def tell(self, changes: Float[np.ndarray, "change coordinate"], costs: Float[np.ndarray, " change"]) -> None:
        """The generation's costs."""
        self._cma.tell([(change, float(cost)) for change, cost in zip(changes, costs, strict=True)])


def search_by_samples(
    jobs: Sequence[tuple[Scenario, SearchJob]],
    planner: LoopPlanner,
    config: AttackConfig,
    most: int,
    extra_cost: ExtraCost | None,
) -> list[SearchEnd]:
    """Look at what each job begins with, then try changes of it until one is accepted or `most` roll-outs are spent."""
    return [SearchEnd(_search(scenario, job, planner, config, most, extra_cost)) for scenario, job in jobs]


def _search(
    scenario: Scenario,
    job: SearchJob,
    planner: LoopPlanner,
    config: AttackConfig,
    most: int,
    extra_cost: ExtraCost | None,
) -> SearchResult:
    compiled = config.compiled()
    # A look is that of our descent, by the same program: a planner that collides in the log is not attacked.
    looks = replace(compiled, optimiser="adam")
    begun = descend(job.world, planner, job.memory, looks, job.searched, jnp.int32(0), job.start, extra_cost)
    if most == 0 or config.optimiser == "none" or bool(begun.accepted) or not bool(begun.any_candidate):
        return begun
    seed = zlib.crc32(f"{scenario.id} {int(job.searched.first)}".encode())
    sampler: Sampler = AtRandom(seed) if config.optimiser == "random" else ByEvolution(seed)
    history = np.zeros((compiled.iterations, 3), np.float32)
    best, least, tried, done = np.zeros(2 * KNOTS), np.inf, 0, False
    nearest, nearest_at = np.inf, 0  # the ego's cost when it last came down, and the roll-out of that
    while not done and tried < most and (not config.patience or tried - nearest_at <= config.patience):
        changes = sampler.ask()[: most - tried]
        padded = np.pad(changes, ((0, _BATCH - len(changes)), (0, 0)))
        totals, terms, accepted = (
            np.asarray(values)[: len(changes)]
            for values in _try(job, planner, compiled, extra_cost, jnp.asarray(padded, jnp.float32))
        )
        done = bool(accepted.any())
        chosen = int(np.argmax(accepted)) if done else int(np.argmin(totals))
        if done or totals[chosen] < least:
            best, least = changes[chosen], float(totals[chosen])
        made = chosen + 1 if done else len(changes)
        history[tried : tried + made] = terms[:made]
        tried += made
        if terms[:made, 0].min() < (1.0 - PROGRESS) * nearest:
            nearest, nearest_at = float(terms[:made, 0].min()), tried
        if len(changes) == _BATCH:
            sampler.tell(changes, totals)
    return _end(
        job, planner, compiled, extra_cost, jnp.asarray(best, jnp.float32), jnp.int32(tried), jnp.asarray(history)
    )


@compiled
def _try(
    job: SearchJob,
    planner: LoopPlanner,
    config: AttackConfig,
    extra_cost: ExtraCost | None,
    changes: Float[Array, "change coordinate"],
) -> tuple[Float[Array, " change"], Float[Array, "change term"], Bool[Array, " change"]]:
    """Cost, its terms, and whether it is accepted, of every change.

    One after the other: side by side, all would be judged for the sake of the few that crash.
    """
    descent = set_up(job.world, planner, job.memory, config, job.searched, job.start, extra_cost)
    begun = descent.begin()

    def one(change: Float[Array, " coordinate"]) -> tuple[Array, Array, Array]:
        search = descent.seeing(replace(begun, actions=changed(descent, change)))
        total, costs = descent.cost(search.seen.boxes, search.seen.motion, search.actions)
        terms = jnp.stack([costs.ego, costs.pair, costs.road])
        return jnp.where(jnp.isfinite(total), total, jnp.inf), terms, search.accepted

    return jax.lax.map(one, changes)


@compiled
def _end(
    job: SearchJob,
    planner: LoopPlanner,
    config: AttackConfig,
    extra_cost: ExtraCost | None,
    change: Float[Array, " coordinate"],
    tried: Int[Array, ""],
    history: Float[Array, "iteration term"],
) -> SearchResult:
    descent = set_up(job.world, planner, job.memory, config, job.searched, job.start, extra_cost)
    search = descent.seeing(replace(descent.begin(), actions=changed(descent, change)))
    return descent.result(replace(search, iterations=tried, history=history))


def changed(descent: Descent, change: Float[Array, " coordinate"]) -> Controls:
    """What the search begins with plus `change` [2 * KNOTS], within the bounds of the configuration and of the law."""
    first = descent.first()
    units = _UNIT[0] * _pace(descent), _UNIT[1]
    steps = first.accel.shape[1]
    knots, times = jnp.linspace(0.0, steps - 1.0, KNOTS), jnp.arange(steps)
    moved = Controls(
        *(
            own + unit * jnp.interp(times, knots, part)
            for own, unit, part in zip(
                (first.accel, first.curvature), units, (change[:KNOTS], change[KNOTS:]), strict=True
            )
        )
    )
    return descent.allowed(moved)


def _pace(descent: Descent) -> Float[Array, "searched 1"] | float:
    """How hard each of the searched moves at most, as a share of what a coordinate of 1 stands for; cars: 1."""
    world, searched = descent.world, descent.searched
    if world.walks is None or world.bounds is None:
        return 1.0
    walks, most = searched.rows(world.walks), searched.rows(world.bounds.accel)
    return jnp.where(walks, most / (_UNIT[0] * ACCEL_LIMIT), 1.0)[:, None]
