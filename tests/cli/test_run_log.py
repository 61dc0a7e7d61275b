"""`--verbose` and `--log-file`: what was done, case by case, and how the run ended."""

import logging
import re
import shutil
from pathlib import Path

import pytest

from regents_cosim.cases.shipped import shipped
from regents_cosim.cli import run
from regents_cosim.errors import PLANNER_FAILED

LINE = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d[+-]\d{4} (INFO|ERROR) regents_cosim\.[a-z_.]+: .+")


@pytest.fixture
def case(tmp_path):
    """A case of recorded traffic."""
    name = min(path.name for path in (shipped("scenarios") / "standard").glob("*-00*") if "focused" not in path.name)
    copy = shutil.copytree(shipped("scenarios") / "standard" / name, tmp_path / "suite" / name)
    shutil.copytree(shipped("scenarios") / "standard" / "maps", tmp_path / "suite" / "maps")
    return copy


def test_the_file_tells_what_was_done_and_grows_with_every_run(case, tmp_path, capsys):
    log = tmp_path / "log.txt"
    words = ["replay", str(case), "--in", "mirror", "--log-file", str(log)]
    assert run(words) == 0
    once = log.read_text().splitlines()
    assert all(map(LINE.fullmatch, once)), once
    assert any(f"replayed {case.name}: as expected" in line for line in once)
    assert any("replaying in mirror (1): done after" in line for line in once)
    assert "exit code 0 after" in once[-1]
    assert run(words) == 0
    assert log.read_text().splitlines()[: len(once)] == once
    assert capsys.readouterr().err == ""


def test_an_error_ends_the_file(tmp_path, capsys):
    log = tmp_path / "log.txt"
    assert run(["replay", str(tmp_path / "none\x1b[1m"), "--log-file", str(log)]) == 2
    *_, error, end = log.read_text().splitlines()
    assert " ERROR " in error
    assert "none\\x1b[1m" in error
    assert "exit code 2" in end
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_verbose_tells_stderr_with_times(case, capsys):
    assert run(["replay", str(case), "--in", "mirror", "-v"]) == 0
    told = capsys.readouterr().err.splitlines()
    assert all(re.match(r"\d\d:\d\d:\d\d ", line) for line in told)
    assert any(f"replayed {case.name}: as expected" in line for line in told)
    assert logging.getLogger("regents_cosim").handlers == []


def test_verbose_shows_where_a_planner_failed(case, tmp_path, capsys):
    lost = 'class Lost(JaxPlanner):\n    def step(self, memory, sight, ego):\n        raise KeyError("lost")\n'
    (tmp_path / "lost.py").write_text(f"from regents_cosim import JaxPlanner\n{lost}")
    assert run(["evaluate", str(case), "--planner", f"{tmp_path}/lost.py:Lost", "-v"]) == PLANNER_FAILED
    told = capsys.readouterr().err.splitlines()
    assert any(re.match(rf'\d\d:\d\d:\d\d {case.name}: .*lost.py", line 4, in step', line) for line in told), told


def test_a_file_that_cannot_be_written_is_one_line_and_costs_nothing_later(case, tmp_path, capsys):
    assert run(["replay", str(case), "--in", "mirror", "--log-file", str(tmp_path / "none" / "log.txt")]) == 2
    assert "choose another file" in capsys.readouterr().err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_disk_that_is_full_ends_the_log_and_not_the_run(case, capsys):
    assert run(["replay", str(case), "--in", "mirror", "--log-file", "/dev/full"]) == 0
    (said,) = capsys.readouterr().err.splitlines()
    assert "the log ends here" in said
