"""Give the searches for several candidates their turns, side by side or one after the other."""

from collections.abc import Sequence

from regents_cosim.attacks.job import Candidate, SearchEnd
from regents_cosim.attacks.methods.moves import MakeMoves, Search


def search_in_turns(
    candidates: Sequence[Candidate], searches: Sequence[Search], make: MakeMoves, one_is_enough: bool
) -> list[SearchEnd | None]:
    """How the search for each candidate ended; None for those that never had a turn.

    Moves of the least rank are made side by side. Where one adversary is enough, a scenario's candidates have their
    turns one after the other, and none after the first success.
    """
    while waiting := _waiting(candidates, searches, one_is_enough):
        least = min(searches[index].rank for index in waiting)
        turn = [index for index in waiting if searches[index].rank == least]
        if one_is_enough:
            turn = list({id(candidates[index].scenario): index for index in reversed(turn)}.values())[::-1]
        asked = [(candidates[index].scenario, candidates[index].job, searches[index].propose()) for index in turn]
        for index, seen in zip(turn, make(asked), strict=True):
            searches[index].advance(seen)
    return [search.result() for search in searches]


def _waiting(candidates: Sequence[Candidate], searches: Sequence[Search], one_is_enough: bool) -> list[int]:
    """The candidates whose search goes on."""
    left = [index for index, search in enumerate(searches) if not search.finished]
    if not one_is_enough:
        return left
    ended = ((one, search.result()) for one, search in zip(candidates, searches, strict=True) if search.finished)
    over = {id(one.scenario) for one, end in ended if end is not None and (end.accepted or end.failed)}
    return [index for index in left if id(candidates[index].scenario) not in over]
