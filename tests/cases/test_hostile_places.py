"""Links, second names, pipes and devices in place of what a suite holds: nothing follows them, nothing waits."""

import os
from pathlib import Path

import pytest
from hostile_places import DEEDS, KINDS, MINE, places, problems, spoilt, whole_suite

from regents_cosim.cli import run
from regents_cosim.runs.ledger import FOLDER, open_ledger
from regents_cosim.runs.steps import Steps

# Of each kind of place one is tried at once; `benchmarks/endurance/places.py` tries all that there are.
FIRST = [".lock", FOLDER, f"{FOLDER}/windows", f"{FOLDER}/ledger.jsonl", "maps", "platoon0"]
MORE = [
    "runs",
    f"{FOLDER}/.lock",
    f"{FOLDER}/clock.json",
    f"{FOLDER}/steps",
    f"{FOLDER}/steps/x",
    f"{FOLDER}/windows/platoon0",
    ".platoon0.01234567.tmp",
    ".platoon0.01234567.tmp.old",
    "suite.json",
    "baseline.json",
    "explored.json",
    "report.html",
    "platoon0/scenario.json",
    "platoon0/tracks.npz",
    "platoon0/still.png",
]
FEW = ("add", "go on", "accept")
NEEDS_ROOT = pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root makes devices")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return whole_suite(tmp_path_factory.mktemp("whole") / "suite")


def tried(whole, place, kind, deeds, work):
    (path,) = (one for one in places(whole) if str(one) == place)
    assert problems(whole, path, kind, work, deeds) == []


@pytest.mark.parametrize("kind", ["link to the same", "pipe"])
@pytest.mark.parametrize("place", FIRST)
def test_nothing_is_followed_and_nothing_waits(whole, tmp_path, kind, place):
    tried(whole, place, kind, FEW, tmp_path / "work")


@pytest.mark.slow
@pytest.mark.parametrize("place", [*FIRST, *MORE])
@pytest.mark.parametrize("kind", [pytest.param(kind, marks=NEEDS_ROOT) if kind == "device" else kind for kind in KINDS])
def test_whatever_is_in_the_place_of_something(whole, tmp_path, kind, place):
    tried(whole, place, kind, FEW, tmp_path / "work")


@pytest.mark.slow
@pytest.mark.parametrize("deed", DEEDS)
def test_whatever_is_done(whole, tmp_path, deed):
    for place in FIRST:
        tried(whole, place, "link to the same", [deed], tmp_path / "work")


@pytest.mark.parametrize("kind", ["link to the same", "pipe"])
@pytest.mark.parametrize("place", [FOLDER, "platoon0"])
def test_a_command_says_so_in_one_line(whole, tmp_path, capsys, kind, place):
    found = spoilt(whole, Path(place), kind, tmp_path / "work")
    assert run(["suite", "merge", str(found.suite), str(found.suite), "-o", str(found.suite)]) in (0, 2)
    assert capsys.readouterr().err.count("\n") <= 1
    assert run(["status", str(found.suite)]) in (0, 2)
    assert not found.harm()


def test_what_the_user_keeps_among_what_we_remove_stays(tmp_path):
    steps = Steps(tmp_path)
    (tmp_path / FOLDER / "steps" / "mine").mkdir(parents=True)
    (tmp_path / FOLDER / "steps" / "mine" / "thesis.txt").write_text("years of work")
    (tmp_path / FOLDER / "steps" / "mine" / "scenario.json").write_text("{}")
    steps.clear()
    assert [str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()] == [
        f"{FOLDER}/steps/mine/thesis.txt"
    ]


def test_a_ledger_of_two_names_becomes_one_of_its_own(tmp_path, whole):
    os.link(whole / FOLDER / "ledger.jsonl", tmp_path / "copy")
    before = (tmp_path / "copy").read_bytes()
    with open_ledger(whole, MINE):
        pass
    assert (whole / FOLDER / "ledger.jsonl").stat().st_nlink == 1
    assert (tmp_path / "copy").read_bytes() == before
