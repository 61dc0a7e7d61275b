"""IDM with parameters given in its name."""

import pytest

from regents_cosim.errors import PlannerError
from regents_cosim.planners.idm import IDM
from regents_cosim.planners.names import is_built_in
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


def test_a_case_may_name_it():
    assert is_built_in("idm:time_headway=0.2")
    assert not is_built_in("idm.py:IDM")
