"""A stopped and continued attack ends with the bytes of an uninterrupted one; so do its shards, put together."""

import random
import shutil
import signal
import subprocess
import time
from dataclasses import replace

import pytest
from attack_sessions import StoppedError, attack_session
from command import REGENTS, regents
from msgspec.structs import replace as replace_struct
from scenes import platoon

from regents_cosim.attacks.methods.presets import preset
from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import find_cases, load_manifest
from regents_cosim.errors import CaseError
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.runs.attack_run import attacked_headers
from regents_cosim.runs.ledger import open_ledger
from regents_cosim.runs.merging import merge_shards, shards_in
from regents_cosim.runs.shards import WHOLE, Shard
from regents_cosim.runs.status import status_of
from regents_cosim.runs.window_job import AttackRun
from regents_cosim.runs.windows import windows_in
from regents_cosim.saving import SuiteWriter

RUN = AttackRun(
    preset(method="king", iterations=2), PlannerUnderTest.of("constant_velocity"), verify=False, pictures=False
)


def platoons(folder, count):
    """A suite with a given number of windows."""
    suite = SuiteWriter(folder, 0)
    for seed in range(count):
        suite.add(platoon(4, seed))
    return folder


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    return platoons(tmp_path_factory.mktemp("cases") / "cases", 4)


def attack(cases, folder, *, stop_after=99, shard=WHOLE, run=RUN, retry=False):
    """A session; returns how many windows it searched."""
    return attack_session(folder, windows_in(cases), run, shard, stop_after=stop_after, retry=retry)


