"""The order in which the searches for a candidate are made. The searches themselves find nothing here."""

from dataclasses import replace

import jax.numpy as jnp
import pytest
from shipped_cases import shipped_window

from regents_cosim.attacks.attempts import Candidate, Prepared, Searchers, attempt
from regents_cosim.attacks.job import SearchEnd, SearchJob
from regents_cosim.attacks.presets import REGENTS_FOCUSED
from regents_cosim.attacks.search_state import SearchResult
from regents_cosim.mirror.bicycle import ControlArrays, Motion

FEW = replace(REGENTS_FOCUSED, starts=3, iterations=20)


def drive(value):
    return ControlArrays(jnp.full((1, 2), value), jnp.zeros((1, 2)))


LOG, STARTS = drive(0.0), (drive(1.0), drive(2.0), drive(3.0))


def nothing(hit):
    """A search that has not found what it looks for."""
    no, motion = jnp.asarray(False), Motion(*(jnp.zeros((1, 3)) for _ in range(4)))
    return SearchResult(motion, LOG, no[None], jnp.asarray(hit), no, ~no, ~no, jnp.int32(5), jnp.zeros((20, 3)))


def made(config, starts=STARTS, crashing=()):
    """The searches for one candidate in order, each with its method, start and length."""
    searched = []

    def by(how):
        def search(jobs, most):
            searched.extend(("look" if not most else how, float(job.start.accel[0, 0])) for _, job in jobs)
            return [SearchEnd(nothing(float(job.start.accel[0, 0]) in crashing)) for _, job in jobs]

        return search

    prepared = Prepared(SearchJob(None, None, None, LOG), starts)
    candidate = Candidate(shipped_window("crossing"), lambda: prepared, len(starts))
    (ended,) = attempt([candidate], Searchers(by("descent"), by("samples")), config)
    assert not ended.accepted
    assert ended.earlier == 5 * (len(searched) - 1)
    return searched


LOOKS = [("look", 1.0), ("look", 2.0), ("look", 3.0)]


@pytest.mark.parametrize(("attempts", "sampled", "then"), [
    (3, 2, [("samples", 1.0), ("samples", 0.0), ("descent", 1.0)]),
    (2, 1, [("samples", 0.0), ("descent", 1.0)]),
    (4, 2, [("samples", 1.0), ("samples", 0.0), ("descent", 1.0), ("descent", 2.0)]),
    (1, 2, [("descent", 0.0)]),
    (2, 0, [("descent", 1.0), ("descent", 0.0)]),
])  # fmt: skip
def test_samples_come_before_descents(attempts, sampled, then):
    assert made(replace(FEW, attempts=attempts, sampled=sampled)) == LOOKS + then


def test_starts_that_crashed_the_ego_come_first():
    assert made(FEW, crashing=(3.0,)) == [*LOOKS, ("samples", 3.0), ("samples", 0.0), ("descent", 3.0)]


def test_without_starts_all_begin_with_the_log_and_none_is_made_twice():
    assert made(FEW, starts=()) == [("samples", 0.0), ("descent", 0.0)]


def test_where_nothing_can_be_sampled_one_more_descends():
    assert made(FEW.descending()) == [*LOOKS, ("descent", 1.0), ("descent", 0.0)]
