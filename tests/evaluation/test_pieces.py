"""Parts of cases: what a shorter or emptier case says of time, lights, overlaps and people."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import scene

from regents_cosim.attack_record import AttackRecord
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.evaluation.reduction.shrink import cut, without
from regents_cosim.scenario import Overlap, Signal

MADE = scene(
    (0, 0, 10),
    (20, 3.2, 9),
    (40, 0, 10),
    signals=(Signal("light", ((0, "r"), (30, "g"), (60, "y"))),),
    overlaps=(Overlap(("car01", "car02"), 10, 20), Overlap(("car01", "car02"), 50, 70)),
)
ATTACKED = replace(
    MADE,
    attack=AttackRecord("scene", "regents", "idm", "no_collision", 5, candidates=("car01", "car02")),
    log=MADE.tracks,
)


@settings(max_examples=40)
@given(begin=st.integers(0, 60), steps=st.integers(1, 20))
def test_every_step_shows_what_it_showed(begin, steps):
    part = cut(MADE, begin, begin + steps)
    assert part.tracks.steps == steps + 1
    assert np.array_equal(part.tracks.x, MADE.tracks.x[:, begin : begin + steps + 1])
    assert part.provenance.begin_s == pytest.approx(MADE.provenance.begin_s + 0.1 * begin)
    for step in range(steps + 1):
        assert part.signals[0].letters(step) == MADE.signals[0].letters(begin + step)
        overlapping = any(pair.first_step <= step <= pair.last_step for pair in part.overlaps)
        assert overlapping == any(p.first_step <= begin + step <= p.last_step for p in MADE.overlaps)


def test_all_steps_are_the_case_itself():
    assert content_hash(cut(MADE, 0, 80)) == content_hash(MADE)


def test_whoever_is_not_there_in_the_window_is_left_out():
    valid = np.array(MADE.tracks.valid)
    valid[1, 20:] = False
    late = replace(MADE, tracks=replace(MADE.tracks, valid=valid))
    assert [agent.id for agent in cut(late, 10, 30).agents] == ["car00", "car01", "car02"]
    assert [agent.id for agent in cut(late, 30, 50).agents] == ["car00", "car02"]


def test_nothing_speaks_of_an_agent_that_was_left_out():
    part = without(ATTACKED, ["car01"])
    assert [agent.id for agent in part.agents] == ["car00", "car02"]
    assert part.overlaps == ()
    assert part.attack.candidates == ("car02",)
    assert np.array_equal(part.log.x, MADE.tracks.x[[0, 2]])
