"""Searches that go on after the first crash: when they can, and what they spend."""

from dataclasses import replace

import pytest
from shipped_cases import shipped_window

from regents_cosim.attacks.methods.presets import METHODS, REGENTS_FOCUSED
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.runs.archive.axes import Axes
from regents_cosim.runs.archive.crash import crash_of
from regents_cosim.runs.archive.illumination import illuminate_each, obstacle

IDM = PlannerUnderTest.of("idm")


@pytest.mark.parametrize(
    ("config", "planner", "said"),
    [
        (REGENTS_FOCUSED, IDM, ""),
        (REGENTS_FOCUSED, replace(IDM, loop=None), "planner 'idm' is not in JAX"),
        (METHODS["king"], IDM, "king searches for all candidates at once"),
        (METHODS["random"], IDM, "random ends at its first crash"),
        (REGENTS_FOCUSED.but(replan_every=5), IDM, "`replan_every`"),
    ],
)
def test_what_keeps_a_search_from_going_on_is_said(config, planner, said):
    found = obstacle(config, planner)
    assert said in found
    assert bool(said) == bool(found)


@pytest.mark.slow
def test_they_spend_what_they_are_given_and_find_one_crash_of_each_cell():
    before, axes = shipped_window("crossing"), Axes()
    (results,), (again,) = (illuminate_each([(before, 132)], REGENTS_FOCUSED, IDM, axes) for _ in range(2))
    assert [case.id for case in results] == [case.id for case in again]
    assert all(132 - 13 < case.attack.rollouts <= 132 for case in results)
    crashes = [crash for case in results if (crash := crash_of(case))]
    assert len({case.id for case in results}) == len(results) > 0
    assert len({axes.cell(crash) for crash in crashes}) == len(crashes)
