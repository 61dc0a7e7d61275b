"""The attempts on a candidate: a look at every start, then longer searches from some of the starts.

A look is one roll-out with the planner, without an update. A start that already makes the ego crash as wanted needs no
search. Of the longer searches the first, if the configuration says so, sample changes of the drive, the others descend
along the gradient. The gradient leads to the nearest crash; where that is not the wanted one, samples find others, with
fewer roll-outs, so they come first.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

from regents_cosim.attacks.job import SearchEnd, SearchJob
from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.attacks.search_state import SearchResult
from regents_cosim.errors import DriveError
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.scenario import Scenario

# Runs searches with at most that many updates; 0 is a look at their starts.
RunSearches = Callable[[Sequence[tuple[Scenario, SearchJob]], int], list[SearchEnd]]


class Searchers(NamedTuple):
    """The functions that search for a candidate."""

    descend: RunSearches
    sample: RunSearches  # for the first attempts (`AttackConfig.sampled`)


class Prepared(NamedTuple):
    """The data that a search needs about a candidate."""

    job: SearchJob  # begins with the log
    starts: tuple[ControlArrays, ...] = ()  # actions [searched step] to begin with instead, the most promising first


@dataclass(frozen=True, eq=False)
class Candidate:
    """The searches for one candidate, or for all candidates together.

    It is prepared when its turn comes; where one adversary is enough, many candidates never have a turn.
    """

    scenario: Scenario
    prepare: Callable[[], Prepared]
    looks: int = 0  # number of its starts
    kinds: frozenset[str] = frozenset()  # wanted kinds of crash to which its starts lead

    @cached_property
    def _prepared(self) -> Prepared:
        return self.prepare()

    @property
    def job(self) -> SearchJob:
        """The search that begins with the log."""
        return self._prepared.job

    @property
    def starts(self) -> tuple[ControlArrays, ...]:
        """The actions with which a search may begin instead."""
        return self._prepared.starts


class _Candidates:
    """Several candidates, and how the searches for each have ended so far."""

    def __init__(self, candidates: Sequence[Candidate], searchers: Searchers, config: AttackConfig) -> None:
        self._all, self._searchers, self._config = candidates, searchers, config
        self._near: dict[int, list[ControlArrays]] = defaultdict(list)  # starts that crashed the ego, but not as wanted
        self.ended: list[SearchEnd | None] = [None] * len(candidates)

    def look(self, rank: int, some: list[int]) -> None:
        """Look at the start number `rank` of some candidates."""
        some = [index for index in some if rank < self._all[index].looks]
        begun = {index: self._all[index].starts[rank] for index in some}
        for index, seen in self._searched(self._searchers.descend, begun, 0):
            self._after(index, seen)
            if isinstance(seen.found, SearchResult) and bool(seen.found.hit):
                self._near[index].append(self._all[index].starts[rank])

    def search(self, rank: int, some: list[int]) -> None:
        """Make the longer search number `rank` for some candidates."""
        planned = {index: longer[rank] for index in some if rank < len(longer := self._longer(index))}
        for sampled, search in ((False, self._searchers.descend), (True, self._searchers.sample)):
            begun = {index: start for index, (samples, start) in planned.items() if samples == sampled}
            for index, ended in self._searched(search, begun, self._config.iterations):
                self._after(index, ended)

    def unsettled(self) -> list[list[int]]:
        """The unfinished candidates, in groups that have their turns one after the other.

        Where one adversary is enough, the candidates of a scenario are in different groups.
        """
        left = [index for index in range(len(self._all)) if self._may_try(index)]
        if self._config.adversaries == "all":
            return [left] if left else []
        turns: dict[int, list[int]] = defaultdict(list)
        before: dict[int, int] = defaultdict(int)
        for index, one in enumerate(self._all):
            if index in left:
                turns[before[id(one.scenario)]].append(index)
            before[id(one.scenario)] += 1
        return [turns[turn] for turn in sorted(turns)]

    def still_wanted(self, some: list[int]) -> list[int]:
        """Those of the candidates whose scenario has no accepted crash from another candidate."""
        if self._config.adversaries == "all":
            return some
        over = {id(self._all[index].scenario) for index in range(len(self._all)) if self._is_settled(index)}
        return [index for index in some if id(self._all[index].scenario) not in over]

    def _longer(self, index: int) -> list[tuple[bool, ControlArrays | None]]:
        """The longer searches of a candidate, each with whether it samples, and what it begins with.

        Starts that crashed the ego come first. The last search that samples, or the last descent if none samples,
        begins with the log; so does the only descent if there are no starts.
        """
        one, near, config = self._all[index], self._near[index], self._config
        starts = [*near, *(start for start in one.starts if not any(start is other for other in near))]
        if not config.samples:
            return [(False, start) for start in (*starts[: config.descents - 1], one.job.start)]
        samples = [(True, start) for start in (*starts[: config.samples - 1], one.job.start)]
        return [*samples, *((False, start) for start in starts[: config.descents] or [one.job.start])]

    def _searched(
        self, search: RunSearches, begun: Mapping[int, ControlArrays | None], iterations: int
    ) -> Iterator[tuple[int, SearchEnd]]:
        chosen = [self._all[index] for index in begun]
        jobs = [
            (one.scenario, one.job._replace(start=start)) for one, start in zip(chosen, begun.values(), strict=True)
        ]
        yield from zip(begun, search(jobs, iterations) if jobs else [], strict=True)

    def _after(self, index: int, new: SearchEnd) -> None:
        """Store a new end of a candidate, with the costs of all ends before it."""
        old = self.ended[index]
        if old is not None:
            assert isinstance(old.found, SearchResult)
            earlier = old.earlier + int(old.found.iterations)
            new = replace(new, seconds=old.seconds + new.seconds, earlier=earlier, looks=old.looks + new.looks)
        self.ended[index] = new

    def _is_settled(self, index: int) -> bool:
        ended = self.ended[index]
        return ended is not None and (isinstance(ended.found, DriveError) or ended.accepted)

    def _may_try(self, index: int) -> bool:
        ended = self.ended[index]
        if ended is None:
            return True
        return not self._is_settled(index) and isinstance(ended.found, SearchResult) and bool(ended.found.any_candidate)


def attempt(candidates: Sequence[Candidate], searchers: Searchers, config: AttackConfig) -> list[SearchEnd | None]:
    """How the searches for each candidate ended, at the first accepted collision or the last attempt.

    Where one adversary is enough, a scenario's candidates have their turns one after the other; those after the first
    success are not searched, and give None.
    """
    found = _Candidates(candidates, searchers, config)
    looks = max((one.looks for one in candidates), default=0)
    for make, ranks in ((found.look, looks), (found.search, config.attempts)):
        for rank in range(ranks):
            for turn in found.unsettled():
                make(rank, found.still_wanted(turn))
    return found.ended
