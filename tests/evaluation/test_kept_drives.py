"""Drives that are kept: an evaluation that was stopped goes on, and its result is that of one that was not."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scenes import platoon

from regents_cosim.errors import CaseError, RegentsError
from regents_cosim.evaluation.drives.driving import DriveResult
from regents_cosim.evaluation.regression.evaluate import drive_once
from regents_cosim.planners.interface import Debug
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.runs.status import status_of

CASES = [platoon(2, seed) for seed in range(4)]
PLANNER = PlannerUnderTest("idm", source="idm")


def drives(scenarios, made, fails=()):
    """A drive of each that says how many there have been."""
    for scenario in scenarios:
        made.append(scenario.id)
        error = "boom" if scenario.id in fails else ""
        yield DriveResult(scenario.id, "file", completion=1 / 3, score=0.1 + 0.2, act_s=(1e-3, 2e-3), error=error)


def evaluate(folder, made, count=4, fails=(), retry=False, settings=None):
    kept = drive_once(
        folder, CASES, PLANNER, settings or {"in": "mirror"}, partial(drives, made=made, fails=fails), retry
    )
    return [drive for _, drive in zip(range(count), kept, strict=False)]


def test_what_is_driven_is_not_driven_again(tmp_path):
    whole, made = evaluate(tmp_path / "whole", []), []
    evaluate(tmp_path / "kept", made, count=2)
    assert status_of(tmp_path / "kept").left in (1, 2)
    assert evaluate(tmp_path / "kept", made) == whole
    assert made == [case.id for case in CASES]
    assert evaluate(tmp_path / "kept", made) == whole
    assert len(made) == 4


def test_a_drive_is_kept_whatever_its_planner_thought_before_a_crash(tmp_path):
    thought = ((3, Debug([np.zeros((2, 2))], [1.0], text="none is left")),)

    def crashes(scenarios):
        return (replace(drive, hits="b", step=4, debug=thought) for drive in drives(scenarios, []))

    for _ in ("driven", "read back"):
        kept = list(drive_once(tmp_path, CASES, PLANNER, {"in": "mirror"}, crashes))
        assert [(drive.hits, drive.step) for drive in kept] == [("b", 4)] * len(CASES)


def test_failed_drives_are_made_again_when_asked(tmp_path):
    made = []
    assert [bool(drive.error) for drive in evaluate(tmp_path, made, fails={"platoon2"})] == [False, False, True, False]
    assert evaluate(tmp_path, made)[2].error == "boom"
    assert evaluate(tmp_path, made, retry=True)[2].error == ""
    assert made[4:] == ["platoon2"]


def test_other_settings_and_objects_are_refused(tmp_path):
    evaluate(tmp_path, [])
    with pytest.raises(CaseError, match='begun with in "mirror", this run has in "sumo"'):
        evaluate(tmp_path, [], settings={"in": "sumo"})
    with pytest.raises(RegentsError, match="planners given by name"):
        list(drive_once(tmp_path, CASES, PlannerUnderTest("mine"), {}, partial(drives, made=[])))
