"""Methods held against each other by what they fill of the map of behaviours."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_crashes import braked, window

from benchmarks.__main__ import run
from benchmarks.archive_benchmark import ArchiveRow, archive_comparisons, archive_row, paired_p
from regents_cosim.evaluation.crashes.scores import CrashInSumo, MethodRun
from regents_cosim.runs.archive.axes import Axes


def test_crashes_that_sumo_denies_fill_no_cell():
    cases = [braked(window(at), f"crash{at}", 6.0, closing, 50.0, False) for at, closing in enumerate((2.0, 7.0, 12.0))]
    said = [CrashInSumo(case.id, case.id != "crash2", True) for case in cases]
    row = archive_row(MethodRun("focused", "idm", 100, [cases[:2], cases[2:]], said), 3, Axes(("closing_speed",)))
    assert (row.seed, row.windows, row.crashes, row.cells, row.qd_score) == (3, 2, 2, 2, 5.0)


def test_each_is_compared_with_every_other_seed_by_seed():
    rows = [
        ArchiveRow(method, seed, 4, 10, 5, cells, 3.0 * cells)
        for seed in range(6)
        for method, cells in (("a", 8 + seed), ("b", 4), ("c", 8 + seed))
    ]
    better, same, worse = archive_comparisons(rows)
    assert (worse.method, worse.than, worse.qd_score_p) == ("b", "c", better.qd_score_p)
    assert (better.than, better.cells, better.cells_than, better.cells_p) == ("b", 10.5, 4.0, 2 / 64)
    assert (same.than, same.qd_score_p) == ("c", 1.0)


@given(st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9)), max_size=8))
def test_the_p_value_is_a_share_that_knows_no_order(pairs):
    first, second = [float(a) for a, _ in pairs], [float(b) for _, b in pairs]
    p = paired_p(first, second)
    assert 0.0 < p <= 1.0
    assert p == paired_p(second, first) == paired_p(first[::-1], second[::-1])


def test_a_search_named_twice_is_one_clear_line(capsys):
    assert run(["archive", "--methods", "focused", "--methods", "focused"]) == 2
    assert "benchmarks: --methods focused, focused: expected each once" in capsys.readouterr().err


@pytest.mark.slow
def test_the_command_runs_on_a_tiny_size(tmp_path, capsys):
    words = ["archive", "--methods", "focused", "--seeds", "1", "--count", "1"]
    words += ["--nets", "merge", "--json", "--quiet", "-o", str(tmp_path / "runs")]
    assert run(words) == 0
    found = json.loads(capsys.readouterr().out)
    assert [row["method"] for row in found["rows"]] == ["focused", "cma-me"]
    ours, its = (row["rollouts"] for row in found["rows"])
    assert ours - 11 < its <= ours
    assert [one["than"] for one in found["compared"]] == ["cma-me"]
