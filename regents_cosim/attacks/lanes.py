"""Many descents side by side in one compiled loop, for accelerators.

A lane whose search is over is given to the next one that waits. On a CPU this gains nothing
over one descent per thread (`docs/performance.md`): there `attack` uses threads.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from regents_cosim.attacks.descent import Descent, ExtraCost
from regents_cosim.attacks.job import Job
from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.attacks.search import set_up
from regents_cosim.attacks.search_state import Found, Search
from regents_cosim.mirror.compiled import compiled
from regents_cosim.mirror.rollout import LoopPlanner

_PASSES = 25  # iterations between two looks at who has finished


def search_in_lanes(
    jobs: Iterable[Job],
    planner: LoopPlanner,
    config: AttackConfig,
    lanes: int,
    iterations: int,
    extra_cost: ExtraCost | None = None,
) -> list[Found]:
    """The outcome of every job after at most so many updates, in their order, at most `lanes` at a time.

    Jobs of one shape share a program.
    """
    most, config = jnp.int32(iterations), config.compiled()
    by_shape: dict[Any, list[tuple[int, Job]]] = defaultdict(list)
    for number, job in enumerate(jobs):
        shapes = tuple(leaf.shape for leaf in jax.tree.leaves(job))
        by_shape[jax.tree.structure(job), shapes].append((number, job))
    found: dict[int, Found] = {}
    for group in by_shape.values():
        found.update(_search_group(group, planner, config, most, min(lanes, len(group)), extra_cost))
    return [found[number] for number in sorted(found)]


def _search_group(
    group: list[tuple[int, Job]],
    planner: LoopPlanner,
    config: AttackConfig,
    most: Int[Array, ""],
    lanes: int,
    extra_cost: ExtraCost | None,
) -> Iterator[tuple[int, Found]]:
    waiting = iter(group[lanes:])
    numbers: list[int | None] = [number for number, _ in group[:lanes]]
    jobs = jax.tree.map(lambda *values: jnp.stack(values), *(job for _, job in group[:lanes]))
    searches = _begin(jobs, planner, config, extra_cost)
    while any(number is not None for number in numbers):
        searches, goes_on = _advance(jobs, searches, planner, config, most, extra_cost)
        for lane in np.flatnonzero(~np.asarray(goes_on)).tolist():
            number = numbers[lane]
            if number is None:
                continue
            yield number, _result(jobs, searches, jnp.int32(lane), planner, config, extra_cost)
            numbers[lane], job = next(waiting, (None, None))
            if job is not None:
                one = jax.tree.map(lambda values: values[None], job)
                first = jax.tree.map(lambda values: values[0], _begin(one, planner, config, extra_cost))
                jobs, searches = _put((jnp.int32(lane), job, first), (jobs, searches))


@compiled
def _begin(jobs: Job, planner: LoopPlanner, config: AttackConfig, extra_cost: ExtraCost | None) -> Search:
    return jax.vmap(lambda job: _descent(job, planner, config, extra_cost).begin())(jobs)


@compiled
def _advance(
    jobs: Job,
    searches: Search,
    planner: LoopPlanner,
    config: AttackConfig,
    most: Int[Array, ""],
    extra_cost: ExtraCost | None,
) -> tuple[Search, Bool[Array, " lane"]]:
    def advance(job: Job, search: Search) -> tuple[Search, Bool[Array, ""]]:
        descent = _descent(job, planner, config, extra_cost)
        search = descent.advance(search, jnp.minimum(_PASSES, most - search.iterations))
        return search, descent.goes_on(search) & (search.iterations < most)

    return jax.vmap(advance)(jobs, searches)


@compiled
def _result(
    jobs: Job, searches: Search, lane: Int[Array, ""], planner: LoopPlanner, config: AttackConfig, extra_cost: Any
) -> Found:
    job, search = jax.tree.map(lambda values: values[lane], (jobs, searches))
    return _descent(job, planner, config, extra_cost).result(search)


@compiled(donate="all-except-first")
def _put(new: tuple[Int[Array, ""], Job, Search], all_: tuple[Job, Search]) -> tuple[Job, Search]:
    lane, job, search = new
    return jax.tree.map(lambda values, value: values.at[lane].set(value), all_, (job, search))


def _descent(job: Job, planner: LoopPlanner, config: AttackConfig, extra_cost: ExtraCost | None) -> Descent:
    return set_up(job.world, planner, job.memory, config, job.movers, job.start, extra_cost)
