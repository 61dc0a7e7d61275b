"""Runs of a table kept on disk: taken up again as they were, and only for what they were made for."""

import shutil
from dataclasses import replace

import pytest
from table_runs import AVOIDS, LAWFUL, WINDOWS, crashed, missed

from benchmarks.ceiling import ceiling, unsolved, with_ten_times
from regents_cosim.attacks.methods.presets import KING, OURS, REGENTS
from regents_cosim.benchmarks.runs import ComparedMethod, joined, run_once
from regents_cosim.errors import CaseError, RegentsError
from regents_cosim.evaluation.crashes.scores import CrashInSumo, MethodRun, rollouts_at_most, scores
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.runs.status import runs_in

KINGS = MethodRun("king", "idm", rollouts_at_most(KING), WINDOWS, [CrashInSumo("b", True, False)], 2.0, KING.protocol)


FEW = replace(KINGS, windows=WINDOWS[:2])


def tree(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def keep(output, method="king", planner="idm", config=KING, windows=WINDOWS[:2], run=FEW):
    """The run, and whether it was made now."""
    made = []
    before = [results[0].before_attack() for results in windows]
    column = ComparedMethod(method, config)
    kept = run_once(output, column, PlannerUnderTest.of(planner), before, lambda: (made.append(1), run)[1])
    return kept, bool(made)


def test_a_run_that_was_kept_is_the_same_run(tmp_path):
    assert keep(tmp_path)[1]
    found, made = keep(tmp_path)
    assert not made
    assert scores(found) == scores(FEW)
    assert found.protocol == KING.protocol
    assert [(one.command, one.state, one.done) for one in runs_in(tmp_path)] == [("bench", "finished", 1)]


def test_a_run_that_failed_leaves_nothing(tmp_path):
    def fail():
        raise RegentsError("no SUMO")

    with pytest.raises(RegentsError, match="no SUMO"):
        run_once(tmp_path, ComparedMethod("king", KING), PlannerUnderTest.of("idm"), [], fail)
    assert not list(tmp_path.rglob("*.jsonl"))


def test_a_run_of_which_something_is_missing_is_made_again_and_then_the_same(tmp_path):
    keep(tmp_path)
    (folder,) = (tmp_path / "runs").iterdir()
    whole, ledger = tree(folder), folder / ".run" / "ledger.jsonl"
    lines = ledger.read_bytes()
    for torn in (lines[:-20], lines.splitlines(keepends=True)[0]):  # killed while it noted the run; before it did
        ledger.write_bytes(torn)
        (folder / "b" / "scenario.json").unlink()
        assert keep(tmp_path)[1]
        assert tree(folder) == whole


def test_a_run_of_which_a_case_was_removed_is_made_again(tmp_path):
    keep(tmp_path)
    (folder,) = (tmp_path / "runs").iterdir()
    shutil.rmtree(folder / "b")
    assert keep(tmp_path)[1]
    assert not keep(tmp_path)[1]


def test_a_damaged_ledger_is_one_clear_line(tmp_path):
    keep(tmp_path)
    (ledger,) = tmp_path.rglob("ledger.jsonl")
    ledger.write_bytes(b"{}\n")
    with pytest.raises(CaseError, match="remove .* to begin again"):
        keep(tmp_path)


def test_a_run_is_of_one_method_planner_and_windows(tmp_path):
    others = [
        {},
        {"config": KING.but(iterations=3)},
        {"planner": "careful"},
        {"windows": WINDOWS[1:2]},
        {"method": "regents", "config": REGENTS},
    ]
    empty = replace(KINGS, windows=[])
    assert all(keep(tmp_path, run=empty, **other)[1] for other in others)
    assert not any(keep(tmp_path, run=empty, **other)[1] for other in others)


def test_a_changed_planner_has_another_run(tmp_path):
    file = tmp_path / "mine.py"
    for gap_m in (1, 2):
        file.write_text(f"gap_m = {gap_m}\nclass Mine:\n    reset = act = print\n")
        assert keep(tmp_path, planner=f"{file}:Mine", run=replace(KINGS, windows=[]))[1]


def test_places_are_joined_in_order():
    parts = [replace(KINGS, windows=WINDOWS[:2]), replace(KINGS, windows=WINDOWS[2:], in_sumo=[])]
    whole = joined(parts)
    assert [results[0].id for results in whole.windows] == [results[0].id for results in WINDOWS]
    assert (whole.in_sumo, whole.seconds) == (KINGS.in_sumo, 4.0)


def telling(name):
    return crashed(name, law=LAWFUL, drivers=AVOIDS)


def test_the_ceiling_counts_what_any_run_finds_and_estimates_the_rest():
    first = MethodRun(
        "king", "idm", 500, [[missed("a", "already_colliding")], [telling("b")], [missed("c")], [missed("d")]]
    )
    second = MethodRun("focused", "idm", 500, [[missed("a")], [missed("b")], [telling("c")], [missed("d")]])
    windows = [results[0].before_attack() for results in first.windows] + [missed("e").before_attack()]
    assert [one.id for one in unsolved(windows, [first, second])] == ["d", "e"]
    longer = [replace(run, windows=[*run.windows, [missed("e")]]) for run in (first, second)]
    again = MethodRun("focused with ten times the roll-outs", "idm", 5000, [[telling("d")]])
    some = ceiling("idm", "all", longer, [again])
    assert (some.n, some.solved, some.tried, some.more, some.share) == (4, 2, 1, 1, 1.0)
    faultless = replace(again, windows=[[crashed("d", law=LAWFUL, drivers=AVOIDS, at_fault="ego")]])
    assert [ceiling("idm", "all", longer, [one]).flawless for one in (again, faultless)] == [0, 1]
    assert some.of_ceiling == {"king": 0.25, "focused": 0.25}
    every = ceiling("idm", "all", longer, [replace(again, windows=[[telling("d")], [missed("e")]])])
    assert (every.tried, every.more, every.share) == (2, 1, 0.75)


def test_ten_times_the_budget_is_ten_times_the_budget():
    assert rollouts_at_most(with_ten_times(OURS)) == 10 * rollouts_at_most(OURS)
