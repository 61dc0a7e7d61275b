"""The examples run outside the repository, with short searches but for the one that proves something."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from places import ROOT
from shipped_cases import crash_on
from short_searches import short_script

from regents_cosim.cases.files import load_case
from regents_cosim.exports.commonroad import write_commonroad

EXAMPLES = ROOT / "examples"
PLANNERS = ("my_planner.py", "route_planner.py", "tree_search.py")  # no scripts
SCRIPTS = sorted(path.name for path in EXAMPLES.glob("*.py") if path.name not in PLANNERS)

APART = ("find_fix_prove.py", "in_their_simulator.py", "train_under_attack.py")


def run(script, folder, *words, short=short_script):
    for file in EXAMPLES.glob("*.py"):
        (folder / file.name).write_text(short(file.read_text()))
    done = subprocess.run([sys.executable, script, *words], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_each_is_listed():
    text = (EXAMPLES / "README.md").read_text()
    assert all(f"`{path.name}`" in text for path in EXAMPLES.iterdir() if path.name not in ("README.md", "__pycache__"))


@pytest.mark.slow
@pytest.mark.parametrize("script", [name for name in SCRIPTS if name not in APART])
def test_a_script_runs(script, tmp_path):
    assert run(script, tmp_path)


@pytest.mark.slow
def test_a_policy_is_trained_under_attack(tmp_path):
    pytest.importorskip("stable_baselines3", reason="stable-baselines3 is an extra")
    lines = run("train_under_attack.py", tmp_path, "--steps", "60", "--episodes", "2").splitlines()
    assert len(lines) == 7


@pytest.mark.slow
@pytest.mark.parametrize("planner", ["idm", "fiss"])
def test_a_planner_of_others_drives_an_exported_case_with_its_own_tools(planner, tmp_path):
    """The interpreters are those of `tests/planners/test_adapters.py`; that of FISS+ has `fiss-planner[commonroad]`."""
    variable = f"REGENTS_{planner.upper()}_PLANNER"
    python = os.environ.get(variable) or pytest.skip(f"{variable} names no interpreter")
    write_commonroad(load_case(crash_on("crossing")), tmp_path)
    words = [python, str(EXAMPLES / "in_their_simulator.py"), planner, str(tmp_path), "3"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"collision at \d+\.\d s with \S+ \(\w+\)|no collision", done.stdout.splitlines()[-1])


def test_a_planner_that_is_none_of_them_is_named():
    words = [sys.executable, str(EXAMPLES / "in_their_simulator.py"), "foo", "exported", "3"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert "invalid choice: 'foo'" in done.stderr
    assert "Traceback" not in done.stderr


def in_three_windows(text):
    """The first three of its eight."""
    return text.replace('prefer="none")', 'prefer="none")[:3]')


@pytest.mark.slow
def test_a_bug_is_found_fixed_and_the_fix_proven(tmp_path):
    said = run("find_fix_prove.py", tmp_path, short=in_three_windows).splitlines()
    numbers = [[int(word) for word in line.replace(",", "").split() if word.isdigit()] for line in said]
    (found,), (before, after), (ordinary_before, ordinary_after), (new, _, old) = numbers[:4]
    assert before == found > after
    assert (ordinary_before, ordinary_after) == (0, 0)
    assert new < old
    assert (tmp_path / "old_and_fixed.html").stat().st_size > 50_000


@pytest.mark.slow
def test_the_notebook_runs(tmp_path):
    """Its cells in their order; the last expression of each as a notebook shows it is left out."""
    cells = json.loads((EXAMPLES / "tour.ipynb").read_text())["cells"]
    (tmp_path / "tour.py").write_text("\n\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "code"))
    done = subprocess.run([sys.executable, "tour.py"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "crash.png").stat().st_size > 10_000


def test_the_notebook_shows_what_it_found():
    """Read without being run: a telling crash, verified, with its picture; and no path of the machine that ran it."""
    cells = json.loads((EXAMPLES / "tour.ipynb").read_text())["cells"]
    assert all(cell["outputs"] for cell in cells if cell["cell_type"] == "code")
    said = json.dumps([cell.get("outputs") for cell in cells])
    assert "'telling': True" in said
    assert "image/png" in said
    assert "Traceback" not in said
    assert str(Path.home()) not in said
