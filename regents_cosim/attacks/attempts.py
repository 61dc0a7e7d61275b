"""Several descents for a candidate that was not brought to collide as wanted, from another timing each."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import jax
import jax.numpy as jnp

from regents_cosim.attacks.descent import Found
from regents_cosim.attacks.job import Ended, Job
from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.attacks.timings import retimed
from regents_cosim.scenario import Scenario

Search = Callable[[Sequence[tuple[Scenario, Job]]], list[Ended]]


def attempt(jobs: Sequence[tuple[Scenario, Job]], search: Search, config: AttackConfig) -> list[Ended]:
    """How the `jobs` ended, each at its first accepted collision or its last attempt."""
    ended = search(jobs)
    for earlier in range(config.attempts - 1):
        again = [index for index, one in enumerate(ended) if _may_try_again(jobs[index][1], one)]
        others = [
            (jobs[index][0], _at_another_time(jobs[index][1], ended[index].found, config, earlier)) for index in again
        ]
        for index, new in zip(again, search(others) if others else [], strict=True):
            ended[index] = _after(ended[index], new)
    return ended


def _may_try_again(job: Job, ended: Ended) -> bool:
    found = ended.found
    alone = job.start is not None  # a search over several candidates has no timing of its own
    return alone and isinstance(found, Found) and not found.accepted and bool(found.any_candidate)


def _at_another_time(job: Job, found: object, config: AttackConfig, rank: int) -> Job:
    assert isinstance(found, Found)
    ego = jax.tree.map(lambda values: values[0], found.motion)
    return job._replace(start=retimed(job.world, ego, job.movers, config, jnp.int32(rank)))


def _after(old: Ended, new: Ended) -> Ended:
    """The new one, with the cost of both."""
    assert isinstance(old.found, Found)
    return replace(new, seconds=old.seconds + new.seconds, earlier=old.earlier + int(old.found.iterations))
