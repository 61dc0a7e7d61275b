"""A planner that leaves is named by every command that drives it, and none ends with exit code 0."""

import subprocess
import sys
from pathlib import Path

import pytest
from command import regents
from params import slow
from shipped_cases import crash_on

from regents_cosim.cases.files import load_case
from regents_cosim.saving import SuiteWriter
from regents_cosim.system.c_exit import SAID

LEAVES = """
import os

import jax

from regents_cosim import Control, ControlArrays, JaxPlanner


def makes():
    os._exit(0)


class Acts:
    def reset(self, scene): pass
    def act(self, observation): raise SystemExit(0)


class Traced(JaxPlanner):
    def step(self, memory, sight, ego):
        raise KeyboardInterrupt


class CalledBack(JaxPlanner):
    def step(self, memory, sight, ego):
        speed = jax.lax.stop_gradient(ego.speed)
        zero = jax.pure_callback(lambda speed: os._exit(0), speed, speed, vmap_method="sequential")
        return ControlArrays(accel=zero, curvature=zero), memory
"""
IN_C = """
import ctypes

import jax

from regents_cosim import ControlArrays, JaxPlanner


class Mine(JaxPlanner):
    def step(self, memory, sight, ego):
        speed = jax.lax.stop_gradient(ego.speed)
        zero = jax.pure_callback(lambda speed: ctypes.CDLL(None).exit(0), speed, speed, vmap_method="sequential")
        return ControlArrays(accel=zero, curvature=zero), memory
"""
PLANNERS = {"makes": "SystemExit", "Acts": "SystemExit", "Traced": "KeyboardInterrupt", "CalledBack": "SystemExit"}


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    made = tmp_path_factory.mktemp("planners") / "leaves.py"
    made.write_text(LEAVES)
    return made


@pytest.fixture(scope="module")
def suite(tmp_path_factory):
    """One case, and what `constant_velocity` does there."""
    folder = tmp_path_factory.mktemp("suites") / "one"
    SuiteWriter(folder, 0).add(load_case(crash_on("crossing")))
    return folder


def commands(suite, planner, out):
    crossing = ("-c", "shipped:crossing")
    return {
        "evaluate": ("evaluate", suite, "--planner", planner),
        "evaluate in sumo": ("evaluate", suite, "--planner", planner, "--in", "sumo"),
        "against": ("evaluate", suite, "--planner", planner, "--baseline", suite / "baseline.json"),
        "replay": ("replay", suite, "--ego", "planner", "--planner", planner, "--in", "highway"),
        "replay in sumo": ("replay", suite, "--ego", "planner", "--planner", planner),
        "attack": ("attack", *crossing, "--count", 1, "--horizon", 3, "--planner", planner, "-o", out),
        "live": ("live", *crossing, "--longest", 2, "--planner", planner, "-o", out),
        "suite build": (
            "suite", "build", "--nets", "crossing", "--windows", 1, "--planner", planner, "-o", out,
        ),
        "report": ("report", suite, "--planner", planner, "-o", out / "page.html"),
    }  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("planner", [slow("makes"), "Acts", "Traced", "CalledBack"])
@pytest.mark.parametrize("command", ["evaluate", *map(slow, list(commands(Path(), "", Path()))[1:])])
def test_it_costs_the_case_and_says_so(suite, file, command, planner, tmp_path):
    out = tmp_path / "out"
    if command == "report":
        out.mkdir()
    if command == "against":
        words = ("evaluate", suite, "--planner", "constant_velocity", "--update")
        assert regents(*words).returncode == 0
    done = regents(*commands(suite, f"{file}:{planner}", out)[command])
    assert done.returncode in ({2} if planner == "makes" else {1, 2, 4}), done.stderr
    assert PLANNERS[planner] in done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("planner", PLANNERS)
def test_in_pytest(suite, file, planner, tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--regents-suite", suite,
         "--regents-planner", f"{file}:{planner}"],
        capture_output=True, text=True, cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == (4 if planner == "makes" else 1), done.stdout + done.stderr
    assert "INTERNALERROR" not in done.stdout + done.stderr
    assert PLANNERS[planner] in done.stdout + done.stderr


@pytest.fixture
def in_c(tmp_path):
    (tmp_path / "in_c.py").write_text(IN_C)
    return f"{tmp_path}/in_c.py:Mine"


@pytest.mark.slow
def test_a_command_that_a_planner_ends_in_c_fails_and_says_so(suite, in_c):
    done = regents("evaluate", suite, "--planner", in_c, code=70)
    assert done.stderr.splitlines()[-1].startswith(f"regents: {SAID}; ")


@pytest.mark.slow
@pytest.mark.parametrize("words", [(), ("-n", "1")])
def test_a_pytest_that_a_planner_ends_in_c_fails_and_says_so(suite, in_c, words, tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--regents-suite", suite,
         "--regents-planner", in_c, *words],
        capture_output=True, text=True, cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == (1 if words else 70), done.stdout + done.stderr
    assert ("crashed" if words else SAID) in done.stdout + done.stderr
