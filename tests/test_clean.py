from dataclasses import replace

import numpy as np
import pytest
from scenes import crash, scene

from regents_cosim.evaluation.statistics import mcnemar, wilson
from regents_cosim.scenario import AttackRecord, Overlap
from regents_cosim.verdicts.clean import cleanness


def crashed(*cars, attributed=True, drift=0.0, **changes):
    """Cars that go straight on, the second drifting sideways, as if an attack had made them."""
    made = scene(*cars, **changes)
    y = np.array(made.tracks.y)
    y[1] += drift * np.linspace(0, 1, 81) ** 2
    return crash(made, replace(made.tracks, y=y), attributed)


def test_a_cut_in_is_clean():
    found = cleanness(crashed((0, 0, 10), (8, 3.2, 9), drift=-3.2))
    assert found.clean


def test_a_crash_that_the_attack_did_not_cause():
    found = cleanness(crashed((0, 0, 10), (8, 3.2, 9), drift=-3.2, attributed=False))
    assert not found.attributed
    assert not found.clean


def test_an_adversary_that_was_off_the_road():
    found = cleanness(crashed((0, 0, 10), (22, 0, 7.5), drift=-1.7))
    assert found.off_road
    assert not found.clean
    assert not cleanness(crashed((0, 0, 10), (22, 0, 7.5), drift=-0.5)).off_road


def test_an_adversary_that_hits_somebody_else_first():
    cars = ((0, 0, 10), (20, 0, 7.5), (19, 0, 6.9))
    assert cleanness(crashed(*cars[:2], (26, 0, 6.9))).hits_others
    overlapping = (Overlap(("car01", "car02"), 0, 80),)
    assert not cleanness(crashed(*cars[:2], (26, 0, 6.9), overlaps=overlapping)).hits_others


def test_an_adversary_that_runs_into_the_back_of_the_ego():
    assert cleanness(crashed((20, 0, 5), (0, 0, 10))).rear_ends_ego


def test_a_standing_ego():
    found = cleanness(crashed((40, 0, 0.1), (20, 3.2, 6), drift=-8.0))
    assert found.ego_stands
    assert not found.clean


def test_no_crash_has_no_flaws():
    made = scene((0, 0, 10), (50, 0, 10))
    record = AttackRecord(made.id, "king", "idm", "no_collision", 3)
    assert cleanness(replace(made, attack=record, original=made.tracks)) is None
    assert cleanness(made) is None


@pytest.mark.parametrize(
    ("successes", "n", "low", "high"), [(0, 10, 0.0, 0.2775), (10, 10, 0.7225, 1.0), (90, 149, 0.5238, 0.6790)]
)
def test_wilsons_interval(successes, n, low, high):
    assert wilson(successes, n) == pytest.approx((low, high), abs=1e-4)
    assert wilson(0, 0) == (0.0, 1.0)


def test_mcnemar_asks_only_the_trials_that_differ():
    assert mcnemar([True] * 5 + [False] * 5, [True] * 5 + [False] * 5) == 1.0
    assert mcnemar([True] * 6 + [False] * 9, [False] * 15) == pytest.approx(2 * 0.5**6)
    first, second = [True] * 8 + [False] * 2 + [True] * 90, [False] * 8 + [True] * 2 + [True] * 90
    assert mcnemar(first, second) == mcnemar(second, first) == pytest.approx(112 / 1024)
