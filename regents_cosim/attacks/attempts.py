"""Several descents for a candidate that was not brought to collide as wanted, from another timing each."""

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace

import jax
import jax.numpy as jnp

from regents_cosim.attacks.descent import Found
from regents_cosim.attacks.job import Ended, Job
from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.attacks.timings import retimed
from regents_cosim.errors import DriveError
from regents_cosim.scenario import Scenario

Search = Callable[[Sequence[tuple[Scenario, Job]]], list[Ended]]


def attempt(jobs: Sequence[tuple[Scenario, Job]], search: Search, config: AttackConfig) -> list[Ended | None]:
    """How the `jobs` ended, each at its first accepted collision or its last attempt.

    Where one adversary is enough, a scenario's jobs have their turns one after the other, and after the first that
    succeeds none is made: those are None.
    """
    ended: list[Ended | None] = [None] * len(jobs)
    for rank in range(config.attempts):
        for turn in _turns(jobs, config):
            over = {id(jobs[index][0]) for index in _settled(ended)} if config.adversaries == "one" else ()
            tried = [i for i in turn if id(jobs[i][0]) not in over and (rank == 0 or _may_try_again(jobs[i], ended[i]))]
            begun = [_begun(jobs[index], ended[index], config, rank) for index in tried]
            for index, new in zip(tried, search(begun) if begun else [], strict=True):
                ended[index] = _after(ended[index], new)
    return ended


def _turns(jobs: Sequence[tuple[Scenario, Job]], config: AttackConfig) -> list[list[int]]:
    """The indices of the jobs, together or of every scenario the first, the second, and so on."""
    if config.adversaries == "all":
        return [list(range(len(jobs)))]
    turns: dict[int, list[int]] = defaultdict(list)
    before = Counter[int]()
    for index, (scenario, _) in enumerate(jobs):
        turns[before[id(scenario)]].append(index)
        before[id(scenario)] += 1
    return list(turns.values())


def _settled(ended: Sequence[Ended | None]) -> list[int]:
    """Jobs after which there is nothing to look for: they succeeded, or the planner failed."""
    return [i for i, one in enumerate(ended) if one and (isinstance(one.found, DriveError) or one.accepted)]


def _may_try_again(job: tuple[Scenario, Job], ended: Ended | None) -> bool:
    found = ended.found if ended else None
    alone = job[1].start is not None  # a search over several candidates has no timing of its own
    return alone and isinstance(found, Found) and not found.accepted and bool(found.any_candidate)


def _begun(job: tuple[Scenario, Job], earlier: Ended | None, config: AttackConfig, rank: int) -> tuple[Scenario, Job]:
    """The job as it is at first, later from another timing."""
    if earlier is None:
        return job
    found, (scenario, mine) = earlier.found, job
    assert isinstance(found, Found)
    ego = jax.tree.map(lambda values: values[0], found.motion)
    start = retimed(mine.world, ego, mine.movers, config, jnp.int32(rank - 1))
    return scenario, mine._replace(start=start)


def _after(old: Ended | None, new: Ended) -> Ended:
    """The new one, with the cost of both."""
    if old is None:
        return new
    assert isinstance(old.found, Found)
    return replace(new, seconds=old.seconds + new.seconds, earlier=old.earlier + int(old.found.iterations))