def tree(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def whole(cases, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole") / "suite"
    assert attack(cases, folder) == 4
    return folder


@pytest.mark.slow
def test_stopped_between_windows_it_goes_on_and_ends_the_same(cases, whole, tmp_path):
    suite = tmp_path / "suite"
    for stop_after in (1, 0, 2):
        with pytest.raises(StoppedError):
            attack(cases, suite, stop_after=stop_after)
    assert status_of(suite).left == 1
    assert attack(cases, suite) == 1
    assert tree(suite) == tree(whole)
    assert attack(cases, suite) == 0
    assert tree(suite) == tree(whole)


@pytest.mark.slow
def test_what_the_user_removed_is_made_again_and_nothing_else(cases, whole, tmp_path):
    suite = shutil.copytree(whole, tmp_path / "suite")
    shutil.rmtree(find_cases(suite)[2])
    assert attack(cases, suite) == 1
    assert tree(suite) == tree(whole)


@pytest.mark.slow
def test_cases_of_a_window_of_which_the_user_removed_one_go_with_it(cases, whole, tmp_path):
    """Whether the window is gone, or searched again with another end."""
    suite = shutil.copytree(whole, tmp_path / "suite")
    (first, *_), other = find_cases(suite), platoon(4, 9)
    SuiteWriter(suite, 0).add(replace(load_case(first), id="second-of-platoon0"))
    with open_ledger(suite, RUN.identity({}, 1)) as ledger:
        ledger.note_begun("platoon0", ["second-of-platoon0"])
        ledger.note(replace_struct(ledger.record.done["platoon0"], unit=ledger.record.own[0]))
    shutil.rmtree(first)
    fewer = tmp_path / "cases"
    for case in (*map(load_case, find_cases(cases)[1:]), other):
        SuiteWriter(fewer, 0).add(case)
    assert attack(fewer, suite) == 1
    assert not (suite / "second-of-platoon0").exists()
    assert len(load_manifest(suite).cases) == 4


@pytest.mark.slow
def test_new_cases_are_attacked_and_those_that_are_gone_go(cases, whole, tmp_path):
    fewer = tmp_path / "cases"
    writer = SuiteWriter(fewer, 0)
    for folder in find_cases(cases)[1:]:
        writer.add(load_case(folder))
    suite = tmp_path / "suite"
    assert attack(fewer, suite) == 3
    assert attack(cases, suite) == 1
    assert tree(suite) == tree(whole)
    assert attack(fewer, suite) == 0
    assert len(load_manifest(suite).cases) == 3
    assert not (suite / find_cases(whole)[0].name).exists()


@pytest.mark.slow
def test_the_table_of_a_run_that_went_on_is_that_of_one_that_did_not(cases, whole):
    with open_ledger(whole, RUN.identity({}, 1)) as ledger:
        headers, replays = attacked_headers(ledger.record, whole)
    assert [one.attack.case for one in headers] == [f"platoon{seed}" for seed in range(4)]
    assert replays == {}


@pytest.mark.slow
def test_shards_put_together_are_the_run_that_was_not_divided(cases, whole, tmp_path):
    shards = [tmp_path / f"{number}" for number in (1, 2, 3)]
    for number, folder in enumerate(shards, start=1):
        attack(cases, folder, shard=Shard(number, 3))
    with pytest.raises(CaseError, match="shard 3/3 is missing"):
        shards_in(shards[:2])
    with pytest.raises(CaseError, match="is no shard"):
        shards_in([*shards, whole])
    assert merge_shards(tmp_path / "suite", shards[::-1]) == 4
    assert tree(tmp_path / "suite") == tree(whole)
    assert shards_in([whole, tmp_path / "suite"]) is None


@pytest.mark.slow
def test_shards_of_different_runs_are_refused(cases, tmp_path):
    other = AttackRun(preset(method="king", iterations=3), RUN.planner, verify=False, pictures=False)
    attack(cases, tmp_path / "1", shard=Shard(1, 2))
    attack(cases, tmp_path / "2", shard=Shard(2, 2), run=other)
    with pytest.raises(CaseError, match=r"1 \(shard 1/2\) and .*2 \(shard 2/2\) are of different runs: asked for"):
        shards_in([tmp_path / "1", tmp_path / "2"])


# --- the command, killed for real ---------------------------------------------------------------

COMMAND = (
    "attack", "-c", "shipped:merge", "--count", "4", "--seed", "3", "--method", "regents", "--iterations", "20",
    "--quiet", "-o",
)  # fmt: skip


def ends(*words, cwd, killed=lambda: False):
    """Run the command; SIGKILL as soon as `killed` says so. Returns whether it ended by itself."""
    with subprocess.Popen([REGENTS, *map(str, words)], cwd=cwd, stdout=subprocess.DEVNULL) as process:
        while process.poll() is None:
            if killed():
                process.send_signal(signal.SIGKILL)
                return False
            time.sleep(0.02)
    assert process.returncode == 0
    return True


def begun(ledger, lines, after_s):
    """Whether a ledger has had a number of lines for a given time."""
    seen = []

    def now():
        if ledger.exists() and len(ledger.read_bytes().splitlines()) >= lines:
            seen.append(time.monotonic())
        return bool(seen) and time.monotonic() - seen[0] >= after_s

    return now


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    at = tmp_path_factory.mktemp("undisturbed")
    assert ends(*COMMAND, "suite", cwd=at)
    return at / "suite"


@pytest.mark.slow
def test_killed_at_random_moments_it_ends_with_the_same_bytes(undisturbed, tmp_path):
    """Killed while it records and while it searches the second window, it leaves whole cases only."""
    rng = random.Random(0)
    ledger = tmp_path / "other" / ".run" / "ledger.jsonl"
    for lines in (1, 4):
        assert not ends(*COMMAND, "other", cwd=tmp_path, killed=begun(ledger, lines, rng.uniform(0.0, 0.1)))
    left = find_cases(tmp_path / "other")
    assert left
    assert all(load_case(case).attack for case in left)  # whole ones only
    assert ends(*COMMAND, "other", cwd=tmp_path)
    assert tree(tmp_path / "other") == tree(undisturbed)


@pytest.mark.slow
def test_shards_of_the_command_are_merged_into_the_same_bytes(undisturbed, tmp_path):
    for number in (1, 2):
        assert ends(*COMMAND, f"shards/{number}", "--shard", f"{number}/2", cwd=tmp_path)
    assert ends("suite", "merge", "shards/1", "shards/2", "-o", "suite", cwd=tmp_path)
    assert tree(tmp_path / "suite") == tree(undisturbed)


@pytest.mark.slow
def test_a_task_of_an_array_does_its_share_and_says_so(tmp_path, monkeypatch):
    for name, value in {"ID": "2", "COUNT": "4", "MIN": "0", "STEP": "1"}.items():
        monkeypatch.setenv(f"SLURM_ARRAY_TASK_{name}", value)
    words = [word for word in COMMAND if word != "--quiet"]
    done = regents(*words, "suite", cwd=tmp_path)
    assert "shard 3/4, by SLURM's job array" in done.stderr
    assert status_of(tmp_path / "suite").units == 1
