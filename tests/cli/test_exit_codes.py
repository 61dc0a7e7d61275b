"""What `regents` exits with; 130 and 143 are in test_interruption, 70 in test_leaving_planners_commands.

3 for the libraries of SUMO is in test_cli.
"""

import json
import os
import shutil

import pytest
from command import regents
from params import slow
from shipped_cases import QUICKSTART, crash_on

from regents_cosim.cases.shipped import shipped

CODES = ("0", "1", "2", "3", "4", "70", "130", "143")


@pytest.fixture(scope="module")
def case():
    return crash_on("merge")


@pytest.fixture(scope="module")
def failing(tmp_path_factory):
    """A planner that raises."""
    file = tmp_path_factory.mktemp("planners") / "failing.py"
    file.write_text(
        "class Failing:\n    def reset(self, scene): pass\n    def act(self, observation): raise KeyError('boom')\n"
    )
    return f"{file}:Failing"


def without(package, tmp_path):
    """An environment in which a package is not installed."""
    (tmp_path / f"{package}.py").write_text(f"raise ModuleNotFoundError('no {package}', name='{package}')")
    return {"PYTHONPATH": f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}


def complaint(done):
    """The one line on stderr."""
    (line,) = done.stderr.splitlines()
    assert line.startswith("regents: ")
    return line


def test_help_and_the_documentation_name_them():
    said = " ".join(regents("--help").stdout.split("Exit codes:")[1].split())
    table = (shipped("scenarios").parent / "docs" / "command-line.md").read_text()
    for code in CODES:
        assert f"{code} " in said
        assert f"| {code} |" in table


def test_0_all_is_well(case):
    assert regents("replay", case, "--in", "mirror", "--json").returncode == 0


@pytest.mark.slow
def test_1_a_suite_that_fails_its_check(case, tmp_path):
    shutil.copytree(QUICKSTART, tmp_path / "suite")
    (tmp_path / "suite" / case.name / "tracks.npz").write_bytes(b"")
    assert regents("suite", "check", tmp_path / "suite").returncode == 1


@pytest.mark.slow
def test_2_a_window_without_a_display_before_anything_starts(case):
    done = regents("replay", case, "--gui", DISPLAY="", code=2)
    assert "DISPLAY is not set" in complaint(done)
    assert done.stdout == ""


@pytest.mark.parametrize("name", ["no_such_planner", slow("torch:pathlib:Path"), slow("collections:OrderedDict")])
def test_2_a_planner_that_is_not_there_or_is_something_else(case, tmp_path, name):
    if name.startswith("torch"):
        pytest.importorskip("torch", reason="torch is an extra")
    done = regents("evaluate", case, "--planner", name, code=2)
    assert name in complaint(done)


def test_3_a_package_that_is_not_installed(case, tmp_path):
    done = regents("replay", case, "--executor", "dask:tcp://127.0.0.1:1", **without("distributed", tmp_path), code=3)
    assert "pip install '.[dask]'" in complaint(done)


@pytest.mark.parametrize("where", ["mirror", pytest.param("sumo", marks=pytest.mark.slow)])
def test_4_a_planner_that_fails(case, failing, where):
    done = regents("evaluate", case, "--planner", failing, "--in", where, "--json", code=4)
    assert json.loads(done.stdout)[0]["planner_errors"] == 1
    assert "KeyError: 'boom'" in done.stderr


@pytest.mark.slow
def test_4_comes_before_1(case, failing):
    done = regents("replay", case, "--planner", failing, "--json", code=4)
    assert json.loads(done.stdout)[0]["verified"] is False


@pytest.mark.slow
def test_1_for_a_planner_that_fails_against_a_baseline(case, failing, tmp_path):
    shutil.copytree(QUICKSTART, tmp_path / "suite")
    words = ("evaluate", tmp_path / "suite" / case.name, "--as", "mine", "--planner")
    assert regents(*words, "idm", "--update").returncode == 0
    assert regents(*words, failing, "--update").returncode == 4  # such an outcome is not accepted
    assert regents(*words, failing, "--baseline", tmp_path / "suite" / "baseline.json").returncode == 1
