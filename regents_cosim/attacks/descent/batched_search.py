"""Many descents side by side in one compiled loop, for accelerators.

When a search is over, its slot is given to the next one that waits. On a CPU this is no faster than one descent per
thread, so `attack` uses threads there.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from regents_cosim.attacks.descent.search_state import SearchResult, SearchState
from regents_cosim.attacks.descent.step import Descent, ExtraCost
from regents_cosim.attacks.job import SearchJob
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.rollout import LoopPlanner

_PASSES = 25  # iterations between two checks for finished searches


def search_batched(
    jobs: Iterable[SearchJob],
    planner: LoopPlanner,
    config: AttackConfig,
    slots: int,
    iterations: int,
    extra_cost: ExtraCost | None = None,
) -> list[SearchResult]:
    """The result of every job after at most `iterations` updates, in order, with at most `slots` jobs at a time.

    Jobs of one shape share a program.
    """
    given = planner, config.compiled(), extra_cost
    by_shape: dict[Any, list[tuple[int, SearchJob]]] = defaultdict(list)
    for number, job in enumerate(jobs):
        shapes = tuple(leaf.shape for leaf in jax.tree.leaves(job))
        by_shape[jax.tree.structure(job), shapes].append((number, job))
    found: dict[int, SearchResult] = {}
    for group in by_shape.values():
        found.update(_search_group(group, given, jnp.int32(iterations), min(slots, len(group))))
    return [found[number] for number in sorted(found)]


_Given = tuple[LoopPlanner, AttackConfig, ExtraCost | None]


def _search_group(
    group: list[tuple[int, SearchJob]], given: _Given, most: Int[Array, ""], slots: int
) -> Iterator[tuple[int, SearchResult]]:
    waiting = iter(group[slots:])
    numbers: list[int | None] = [number for number, _ in group[:slots]]
    jobs = jax.tree.map(lambda *values: jnp.stack(values), *(job for _, job in group[:slots]))
    searches = _begin(jobs, given)
    while any(number is not None for number in numbers):
        searches, goes_on = _advance(jobs, searches, given, most)
        for slot in np.flatnonzero(~np.asarray(goes_on)).tolist():
            number = numbers[slot]
            if number is None:
                continue
            yield number, _result(jobs, searches, jnp.int32(slot), given)
            numbers[slot], job = next(waiting, (None, None))
            if job is not None:
                one = jax.tree.map(lambda values: values[None], job)
                first = jax.tree.map(lambda values: values[0], _begin(one, given))
                jobs, searches = _put((jnp.int32(slot), job, first), (jobs, searches))


@compiled
def _begin(jobs: SearchJob, given: _Given) -> SearchState:
    return jax.vmap(lambda job: Descent.of(job, *given).begin())(jobs)


@compiled
def _advance(
    jobs: SearchJob, searches: SearchState, given: _Given, most: Int[Array, ""]
) -> tuple[SearchState, Bool[Array, " slot"]]:
    def advance(job: SearchJob, search: SearchState) -> tuple[SearchState, Bool[Array, ""]]:
        descent = Descent.of(job, *given)
        search = descent.advance(search, jnp.minimum(_PASSES, most - search.iterations))
        return search, descent.goes_on(search) & (search.iterations < most)

    return jax.vmap(advance)(jobs, searches)


@compiled
def _result(jobs: SearchJob, searches: SearchState, slot: Int[Array, ""], given: _Given) -> SearchResult:
    job, search = jax.tree.map(lambda values: values[slot], (jobs, searches))
    return Descent.of(job, *given).result(search)


@compiled(donate="all-except-first")
def _put(
    new: tuple[Int[Array, ""], SearchJob, SearchState], all_: tuple[SearchJob, SearchState]
) -> tuple[SearchJob, SearchState]:
    slot, job, search = new
    return jax.tree.map(lambda values, value: values.at[slot].set(value), all_, (job, search))
