"""Planners with numbers given in their name."""

import pytest

from regents_cosim.errors import PlannerError
from regents_cosim.planners.idm import IDM
from regents_cosim.planners.names import WITH_SETTINGS, is_built_in
from regents_cosim.planners.under_test import PlannerUnderTest


def test_a_name_sets_numbers():
    found = PlannerUnderTest.of("idm:time_headway=0.2,max_accel=1.5").loop
    assert isinstance(found, IDM)
    assert (found.time_headway, found.max_accel, found.standstill_gap) == (0.2, 1.5, IDM().standstill_gap)


@pytest.mark.parametrize(
    "name", ["idm:", "idm:headway=1", "idm:time_headway", "idm:time_headway=nan", "idm:time_headway=-1"]
)
def test_what_it_does_not_have_is_refused_in_one_line(name):
    with pytest.raises(PlannerError, match="expected") as refused:
        PlannerUnderTest.of(name)
    assert str(refused.value).count("\n") == 0


def test_a_planner_without_settings_says_so():
    with pytest.raises(PlannerError, match="'careful:headway=1': careful has no settings, expected careful alone"):
        PlannerUnderTest.of("careful:headway=1")


@pytest.mark.parametrize("name", WITH_SETTINGS)
def test_each_with_settings_lists_them_where_one_is_unknown(name):
    with pytest.raises(
        PlannerError, match=f"{name} has no setting 'nothing', expected {name}:SETTING=NUMBER with one of "
    ):
        PlannerUnderTest.of(f"{name}:nothing=1")


def test_a_case_may_name_it():
    assert is_built_in("idm:time_headway=0.2")
    assert not is_built_in("idm.py:IDM")
