"""A planner in JAX that answers no number, or raises, costs its own case, wherever it drives."""

from dataclasses import replace

import pytest
from jax_planners import AT_STEP
from places import SUPPORT
from scenes import scene

from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import METHODS, REGENTS
from regents_cosim.errors import DriveError
from regents_cosim.evaluation.drives.driving import drive_each, drive_in_mirror
from regents_cosim.replays.mirror import MirrorController
from regents_cosim.replays.replay import replay_each
from regents_cosim.reports.report import report_of
from regents_cosim.scenario.attack_record import AttackRecord

FILE = SUPPORT / "jax_planners.py"
FAILS, RAISES = (f"{FILE}:{name}" for name in ("FailsInOneCase", "RaisesInOneCase"))
BUSY = scene((0, 0, 10), (20, 3.2, 8), (30, 3.2, 9), steps=30)
SAID = {"nan": "nan", "plus": "inf", "minus": "-inf"}
QUICK = REGENTS.but(iterations=5)
CASES = [replace(BUSY, id=name) for name in ("good", "nan", "plus", "minus", "fine")]
CALLED = [replace(BUSY, id=name) for name in ("good", "bad", "fine")]


def answered(case):
    return f"{FAILS!r} answered accel {SAID[case]}, curvature 0.0 at step {AT_STEP} of case {case}, expected finite"


def check_errors(errors):
    assert list(errors) == [case.id for case in CASES]
    for case, error in errors.items():
        assert answered(case) in error if case in SAID else not error


@pytest.mark.parametrize("where", ["mirror", "highway", pytest.param("sumo", marks=pytest.mark.slow)])
def test_evaluated(where):
    drives = list(drive_each(CASES, FAILS, where=where))
    check_errors({drive.case: drive.error for drive in drives})
    assert all(drive.completion == (0.0 if drive.case in SAID else pytest.approx(1.0, abs=0.05)) for drive in drives)


@pytest.mark.parametrize("where", [pytest.param("mirror", marks=pytest.mark.slow), "highway"])
def test_one_that_raises_in_a_callback(where):
    good, bad, fine = drive_each(CALLED, RAISES, where=where)
    assert not good.error
    assert not fine.error
    assert f"planner {RAISES!r} failed on case bad" in bad.error
    assert "KeyError: 'lost'" in bad.error
    assert "in _call" in bad.trace
    if where == "highway":
        assert "at step 0" in bad.error


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "how"),
    [
        ("regents", {}),
        ("regents", {"replan_every": 3}),
        ("focused", {"patience": 0}),
        *((name, {}) for name, one in METHODS.items() if not one.descends),
    ],
)
def test_attacked(method, how):
    config = METHODS[method].but(iterations=5, **how)
    found = list(attack(CASES, config, FAILS))
    check_errors({case.attack.case: case.attack.planner_error for case in found})
    for case in found:
        assert (case.attack.outcome == "planner_error") == (case.attack.case in SAID)


@pytest.mark.slow
def test_attacked_in_batches():
    found = list(attack(CASES, QUICK, FAILS, engine="batched"))
    check_errors({case.attack.case: case.attack.planner_error for case in found})
    good, bad, fine = attack(CALLED, QUICK, RAISES, engine="batched")
    assert "KeyError: 'lost'" in bad.attack.planner_error
    assert good.attack.outcome == fine.attack.outcome != "planner_error"


@pytest.mark.slow
def test_replayed_and_reported():
    replays = list(replay_each(CASES, "mirror", FAILS))
    check_errors({one.case: one.reason if one.planner_failed else "" for one in replays})
    driven = list(drive_in_mirror(CASES, FAILS))
    page = report_of(CASES, {FAILS: driven})
    check_errors({case.id: case.runs[0].error for case in page.cases})
    nan = replace(CASES[1], attack=AttackRecord("nan", "none", "idm", "no_collision", 0), log=BUSY.tracks)
    with MirrorController(FAILS) as driver, pytest.raises(DriveError, match="of case nan, expected finite numbers"):
        driver.drive(nan)
