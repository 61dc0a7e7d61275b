"""The interface of a search: it proposes moves one after the other, and learns what each of them led to.

A move is what the compiled program, a batch of an accelerator or the process of a planner does at once.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import NamedTuple

from regents_cosim.attacks.job import SearchEnd, SearchJob
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.scenario import Scenario


class Descend(NamedTuple):
    """Look at a drive, then update it along the gradient until it is accepted or the updates are spent."""

    start: ControlArrays | None  # [searched step] actions; None: the logged ones
    updates: int = 0  # at most; 0: a mere look
    every_hit: bool = False  # whether every crash is judged, not only one that the device accepts


class LookAt(NamedTuple):
    """Look at the first `number` of some drives, up to one that is accepted."""

    drives: ControlArrays  # [LOOKED_AT searched step] actions
    number: int


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
