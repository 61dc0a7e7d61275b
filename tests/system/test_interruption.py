"""Ctrl-C and SIGTERM end a command at once, with all that it started, one line, and what was finished on disk."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command import REGENTS
from on_a_terminal import on_a_terminal

from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import load_manifest
from regents_cosim.cases.shipped import network_config, shipped

GRID = network_config("grid")
QUICKSTART = shipped("scenarios") / "quickstart"
WITHIN_S = 20.0

pytestmark = pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="looks processes up in /proc")


class Command:
    """A command in a process group of its own; after it, nothing of it runs any more."""

    def __init__(self, *words, **environment):
        # Python leaves signals ignored that were so before; a shell's background jobs ignore SIGINT.
        self._mark = f"{os.getpid()}-{time.monotonic_ns()}"
        self._process = subprocess.Popen(
            [str(word) for word in words],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            env=os.environ | environment | {"REGENTS_TEST_MARK": self._mark},
        )

    def wait_until(self, condition, at_most_s=60.0):
        deadline = time.monotonic() + at_most_s
        while not condition():
            assert self._process.poll() is None, self._process.communicate()
            assert time.monotonic() < deadline
            time.sleep(0.01)

    def send(self, number, whole_group=False):
        (os.killpg if whole_group else os.kill)(self._process.pid, number)

    def end(self):
        """The exit code, the lines on stderr; asserts that it took no longer than it may and left nothing behind."""
        begin = time.monotonic()
        try:
            _, said = self._process.communicate(timeout=30.0)
        finally:
            os.killpg(self._process.pid, signal.SIGKILL) if self._process.poll() is None else None
        took = time.monotonic() - begin
        while self.children() and time.monotonic() < begin + WITHIN_S:
            time.sleep(0.01)
        assert self.children() == []
        assert took < WITHIN_S
        return self._process.returncode, said.splitlines()

    def children(self):
        """Processes of it, by their environment: a child of a child is one too."""
        found = []
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit() and int(entry.name) != self._process.pid:
                try:
                    is_mine = self._mark.encode() in (entry / "environ").read_bytes()
                except OSError:
                    continue
                if is_mine:
                    found.append(int(entry.name))
        return found


def attack(suite, *more, **environment):
    return Command(
        REGENTS, "attack", "-c", GRID, "--count", 24, "-o", suite, "--method", "focused", *more, **environment
    )


def check_saved(suite):
    listed = load_manifest(suite).cases
    for entry in listed:
        assert load_case(suite / entry.case).attack is not None
    assert {entry.case for entry in listed} == {p.name for p in suite.iterdir() if (p / "scenario.json").exists()}
    assert [path.name for path in suite.iterdir() if path.name.startswith(".")] == [".run"]  # where the rest goes on
    return len(listed)


def without_conflicts(said):
    """Lines on stderr, but for the one that says how many of the recorded windows have a possible conflict."""
    return [
        line for line in said if not line.startswith("windows in which another road user can lawfully cross or join")
    ]


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)])
def test_an_attack_ends_at_once_and_says_what_is_kept(tmp_path, number):
    suite = tmp_path / "suite"
    command = attack(suite, "--no-verify", "--no-pictures", "--planner", "constant_velocity")
    command.wait_until((suite / "suite.json").exists)
    command.send(number, whole_group=True)
    code, said = command.end()
    word = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}[number]
    count = check_saved(suite)
    assert without_conflicts(said) == [
        f"regents: {word}; finished cases saved in {suite}: {count}; for the others run the same command again"
    ]
    assert code == 128 + number


@pytest.mark.parametrize("after_s", [0.15, 0.5, 1.0])
def test_it_is_heard_while_jax_is_imported(tmp_path, after_s):
    command = Command(REGENTS, "report", QUICKSTART, "--planner", "idm", "-o", tmp_path / "report.html")
    time.sleep(after_s)  # Python itself, which shows a traceback, needs 0.04 s to begin
    command.send(signal.SIGINT)
    assert command.end() == (130, ["regents: interrupted; nothing is half-written, run the same command again"])
    assert list(tmp_path.iterdir()) == []


ENDED = """
import os, signal, time
from regents_cosim.system.interruption import end_at_once, announce_kept
end_at_once()
announce_kept("a line of many words " * 9)
os.kill(os.getpid(), signal.SIGINT)
time.sleep(20)
"""


def test_its_line_breaks_between_words_on_a_terminal():
    _, said = on_a_terminal([sys.executable, "-c", ENDED], 60, code=130)
    assert 9 * "a line of many words " in " ".join([*said.split(), ""])
    assert max(map(len, said.splitlines())) <= 60


@pytest.mark.slow
def test_a_slow_planner_does_not_hold_it_up(tmp_path, monkeypatch):
    (tmp_path / "slow.py").write_text(
        "import time\nfrom regents_cosim import Control\nclass Slow:\n"
        "    def reset(self, scene): open('driving', 'w').close()\n"
        "    def act(self, observation):\n        time.sleep(0.5)\n        return Control(0.0, 0.0)\n"
    )
    monkeypatch.chdir(tmp_path)
    command = attack(tmp_path / "suite", "--planner", tmp_path / "slow.py:Slow")
    command.wait_until((tmp_path / "driving").exists)
    command.send(signal.SIGINT)
    command.send(signal.SIGINT)
    command.send(signal.SIGINT)
    code, said = command.end()
    assert without_conflicts(said) == ["regents: interrupted; nothing is half-written, run the same command again"]
    assert code == 130
