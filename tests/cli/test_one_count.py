"""`attack`, `evaluate`, `suite rank` and the report say the same numbers of the same crashes."""

import json
import re

import pytest
from shipped_cases import crash_on, shipped_window, shipped_windows

from regents_cosim.cases.files import load_case
from regents_cosim.cases.suite import load_suite
from regents_cosim.cli import run
from regents_cosim.evaluation.drives.driving import drive_each
from regents_cosim.reports.report import twin_of
from regents_cosim.saving import SuiteWriter

pytestmark = pytest.mark.slow
BLIND = "constant_velocity"
ATTACK = ("--method", "regents", "--iterations", "40", "--planner", BLIND, "--no-pictures", "--no-verify")


@pytest.fixture(scope="module")
def attacked(tmp_path_factory):
    """A window that is made a crash, and one in which this planner collides without that; what `attack` says."""
    folder = tmp_path_factory.mktemp("counts")
    writer = SuiteWriter(folder / "recorded", 0)
    writer.add(shipped_window("multilane"))
    merge = shipped_windows("merge")
    writer.add(next(one for one, drive in zip(merge, drive_each(merge, BLIND), strict=True) if drive.hits))
    assert run(["attack", str(folder / "recorded"), *ATTACK, "-o", str(folder / "attacked")]) == 0
    return folder / "attacked"


@pytest.fixture(scope="module")
def mixed(attacked, tmp_path_factory):
    """The same with a telling crash of idm."""
    writer = SuiteWriter(tmp_path_factory.mktemp("mixed"), 0)
    for case in (*load_suite(attacked), load_case(crash_on("crossing"))):
        writer.add(case)
    return writer.folder


def said(capsys, *words):
    """The line in which a command counts crashes."""
    assert run(list(map(str, words))) == 0
    return [line for line in capsys.readouterr().out.splitlines() if re.match(r"\d+ of \d+ crash\b", line)]


def plain(capsys, *words):
    assert run([*map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def scores_of(page):
    twin = json.loads(twin_of(page).read_text())
    return {(one["label"], one["driver"]): one["detail"] for one in twin["scores"]}, twin


def test_all_say_one_sentence_of_the_planner_that_was_attacked(attacked, tmp_path, capsys):
    [sentence] = said(capsys, "attack", attacked.parent / "recorded", *ATTACK, "-o", attacked)  # all is done
    assert re.match(r"2 of 2 crash \(1 of them without an attack\), \d telling.*, \d clean", sentence)
    assert said(capsys, "evaluate", attacked, "--planner", BLIND) == [sentence]
    assert said(capsys, "report", attacked, "-o", tmp_path / "held.html") == [sentence]
    assert said(capsys, "report", attacked, "-o", tmp_path / "driven.html", "--planner", BLIND) == [sentence]
    assert said(capsys, "suite", "judge", attacked) == [sentence]


@pytest.mark.parametrize("planner", ["idm", BLIND, "careful"])
def test_every_table_has_the_numbers_of_that_sentence(mixed, tmp_path, capsys, planner):
    row = plain(capsys, "evaluate", mixed, "--planner", planner)[-1]
    [rank] = plain(capsys, "suite", "rank", mixed, "--planner", planner)
    assert run(["report", str(mixed), "-o", str(tmp_path / "r.html"), "--planner", planner]) == 0
    scores, twin = scores_of(tmp_path / "r.html")
    assert planner != "idm" or row["telling_collisions"] == 1
    counts = twin["crashes"][planner]
    assert (row["n"], rank["n"], counts["cases"]) == (3, 3, 3)
    assert row["collisions"] == rank["crashes"] == counts["crashes"] == sum(any(c["endings"]) for c in twin["cases"])
    assert row["telling_collisions"] == rank["telling_crashes"] == counts["telling"]
    assert row["telling_collisions"] == sum(c["telling"] is True and c["need"] != "ordinary" for c in twin["cases"])
    assert row["ordinary_collisions"] == counts["ordinary"]
    assert scores["Collision rate", planner] == f"{row['collisions']} of 3 cases"
    if counts["judged"]:
        assert scores["Telling crashes", planner].startswith(f"{row['telling_collisions']} of 3 cases")
    works = {work["need"]: work["crashes"] for work in twin["fix_first"]}
    assert sum(works.values()) == row["collisions"]
