"""Several descents for a candidate that was not brought to collide as wanted, from another start each."""

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from regents_cosim.attacks.descent import Found
from regents_cosim.attacks.job import Ended, Job
from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.errors import DriveError
from regents_cosim.mirror.bicycle import Controls
from regents_cosim.scenario import Scenario

Search = Callable[[Sequence[tuple[Scenario, Job]]], list[Ended]]


class Attempts(NamedTuple):
    """A job, and the actions [mover step] that its attempts begin with; None: the logged ones."""

    job: Job
    starts: tuple[Controls | None, ...]


def attempt(jobs: Sequence[tuple[Scenario, Attempts]], search: Search, config: AttackConfig) -> list[Ended | None]:
    """How the `jobs` ended, each at its first accepted collision or its last attempt.

    Where one adversary is enough, a
    scenario's jobs have their turns one after the other, and after the first that succeeds none is made: those are
    None.
    """
    ended: list[Ended | None] = [None] * len(jobs)
    for rank in range(max((len(one.starts) for _, one in jobs), default=0)):
        for turn in _turns(jobs, config):
            over = {id(jobs[index][0]) for index in _settled(ended)} if config.adversaries == "one" else ()
            tried = [
                index
                for index in turn
                if rank < len(jobs[index][1].starts) and id(jobs[index][0]) not in over and _may_try(ended[index])
            ]
            begun = [(scenario, one.job._replace(start=one.starts[rank])) for scenario, one in (jobs[i] for i in tried)]
            for index, new in zip(tried, search(begun) if begun else [], strict=True):
                ended[index] = _after(ended[index], new)
    return ended


def _turns(jobs: Sequence[tuple[Scenario, Attempts]], config: AttackConfig) -> list[list[int]]:
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


def _may_try(ended: Ended | None) -> bool:
    """Whether a job's last attempt, if there was one, leaves something to look for."""
    if ended is None:
        return True
    found = ended.found
    return isinstance(found, Found) and not found.accepted and bool(found.any_candidate)


def _after(old: Ended | None, new: Ended) -> Ended:
    """The new one, with the cost of both."""
    if old is None:
        return new
    assert isinstance(old.found, Found)
    return replace(new, seconds=old.seconds + new.seconds, earlier=old.earlier + int(old.found.iterations))
