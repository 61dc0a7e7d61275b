"""A planner that leaves, by `SystemExit`, `os._exit` or an interrupt of its own, costs its case alone."""

from dataclasses import replace

import pytest
from leaving_planners import CALLED_BACK, HOWS, MAKING, ON_HOST, PLANNERS, SAID, TRACED
from params import slow
from places import SUPPORT
from scenes import scene

from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import REGENTS
from regents_cosim.errors import PlannerError
from regents_cosim.evaluation.drives.driving import drive_each
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.system.user_code import import_named

FILE = SUPPORT / "leaving_planners.py"
BUSY = scene((0, 0, 10), (20, 3.2, 8), (30, 3.2, 9), steps=30)
CASES = [replace(BUSY, id=name) for name in ("good", "bad", "fine")]
QUICK = REGENTS.but(iterations=2)


def named(how, place):
    return f"{FILE}:{how}_in_{place}"


def check_errors(errors, how):
    good, bad, fine = errors
    assert not good
    assert not fine
    assert SAID[how] in bad


@pytest.mark.parametrize("how", HOWS)
def test_at_import(how, tmp_path):
    (tmp_path / "leaves.py").write_text(f"from leaving_planners import HOWS\nHOWS[{how!r}]()\n")
    with pytest.raises(PlannerError, match=f"cannot be imported: {SAID[how]}"):
        import_named(f"{tmp_path}/leaves.py", "planner")


@pytest.mark.parametrize("how", HOWS)
@pytest.mark.parametrize("place", MAKING)
def test_when_it_is_made(how, place):
    """The planner leaves while it is made, given by name or as an object of the caller."""
    if place != "construction":  # a class is made where it drives
        with pytest.raises(PlannerError, match=SAID[how]):
            PlannerUnderTest.of(named(how, place))
    with pytest.raises(PlannerError, match=SAID[how]):
        PlannerUnderTest.of(PLANNERS[f"{how}_in_{place}"], own_process=False)


@pytest.mark.slow
@pytest.mark.parametrize("where", ["mirror", "highway"])
@pytest.mark.parametrize("place", [*ON_HOST, CALLED_BACK, *(slow(one) for one in TRACED[:3])])
@pytest.mark.parametrize("how", ["exit", *(slow(how) for how in HOWS if how != "exit")])
def test_at_the_wheel(how, place, where):
    check_errors([drive.error for drive in drive_each(CASES, named(how, place), where=where)], how)


@pytest.mark.parametrize("how", HOWS)
def test_asked_in_this_process(how):
    given = PlannerUnderTest.of(PLANNERS[f"{how}_in_act"](), own_process=False)
    assert given.where == "this process"
    check_errors([drive.error for drive in drive_each(CASES, given)], how)


@pytest.mark.slow
@pytest.mark.parametrize("place", [TRACED[0], CALLED_BACK, *(slow(one) for one in TRACED[1:])])
def test_attacked_while_it_is_traced_and_run(place):
    for how in ("os_exit",) if place in (TRACED[0], CALLED_BACK) else HOWS:
        check_errors([case.attack.planner_error for case in attack(CASES, QUICK, named(how, place))], how)


@pytest.mark.slow
def test_attacked_by_drives_every_few_iterations():
    config = QUICK.but(iterations=4, replan_every=2)
    for place in TRACED:
        found = attack(CASES, config, named("exit", place))
        check_errors([case.attack.planner_error for case in found], "exit")
