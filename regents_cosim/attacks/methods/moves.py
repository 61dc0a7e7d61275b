"""The interface of a search: it proposes moves one after the other, and learns what each of them led to.

A move is what the compiled program, a batch of an accelerator or the process of a planner does at once.
"""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import NamedTuple

import jax
import numpy as np

from regents_cosim.attacks.descent.actions import held_to_limits
from regents_cosim.attacks.descent.search import LOOKED_AT
from regents_cosim.attacks.job import Candidate, SearchEnd, SearchJob
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.errors import RegentsError
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.programs.on_device import on_device
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.foreign_code import foreign_code, said_by
from regents_cosim.system.user_code import line_beside


class Descend(NamedTuple):
    """Look at a drive, then update it along the gradient until it is accepted or the updates are spent."""

    start: ControlArrays | None  # [searched step] shares of the mirror's limits; None: the logged ones
    updates: int = 0  # at most; 0: a mere look
    every_hit: bool = False  # whether every crash is judged, not only one that the device accepts


class LookAt(NamedTuple):
    """Look at the first `number` of some drives, up to one that is accepted.

    A planner that is dear to ask drives only where an estimate promises the crash, or a cost well below `least`.
    """

    drives: ControlArrays  # [LOOKED_AT searched step] shares of the mirror's limits: `in_one_look` of some drives
    number: int
    least: float = float("inf")  # cost of the best drive that it has made


Move = Descend | LookAt
Asked = tuple[Scenario, SearchJob, Move]  # a move, with its scenario and the job of its candidate
MakeMoves = Callable[[Sequence[Asked]], list[SearchEnd]]  # makes moves, and says how each has ended


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


def begun(method: AttackConfig, candidate: Candidate) -> Search:
    """The search that a method begins. Raises RegentsError where that is none."""
    with guarded(method):
        found: object = method.begin(candidate)
    if not isinstance(found, Search):
        raise RegentsError(f"method {method.method}: begin() returns {type(found).__name__}, expected a Search")
    return found


def guarded(method: AttackConfig) -> AbstractContextManager[None]:
    """A block that calls a method, its searches or its sampler; what those of a user raise is an error in one line."""
    if _is_ours(method):
        return nullcontext()

    def failed(error: BaseException) -> RegentsError:
        return RegentsError(f"method {method.method} failed: {said_by(error)}{line_beside(error, type(method))}")

    return foreign_code(failed)


def _is_ours(method: AttackConfig) -> bool:
    return type(method).__module__ == AttackConfig.__module__


def _proposed(method: AttackConfig, candidate: Candidate, search: Search) -> Move:
    """The next move of a search; the drives of a user's method are held to its limits. Raises RegentsError."""
    move: object = search.propose()
    said = f"method {method.method}: {type(search).__name__}.propose() returns {type(move).__name__}"
    if not isinstance(move, Descend | LookAt):
        raise RegentsError(f"{said}, expected Descend or LookAt")
    name = move._fields[0]
    drives: object = getattr(move, name)
    if _is_ours(method) or drives is None:
        return move
    searched, world = candidate.job.searched, candidate.job.world
    one = searched.count, world.controls.accel.shape[1]
    shape = (LOOKED_AT, *one) if isinstance(move, LookAt) else one
    if not isinstance(drives, ControlArrays) or {np.shape(drives.accel), np.shape(drives.curvature)} != {shape}:
        raise RegentsError(f"{said} with wrong {name}, expected ControlArrays of {list(shape)} numbers each")
    given = jax.tree.map(lambda values: on_device(np.reshape(values, (-1, *one)), np.float32), drives)
    held = held_to_limits(given, world, searched, method.compiled())
    return move._replace(**{name: jax.tree.map(lambda values: values.reshape(shape), held)})


def search_in_turns(
    method: AttackConfig,
    candidates: Sequence[Candidate],
    searches: Sequence[Search],
    make: MakeMoves,
    left: Callable[[Scenario], int] | None = None,
) -> list[SearchEnd | None]:
    """How a method's search for each candidate ended; None for those that never had a turn.

    Moves of the least rank are made side by side. Where one adversary is enough, a scenario's candidates have their
    turns one after the other, and none after the first success. `left` says how many drives of the planner may still be
    made in a scenario: no more moves are made at once, and none without any.
    """
    one_is_enough = method.candidates.adversaries == "one"
    turn, seen = list[int](), list[SearchEnd]()
    while True:
        with guarded(method):
            for index, one in zip(turn, seen, strict=True):
                searches[index].advance(one)
            turn = _turn(candidates, searches, one_is_enough, left)
            if not turn:
                return [search.result() for search in searches]
            moves = [(candidates[index], _proposed(method, candidates[index], searches[index])) for index in turn]
        seen = make([(candidate.scenario, candidate.job, move) for candidate, move in moves])


def _turn(
    candidates: Sequence[Candidate],
    searches: Sequence[Search],
    one_is_enough: bool,
    left: Callable[[Scenario], int] | None,
) -> list[int]:
    """The candidates whose searches move next; none where all are over."""
    waiting = [index for index, search in enumerate(searches) if not search.finished]
    if one_is_enough:
        ended = ((one, search.result()) for one, search in zip(candidates, searches, strict=True) if search.finished)
        over = {id(one.scenario) for one, end in ended if end is not None and (end.accepted or end.failed)}
        waiting = [index for index in waiting if id(candidates[index].scenario) not in over]
    if left is not None:
        waiting = [index for index in waiting if left(candidates[index].scenario)]
    if not waiting:
        return []
    least = min(searches[index].rank for index in waiting)
    turn = [index for index in waiting if searches[index].rank == least]
    if one_is_enough:
        turn = list({id(candidates[index].scenario): index for index in reversed(turn)}.values())[::-1]
    return turn if left is None else _affordable(candidates, turn, left)


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
