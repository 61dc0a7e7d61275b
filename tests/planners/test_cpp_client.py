"""The example `examples/my_planner.cpp` and its header, which make a program for `exec:` of a class in C++."""

import json
import shutil
import subprocess

import pytest
from places import ROOT
from shipped_cases import shipped_window

from regents_cosim.evaluation.drives.driving import drive_each

COMPILER = shutil.which("g++") or shutil.which("clang++")
pytestmark = [pytest.mark.slow, pytest.mark.skipif(COMPILER is None, reason="no compiler of C++")]


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    made = tmp_path_factory.mktemp("cpp") / "my_planner"
    source = ROOT / "examples/my_planner.cpp"
    subprocess.run([COMPILER, "-std=c++17", "-Wall", "-Wextra", "-Werror", "-o", made, source], check=True)
    return made


def test_it_drives(program):
    (drive,) = drive_each([shipped_window("signals")], f"exec:{program}")
    assert not drive.error
    assert drive.hits is None
    assert drive.completion > 0.7


def test_it_answers_every_line(program):
    """A question without what the planner needs is given up with a reason, and the next one is answered."""
    ego = {"x": 0.0, "y": 0.0, "yaw": 0.0, "speed": 5, "id": 'an "odd\\ {name}, [é'}
    ahead = {"route": {"points": [[0.0, 0.0], [1e1, 0], [20.0, -5e-1]]}}
    clear, none = {"ego": ego, "leader": None, "lights_ahead": []}, {"ego": {}}
    questions = [{"reset": ahead}, {"act": clear}, {"act": none}, {"act": clear}]
    lines = "".join(json.dumps(one) + "\n" for one in questions)
    said = subprocess.run([program], input=lines, capture_output=True, text=True, check=True).stdout.splitlines()
    reset, first, lost, second = map(json.loads, said)
    assert reset == {"ok": True}
    assert first == second
    assert first["accel"] > 1.0
    assert first["curvature"] == pytest.approx(0.0, abs=1e-9)
    assert "expected a number" in lost["error"]
