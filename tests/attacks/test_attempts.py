"""The order in which the searches for a candidate are made. The searches themselves find nothing here."""

import jax.numpy as jnp
import pytest
from shipped_cases import shipped_window

from regents_cosim.attacks.descent.search_state import SearchResult
from regents_cosim.attacks.job import BEST, Candidate, Merit, SearchEnd, SearchJob
from regents_cosim.attacks.methods.attempts import Attempts, OneDescent
from regents_cosim.attacks.methods.moves import search_in_turns
from regents_cosim.attacks.methods.presets import REGENTS_FOCUSED
from regents_cosim.mirror.bicycle import ControlArrays, Motion

FEW = REGENTS_FOCUSED.but(attempts=3, sampled=2, starts=3, iterations=20)


def drive(value):
    return ControlArrays(jnp.full((1, 2), value), jnp.zeros((1, 2)))


LOG, STARTS = drive(0.0), (drive(1.0), drive(2.0), drive(3.0))


def candidate_with(starts):
    """A candidate whose search may begin with some starts."""
    job = SearchJob(None, None, None, LOG)
    return Candidate(shipped_window("crossing"), lambda: job, lambda _: starts, len(starts))


def nothing(hit, accepted=False):
    """A search that has not found what it looks for, unless it is `accepted`."""
    no, motion = jnp.asarray(False), Motion(*(jnp.zeros((1, 3)) for _ in range(4)))
    found = jnp.asarray(accepted)
    return SearchResult(motion, LOG, no[None], jnp.asarray(hit), found, ~no, ~no, jnp.int32(5), jnp.zeros((20, 3)))


def made(config, starts=STARTS, crashing=()):
    """The searches for one candidate in order, each with its method, start and length."""
    searched = []

    def longer(candidate, start, samples):
        searched.append(("samples" if samples else "descent", value(start)))
        return OneDescent(start, config.steps.iterations)

    def value(start):
        return float(start.accel[0, 0])

    def make(asked):
        (_, _, move), *others = asked
        assert not others
        if not move.updates:
            searched.append(("look", value(move.start)))
        return [SearchEnd(nothing(value(move.start) in crashing))]

    candidate = candidate_with(starts)
    search = Attempts(candidate, longer, config.tries.starts, config.attempts_sample)
    (ended,) = search_in_turns(config, [candidate], [search], make)
    assert not ended.accepted
    assert ended.earlier == 5 * (len(searched) - 1)
    return searched


def turns(adversaries, drives=None):
    """The moves for two candidates of one window in order, the first of which crashes the ego at its second start.

    At most so many `drives` are made.
    """
    seen = []
    starts = (drive(1.0), drive(2.0)), (drive(3.0), drive(4.0))

    def make(asked):
        seen.append([float(move.start.accel[0, 0]) for _, _, move in asked])
        return [SearchEnd(nothing(hit=False, accepted=value == 2.0)) for value in seen[-1]]

    candidates = [candidate_with(some) for some in starts]
    searches = [Attempts(one, lambda *_: OneDescent(LOG, 1), 2, (False,)) for one in candidates]
    left = drives and (lambda _: drives - sum(map(len, seen)))
    ended = search_in_turns(FEW.but(adversaries=adversaries), candidates, searches, make, left)
    assert drives or [one.accepted for one in ended] == [True, False]
    return seen


def test_where_all_are_wanted_candidates_move_side_by_side():
    assert turns("all") == [[1.0, 3.0], [2.0, 4.0], [0.0]]


def test_where_one_is_enough_no_candidate_moves_after_the_first_success():
    assert turns("one") == [[1.0], [3.0], [2.0]]


@pytest.mark.parametrize(("drives", "made"), [(1, [[1.0]]), (3, [[1.0, 3.0], [2.0]]), (4, [[1.0, 3.0], [2.0, 4.0]])])
def test_no_candidate_moves_once_the_drives_are_spent(drives, made):
    assert turns("all", drives=drives) == made


LOOKS = [("look", 1.0), ("look", 2.0), ("look", 3.0)]


@pytest.mark.parametrize(("attempts", "sampled", "then"), [
    (3, 2, [("samples", 1.0), ("samples", 0.0), ("descent", 1.0)]),
    (2, 1, [("samples", 0.0), ("descent", 1.0)]),
    (4, 2, [("samples", 1.0), ("samples", 0.0), ("descent", 1.0), ("descent", 2.0)]),
    (1, 2, [("descent", 0.0)]),
    (2, 0, [("descent", 1.0), ("descent", 0.0)]),
])  # fmt: skip
def test_samples_come_before_descents(attempts, sampled, then):
    assert made(FEW.but(attempts=attempts, sampled=sampled)) == LOOKS + then


def test_a_planner_that_drives_now_and_then_is_searched_in_the_same_order():
    assert made(FEW.but(replan_every=10)) == made(FEW) == [*LOOKS, ("samples", 1.0), ("samples", 0.0), ("descent", 1.0)]


def test_starts_that_crashed_the_ego_come_first():
    assert made(FEW, crashing=(3.0,)) == [*LOOKS, ("samples", 3.0), ("samples", 0.0), ("descent", 3.0)]


def test_without_starts_all_begin_with_the_log_and_none_is_made_twice():
    assert made(FEW, starts=()) == [("samples", 0.0), ("descent", 0.0)]


MISTAKE, RARE = Merit(False, True, 0.9), Merit(True, True, 0.1)
NARROW, GOOD = Merit(True, False, 0.9), Merit(True, True, 0.5)


@pytest.mark.parametrize(
    ("merits", "looked", "taken"),
    [
        ((MISTAKE, None, None), (1.0, 2.0, 3.0), MISTAKE),  # a mistake: the others may be better, and are not
        ((MISTAKE, GOOD, BEST), (1.0, 2.0), GOOD),  # flawless, with room and usual is good enough
        ((MISTAKE, RARE, MISTAKE), (1.0, 2.0, 3.0), RARE),  # flawless, but unusual: the best of all is taken
        ((NARROW, RARE, None), (1.0, 2.0, 3.0), RARE),  # room counts more than what is usual
        ((Merit(False, True, 0.1), Merit(False, True, 0.2), None), (1.0, 2.0, 3.0), Merit(False, True, 0.2)),
    ],
)
def test_the_looks_go_on_up_to_a_flawless_crash_with_room_by_a_usual_adversary_and_the_best_is_taken(
    merits, looked, taken
):
    seen = []

    def make(asked):
        [value] = [float(move.start.accel[0, 0]) for _, _, move in asked]
        merit = merits[len(seen)]
        seen.append(value)
        return [SearchEnd(nothing(True, accepted=merit is not None), merit=merit or BEST)]

    candidate = candidate_with(STARTS)
    search = Attempts(candidate, lambda *_: OneDescent(LOG, 1), 3, (False,))
    (ended,) = search_in_turns(FEW, [candidate], [search], make)
    assert tuple(seen) == looked
    assert (ended.accepted, ended.merit, ended.looks) == (True, taken, len(looked))
