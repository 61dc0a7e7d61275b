"""Runs of a table kept on disk: taken up again as they were, and only for what they were made for."""

from dataclasses import replace

import pytest
from table_runs import LAWFUL, WINDOWS, crashed, missed

from regents_cosim.attacks.presets import KING, OURS, REGENTS, with_ten_times
from regents_cosim.benchmarks.ceiling import ceiling, unsolved
from regents_cosim.benchmarks.kept_runs import joined, keep, kept, run_folder
from regents_cosim.errors import CaseError
from regents_cosim.evaluation.crashes.scores import CrashInSumo, MethodRun, rollouts_at_most, scores
from regents_cosim.judgement import ReferenceDrive

KINGS = MethodRun("king", "idm", 500, WINDOWS, [CrashInSumo("b", True, False)], 2.0, KING.protocol)


def test_a_run_that_was_kept_is_the_same_run(tmp_path):
    assert kept(tmp_path) is None
    keep(KINGS, tmp_path)
    found = kept(tmp_path)
    assert scores(found) == scores(KINGS)
    assert found.protocol == KING.protocol
    (tmp_path / "run.json").write_text("{")
    with pytest.raises(CaseError, match="remove the folder to make the run again"):
        kept(tmp_path)


def test_a_folder_is_of_one_method_planner_and_windows(tmp_path):
    windows = [results[0].before_attack() for results in WINDOWS]
    folders = {
        run_folder(tmp_path, "king", "idm", KING, windows),
        run_folder(tmp_path, "king", "idm", replace(KING, iterations=3), windows),
        run_folder(tmp_path, "king", "rss", KING, windows),
        run_folder(tmp_path, "king", "idm", KING, windows[1:]),
        run_folder(tmp_path, "regents", "idm", REGENTS, windows),
    }
    assert len(folders) == 5
    assert run_folder(tmp_path, "king", "idm", KING, list(windows)) in folders


def test_a_changed_planner_has_another_folder(tmp_path):
    file = tmp_path / "mine.py"
    folders = set()
    for gap_m in (1, 2):
        file.write_text(f"gap_m = {gap_m}")
        folders.add(run_folder(tmp_path, "king", f"{file}:Mine", KING, []))
    assert len(folders) == 2


def test_places_are_joined_in_order():
    parts = [replace(KINGS, windows=WINDOWS[:2]), replace(KINGS, windows=WINDOWS[2:], in_sumo=[])]
    whole = joined(parts)
    assert [results[0].id for results in whole.windows] == [results[0].id for results in WINDOWS]
    assert (whole.in_sumo, whole.seconds) == (KINGS.in_sumo, 4.0)


def telling(name):
    return crashed(name, law=LAWFUL, drivers=(ReferenceDrive("careful", True, 1.0, 2.2),))


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
    assert some.of_ceiling == {"king": 0.25, "focused": 0.25}
    every = ceiling("idm", "all", longer, [replace(again, windows=[[telling("d")], [missed("e")]])])
    assert (every.tried, every.more, every.share) == (2, 1, 0.75)


def test_ten_times_the_budget_is_ten_times_the_budget():
    assert rollouts_at_most(with_ten_times(OURS)) == 10 * rollouts_at_most(OURS)
