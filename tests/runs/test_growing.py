"""A suite that grows: only what is new is added, what was attacked is not attacked again, and nothing is lost."""

import signal
import subprocess
import sys
import time
from collections import deque
from contextlib import contextmanager
from dataclasses import replace

import pytest
from command import REGENTS
from made_crashes import MadeCrashes, braked, window

from regents_cosim import saving
from regents_cosim.attacks.methods.presets import preset
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import find_cases, load_manifest
from regents_cosim.cli import run
from regents_cosim.errors import CaseError
from regents_cosim.evaluation.suites.folders import check_suite
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.runs.behaviour_map import archive_of
from regents_cosim.runs.growing import Budget, GrowingSuite, SuiteIntake, open_explored
from regents_cosim.saving import SuiteWriter
from regents_cosim.system.files.locks import writing

PLANNER = PlannerUnderTest.of("constant_velocity")
RUN = MadeCrashes(preset(method="king"), PLANNER, verify=False, pictures=False)
ROUNDS = ([window(0), window(1)], [window(2), window(3)])
NEVER = Budget(float("inf"))


def growing(folder, search=RUN):
    intake = SuiteIntake(folder, archive_of(find_cases(folder)), None, verify=False)
    return GrowingSuite(intake, open_explored(folder, "key", "idm", "king"), search)


def record(number):
    return ROUNDS[number] if number < len(ROUNDS) else []


@pytest.fixture
def suite(tmp_path):
    """A suite of one crash, a bad one of the slowest kind."""
    folder = tmp_path / "suite"
    SuiteWriter(folder, 7).add(braked(window(9), "old", 6.0, 2.0, 0.0, spoilt=True))
    return folder


def test_what_is_new_is_added_and_what_is_there_stays(suite):
    before = load_manifest(suite)
    growth = growing(suite).grow("traffic", record, NEVER)
    assert growth.used_up
    assert growth.windows == 4
    found = [case for cases in RUN.attack([*ROUNDS[0], *ROUNDS[1]]) for case in cases]
    assert 0 < len(growth.added) <= growth.crashes == len(found)
    assert {one.why for one in growth.added} >= {"new cell"}
    after = load_manifest(suite)
    assert {*before.cases} < {*after.cases}
    assert after.seed == before.seed
    assert archive_of(find_cases(suite)).qd_score >= max(one.crash.quality for one in growth.added)
    again = growing(suite).grow("traffic", record, NEVER)
    assert (again.windows, again.added) == (0, [])
    assert load_manifest(suite) == after


class KilledError(Exception):
    """Stands for a kill."""


@pytest.mark.slow
def test_a_session_that_is_killed_goes_on_with_the_window_that_it_was_at(suite, tmp_path):
    whole = tmp_path / "whole"
    SuiteWriter(whole, 7).add(load_case(suite / "old"))
    growing(whole).grow("traffic", record, NEVER)

    class Dying(MadeCrashes):
        def attack(self, scenarios):
            for cases in super().attack(scenarios):
                yield cases
                raise KilledError

    for _ in range(4):
        with pytest.raises(KilledError):
            growing(suite, Dying(RUN.config, RUN.planner, verify=False, pictures=False)).grow("traffic", record, NEVER)
    growing(suite).grow("traffic", record, NEVER)
    assert load_manifest(suite) == load_manifest(whole)
    assert (suite / "explored.json").read_bytes() == (whole / "explored.json").read_bytes()


@pytest.mark.slow
def test_a_case_of_the_same_name_stays_beside_the_new_one(suite):
    found = [case for cases in RUN.attack([*ROUNDS[0], *ROUNDS[1]]) for case in cases]
    for case in found:
        SuiteWriter(suite, 0).add(replace(braked(window(8), "x", 6.0, 2.0, 1.0, spoilt=True), id=case.id))
    before = {entry.case: entry.hash for entry in load_manifest(suite).cases}
    added = growing(suite).grow("traffic", record, NEVER).added
    after = {entry.case: entry.hash for entry in load_manifest(suite).cases}
    assert before.items() < after.items()
    assert {one.crash.case for one in added} == after.keys() - before.keys()


def test_a_case_that_another_process_adds_meanwhile_stays(suite, monkeypatch):
    """It has the name of the new one, and comes just before that one is written."""
    theirs, ours = (replace(braked(window(8), "x", 6.0, 2.0, late, spoilt=True), id="new") for late in (1.0, 0.5))

    @contextmanager
    def after_theirs(folder):
        monkeypatch.undo()
        SuiteWriter(folder, 7).add(theirs)
        with writing(folder):
            yield

    monkeypatch.setattr(saving, "writing", after_theirs)
    (added,) = SuiteIntake(suite, archive_of(()), None, verify=False).take([ours])
    assert added.crash.case.startswith("new-")
    assert {entry.case for entry in load_manifest(suite).cases} == {"old", "new", added.crash.case}
    assert content_hash(load_case(suite / "new")) == content_hash(theirs)


