"""The messages of the page on troubleshooting are those that users get."""

import re
from pathlib import Path

import pytest
from command import regents
from places import ROOT

from regents_cosim.cli.application import run
from regents_cosim.evaluation.crashes.failures import _WORDS_OF_NONE

PAGE = (ROOT / "docs/troubleshooting.md").read_text()
MESSAGES = [
    re.compile(".*?".join(map(re.escape, message.split("…"))))
    for heading in re.findall(r"^### (.*)$", PAGE, re.MULTILINE)
    for message in re.findall(r"`([^`]+)`", heading)
]
CASE = next(path for path in sorted((ROOT / "scenarios/quickstart").glob("*-focused-*")) if "harmless" not in path.name)
PROVOKED = {
    "not a log that is known": ("record", "--log", "x.csv", "-o", "out"),
    "no window found": ("record", "--log", "short.csv", "-o", "out"),
    "not found: did you mean": ("evaluate", CASE, "--planner", "iddm"),
    "cannot be imported": ("evaluate", CASE, "--planner", "none.py:Mine"),
    "is a Nothing, expected": ("evaluate", CASE, "--planner", "mine.py:Nothing"),
    "baseline not found": ("evaluate", CASE, "--planner", "idm", "--baseline", "none.json"),
}


@pytest.mark.slow
@pytest.mark.parametrize("said", PROVOKED)
def test_the_page_has_the_message(said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("x.csv").write_text("a,b\n1,2\n")
    Path("short.csv").write_text("id,time,x,y\na,0,0,0\na,0.1,1,0\n")
    Path("mine.py").write_text("class Nothing: pass\n")
    assert run([str(word) for word in PROVOKED[said]]) == 2
    last = capsys.readouterr().err.splitlines()[-1].replace("`", "")
    assert said in last
    assert [message.pattern for message in MESSAGES if message.search(last)], last


@pytest.mark.slow
def test_the_page_has_the_message_of_a_cache_that_others_can_write_to(tmp_path):
    """A process looks at the place of its cache once: before its first program."""
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache").chmod(0o777)
    done = regents("evaluate", CASE, "--planner", "idm", REGENTS_CACHE=str(tmp_path / "cache"))
    last = done.stderr.splitlines()[-1].replace("`", "")
    assert done.returncode == 2
    assert "can be written by others" in last
    assert [message.pattern for message in MESSAGES if message.search(last)], last


def test_it_explains_every_reason_why_a_window_holds_no_crash():
    explained = [message for message in MESSAGES for said in _WORDS_OF_NONE.values() if message.match(said)]
    assert len(explained) == len(_WORDS_OF_NONE)


def test_it_has_the_messages_of_twenty_errors():
    assert len(MESSAGES) >= 20
