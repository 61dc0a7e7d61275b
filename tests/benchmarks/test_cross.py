"""Planners among each other's adversaries."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import platoon, scene

from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import REGENTS
from regents_cosim.benchmarks.cross import among_adversaries, cross_rows
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.planners.under_test import PlannerUnderTest

PLANNERS = ("constant_velocity", "log_replay")


@pytest.fixture(scope="module")
def found():
    """Attacks on each planner; the second window has a collision in the log."""
    windows = [platoon(seed=1), replace(scene((0, 0, 10), (20, 0, 4), (30, 3.2, 10)), id="queue")]
    return {name: list(attack(windows, REGENTS, name)) for name in PLANNERS}


@pytest.mark.slow
def test_the_ego_of_another_planner_does_not_follow_the_one_that_crashed(found):
    attacked = found[PLANNERS[0]][0]
    other = among_adversaries(attacked)
    assert np.array_equal(other.tracks.x[0], attacked.log.x[0])
    assert np.array_equal(other.tracks.x[1:], attacked.tracks.x[1:])
    assert content_hash(other.before_attack()) == content_hash(attacked.before_attack())


@pytest.mark.slow
def test_planners_crash_among_the_adversaries_that_were_found_for_them(found):
    planners = [PlannerUnderTest.of(name) for name in PLANNERS]
    rows = {(row.adversaries_of, row.planner): row for row in cross_rows(found, planners)}
    assert set(rows) == {(a, b) for a in PLANNERS for b in (*PLANNERS, "all")}
    for name in PLANNERS:
        own = rows[name, name]
        assert (own.n, own.crashes, own.windows) == (1, 1, 1), "who collides in the log is left out"
        assert rows[name, "all"].crashes == min(rows[name, other].crashes for other in PLANNERS)
