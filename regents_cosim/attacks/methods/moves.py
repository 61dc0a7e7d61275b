"""The interface of a search: it proposes moves one after the other, and learns what each of them led to.

A move is what the compiled program, a batch of an accelerator or the process of a planner does at once.
"""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Sequence
from typing import NamedTuple

from regents_cosim.attacks.job import Candidate, SearchEnd, SearchJob
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.scenario import Scenario


class Descend(NamedTuple):
    """Look at a drive, then update it along the gradient until it is accepted or the updates are spent."""

    start: ControlArrays | None  # [searched step] actions; None: the logged ones
    updates: int = 0  # at most; 0: a mere look
    every_hit: bool = False  # whether every crash is judged, not only one that the device accepts


class LookAt(NamedTuple):
    """Look at the first `number` of some drives, up to one that is accepted.

    A planner that is dear to ask drives only where an estimate promises the crash, or a cost well below `least`.
    """

    drives: ControlArrays  # [LOOKED_AT searched step] actions
    number: int
    least: float = float("inf")  # cost of the best drive that it has made


Move = Descend | LookAt
# Makes moves, each with its scenario and the job of its candidate, and says how each has ended.
MakeMoves = Callable[[Sequence[tuple[Scenario, SearchJob, Move]]], list[SearchEnd]]


class Search(ABC):
    """The search for one candidate.

    It is over once it is `finished`; then `result` says how it ended.
    """

    @property
    def rank(self) -> int:
        """The turn of the next move: of several candidates, those of the least rank move first."""
        return 0

    @abstractmethod
    def propose(self) -> Move:
        """Propose the next move. It is called once for every move."""

    @abstractmethod
    def advance(self, seen: SearchEnd) -> None:
        """Learn what the last move led to: `seen.accepted` says that it is the wanted crash."""

    @property
    @abstractmethod
    def finished(self) -> bool:
        """Whether no move is left."""

    @abstractmethod
    def result(self) -> SearchEnd | None:
        """How the search has ended so far; None before its first move."""


def complete(search: Search, scenario: Scenario, job: SearchJob, make: MakeMoves) -> SearchEnd:
    """Make all moves of one search."""
    while not search.finished:
        (seen,) = make([(scenario, job, search.propose())])
        search.advance(seen)
    ended = search.result()
    assert ended is not None
    return ended


def search_in_turns(
    candidates: Sequence[Candidate],
    searches: Sequence[Search],
    make: MakeMoves,
    one_is_enough: bool,
    left: Callable[[Scenario], int] | None = None,
) -> list[SearchEnd | None]:
    """How the search for each candidate ended; None for those that never had a turn.

    Moves of the least rank are made side by side. Where one adversary is enough, a scenario's candidates have their
    turns one after the other, and none after the first success. `left` says how many drives of the planner may still be
    made in a scenario: no more moves are made at once, and none without any.
    """
    while waiting := _waiting(candidates, searches, one_is_enough, left):
        least = min(searches[index].rank for index in waiting)
        turn = [index for index in waiting if searches[index].rank == least]
        if one_is_enough:
            turn = list({id(candidates[index].scenario): index for index in reversed(turn)}.values())[::-1]
        if left is not None:
            turn = _affordable(candidates, turn, left)
        asked = [(candidates[index].scenario, candidates[index].job, searches[index].propose()) for index in turn]
        for index, seen in zip(turn, make(asked), strict=True):
            searches[index].advance(seen)
    return [search.result() for search in searches]


def _affordable(candidates: Sequence[Candidate], turn: Sequence[int], left: Callable[[Scenario], int]) -> list[int]:
    """The first of a turn, at most as many of each scenario as it has drives left."""
    so_far: Counter[int] = Counter()
    found = []
    for index in turn:
        scenario = candidates[index].scenario
        so_far[id(scenario)] += 1
        if so_far[id(scenario)] <= left(scenario):
            found.append(index)
    return found


def _waiting(
    candidates: Sequence[Candidate],
    searches: Sequence[Search],
    one_is_enough: bool,
    left: Callable[[Scenario], int] | None,
) -> list[int]:
    """The candidates whose search goes on."""
    going = [index for index, search in enumerate(searches) if not search.finished]
    if left is not None:
        going = [index for index in going if left(candidates[index].scenario)]
    if not one_is_enough:
        return going
    ended = ((one, search.result()) for one, search in zip(candidates, searches, strict=True) if search.finished)
    over = {id(one.scenario) for one, end in ended if end is not None and (end.accepted or end.failed)}
    return [index for index in going if id(candidates[index].scenario) not in over]