def test_when_the_time_is_over_no_window_is_begun(suite):
    growth = growing(suite).grow("traffic", record, Budget(0.0))
    assert (growth.windows, growth.used_up) == (0, False)


def test_without_a_time_a_run_ends_after_one_round_and_the_next_takes_another(suite):
    runs = [growing(suite).grow("traffic", record, Budget.of(None)) for _ in range(3)]
    assert [(one.windows, one.used_up) for one in runs] == [(2, False), (2, False), (0, True)]


def test_an_interrupted_round_is_finished_before_the_next_begins(suite):
    growing(suite).explored.note(content_hash(window(1)), "kind")
    assert growing(suite).grow("traffic", record, Budget.of(None)).windows == 1
    assert growing(suite).explored.run.rounds == {"traffic": 1}


def test_surroundings_that_are_least_explored_come_first(suite):
    wide = growing(suite)
    wide.explored.run.windows.update({f"{number}": "ego_goes_straight, straight, sparse" for number in range(5)})
    left = {"a": window(1), "b": replace(window(2), road=replace(window(2).road, lanes=()))}  # no place without lanes
    chosen = [one.id for one in wide._chosen(left, NEVER, deque())]
    assert chosen == ["window2", "window1"]


def test_a_file_that_is_no_record_is_said(suite):
    (suite / "explored.json").write_text("[]")
    with pytest.raises(CaseError, match="remove it to explore from the beginning"):
        open_explored(suite, "key", "idm", "king")


@pytest.mark.slow
@pytest.mark.parametrize("planners", [("idm", "idm"), ("idm", "rss")])
def test_two_processes_that_let_a_suite_grow_lose_no_window_of_each_other(suite, planners):
    code = """
import sys
from pathlib import Path
from regents_cosim.runs.growing import open_explored
suite, planner, number = Path(sys.argv[1]), *sys.argv[2:]
explored = open_explored(suite, planner, planner, "king")
print("ready", flush=True)
input()
for window in range(40):
    explored.note(f"{number}-{window}", "kind")
    explored.end_round(number, window)
"""
    words = [[sys.executable, "-c", code, suite, planner, str(n)] for n, planner in enumerate(planners)]
    both = [subprocess.Popen(one, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) for one in words]
    assert [one.stdout.readline() for one in both] == ["ready\n"] * 2
    for one in both:
        one.stdin.write("\n")
        one.stdin.flush()
    for one in both:
        one.communicate()
        assert one.returncode == 0
    found = [open_explored(suite, planner, planner, "king").run for planner in sorted(set(planners))]
    assert sum(len(one.windows) for one in found) == 80
    assert {traffic: number for one in found for traffic, number in one.rounds.items()} == {"0": 39, "1": 39}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["-o", "out", "--minutes", "3"], "expected --into SUITE as well"),
        (["--into", "suite", "--minutes", "0"], "expected more than 0"),
        (["--into", "suite", "--retry", "--shard", "1/2"], "leave out --shard, --retry"),
        ([], "a suite that grows with --into"),
    ],
)
def test_what_cannot_be_is_one_line(words, told, suite, monkeypatch, capsys):
    monkeypatch.chdir(suite.parent)
    assert run(["attack", "-c", "shipped:merge", *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line


@pytest.mark.slow
def test_a_suite_keeps_the_settings_by_which_it_grew_and_those_that_made_it(suite, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    SuiteWriter(tmp_path / "cases", 0).add(window(0))
    (suite / "suite.toml").write_text("# made by regents_cosim\n")
    words = ["attack", "cases", "--planner", "constant_velocity", "--method", "king", "--iterations", "1"]
    assert run([*words, "--no-verify", "--into", "suite", "-o", "new", "--quiet"]) == 0
    kept = (suite / "attack.toml").read_text()
    assert "again: regents attack --config THIS_FILE --into FOLDER\n" in kept
    assert 'method = "king"\n' in kept
    assert (suite / "suite.toml").exists()
    assert run(["suite", "check", "suite"]) == 0


@pytest.mark.slow
def test_the_command_killed_leaves_a_whole_suite(suite):
    words = ["attack", "-c", "shipped:merge", "--count", "4", "--method", "regents", "--iterations", "20", "--quiet"]
    before, new = load_manifest(suite).cases, suite.parent / "new"
    with subprocess.Popen([REGENTS, *words, "--into", suite, "--minutes", "1", "-o", new]) as process:
        while process.poll() is None and not list(new.glob("*/scenario.json")):
            time.sleep(0.02)
        process.send_signal(signal.SIGKILL)
    assert not [row for row in check_suite(suite) if row.problem]
    assert {*before} <= {*load_manifest(suite).cases}
