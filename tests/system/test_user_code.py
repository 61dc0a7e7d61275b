"""Planners of several files: found as Python finds them, in every process, and never in a suite."""

import json
import sys
from pathlib import Path
from textwrap import dedent

import pytest
from command import regents
from scenes import scene
from shipped_cases import crash_on

from regents_cosim.errors import PlannerError
from regents_cosim.planners.closed_loop import scene_of
from regents_cosim.planners.find import find_attribute, make_planner
from regents_cosim.planners.hosting.host_process import HostProcess
from regents_cosim.saving import SuiteWriter
from regents_cosim.simulators.highway.agents import find_agent
from regents_cosim.system import user_code
from regents_cosim.system.user_code import import_named, suite_around

MAIN = """
from __future__ import annotations
from dataclasses import dataclass
from sib import ACCEL
from regents_cosim import Control

@dataclass
class Held:
    accel: float = ACCEL

class P:
    def reset(self, scene):
        import late
    def act(self, observation):
        return Control(accel=Held().accel, curvature=0.0)
"""


@pytest.fixture(autouse=True)
def as_before(monkeypatch):
    """What a test searches, and imports, is forgotten after it."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(user_code, "_SEARCHED", [])
    known = set(sys.modules)
    yield
    for name in set(sys.modules) - known:
        if name.partition(".")[0] in ("sib", "late", "main", "mine", "pkg", "sharp"):
            del sys.modules[name]


def project(folder, accel=-1.0, package="pkg"):
    """A planner of three files in a package that has no __init__.py, as people have it."""
    home = folder / package
    home.mkdir(parents=True)
    (home / "main.py").write_text(dedent(MAIN))
    (home / "sib.py").write_text(f"ACCEL = {accel}\n")
    (home / "late.py").write_text("")
    of_package = dedent(MAIN).replace("from sib", "from pkg.sib").replace("import late", "import pkg.late")
    (home / "mod.py").write_text(of_package)
    return home


NAMES = ["pkg/main.py:P", "pkg.mod:P"]


@pytest.mark.parametrize("name", NAMES)
def test_a_planner_of_several_files_is_made(tmp_path, monkeypatch, name):
    project(tmp_path)
    monkeypatch.chdir(tmp_path)
    planner = make_planner(name)
    planner.reset(None)  # imports what lies beside it as late as now
    assert planner.act(None).accel == -1.0


@pytest.mark.parametrize("name", NAMES)
def test_the_process_of_a_planner_finds_the_files_too(tmp_path, monkeypatch, name):
    project(tmp_path)
    monkeypatch.chdir(tmp_path)
    process = HostProcess(name)
    try:
        process.reset([scene_of(scene((0.0, 0.0, 10.0), (30.0, 0.0, 10.0)))])
    finally:
        process.close()


@pytest.mark.parametrize("name", ["numpy", "json"])
def test_a_file_called_like_a_module_that_its_process_needs_hides_none(tmp_path, monkeypatch, name):
    (tmp_path / f"{name}.py").write_text("class P:\n    def reset(self, scene): pass\n    def act(self, seen): pass\n")
    find_attribute(f"{tmp_path}/{name}.py:P")  # as the command does before it starts the process
    process = HostProcess(f"{tmp_path}/{name}.py:P")
    try:
        process.reset([scene_of(scene((0.0, 0.0, 10.0), (30.0, 0.0, 10.0)))])
    finally:
        process.close()


def test_a_planner_may_lie_where_the_package_itself_is_found(tmp_path, monkeypatch):
    """As in a checkout, or beside installed packages."""
    package = Path(user_code.__file__).parents[1]
    (tmp_path / package.name).symlink_to(package)
    (tmp_path / "mine.py").write_text("class P:\n    def reset(self, scene): pass\n    def act(self, seen): pass\n")
    sys.path[:] = [
        str(tmp_path),
        *(place for place in sys.path if not (Path(place) / package.name / "__init__.py").exists()),
    ]
    monkeypatch.chdir(tmp_path)
    for name in ("mine.py:P", "mine:P"):
        find_attribute(name)
        process = HostProcess(name)
        try:
            process.reset([scene_of(scene((0.0, 0.0, 10.0), (30.0, 0.0, 10.0)))])
        finally:
            process.close()


def test_two_versions_of_a_planner_each_have_their_own_files(tmp_path):
    old, new = (project(tmp_path / name, accel) for name, accel in (("old", -1.0), ("new", -2.0)))
    for _ in range(2):
        for home, accel in ((old, -1.0), (new, -2.0)):
            assert make_planner(f"{home}/main.py:P").act(None).accel == accel


def test_a_policy_of_several_files_is_found(tmp_path):
    home = project(tmp_path)
    (home / "policy.py").write_text("import sib\ndef drive(observation): return sib.ACCEL\n")
    assert find_agent(f"{home}/policy.py:drive").act(None) == -1.0


def test_installed_modules_need_no_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = list(sys.path)
    find_attribute("constant_velocity")
    import_named("json", "test", installed=True)
    assert sys.path == before


# --- suites -----------------------------------------------------------------------------------


@pytest.mark.parametrize("inside", [".", "scene", "maps"])
def test_a_suite_is_not_searched_for_modules(tmp_path, monkeypatch, inside):
    suite = tmp_path / "suite"
    SuiteWriter(suite, 0).add(scene((0.0, 0.0, 10.0)))
    assert suite_around(suite / inside) == (suite if inside != "scene" else suite / "scene")
    project(suite / inside)
    monkeypatch.chdir(suite / inside)
    before = list(sys.path)
    for name in NAMES:
        with pytest.raises(PlannerError, match=r"No module named '(sib|pkg)'.*lies in the suite"):
            make_planner(name)
    (suite / inside / "alone.py").write_text("class P:\n    reset = act = lambda self, given: None\n")
    make_planner("alone.py:P")  # the user has named that file
    assert sys.path == before


def test_a_module_that_leaves_python_is_an_error(tmp_path):
    (tmp_path / "leaves.py").write_text("raise SystemExit(0)\n")
    with pytest.raises(PlannerError, match="SystemExit"):
        make_planner(f"{tmp_path}/leaves.py:P")


# --- as users have it -------------------------------------------------------------------------


@pytest.mark.slow
def test_a_file_that_drives_its_planner_when_it_is_imported_is_an_error(tmp_path):
    """It waited for itself without end."""
    drives = "from regents_cosim import evaluate\nevaluate('shipped:quickstart', P, progress=False)\n"
    (tmp_path / "sib.py").write_text("ACCEL = 0.0")
    (tmp_path / "late.py").touch()
    (tmp_path / "main.py").write_text(MAIN + drives)
    done = regents("evaluate", crash_on("crossing"), "--planner", "main.py:P", cwd=tmp_path, code=2)
    assert 'put calls such as `evaluate` after `if __name__ == "__main__":`' in done.stderr
    (tmp_path / "main.py").write_text(f"{MAIN}if __name__ == '__main__':\n    {drives.splitlines()[0]}\n")
    regents("evaluate", crash_on("crossing"), "--planner", "main.py:P", cwd=tmp_path, code=0)


@pytest.mark.slow
@pytest.mark.parametrize("where", ["mirror", "sumo"])
@pytest.mark.parametrize("name", NAMES)
def test_the_command_line_drives_a_planner_of_several_files(tmp_path, name, where):
    from regents_cosim.cases.manifest import find_cases
    from regents_cosim.cases.shipped import shipped

    project(tmp_path)
    case = find_cases(shipped("scenarios") / "quickstart")[0]
    done = regents("evaluate", case, "--planner", name, "--in", where, "--json", cwd=tmp_path, code=0)
    assert json.loads(done.stdout)[0]["planner_errors"] == 0


@pytest.mark.slow
@pytest.mark.parametrize("compiled", [False, True])
def test_files_called_like_modules_that_the_process_of_sumo_needs_hide_none(tmp_path, compiled):
    from regents_cosim.cases.manifest import find_cases
    from regents_cosim.cases.shipped import shipped

    project(tmp_path)
    mine = tmp_path / "pkg/secrets.py"
    (tmp_path / "pkg/main.py").rename(mine)
    for name in ("random", "tempfile", "gzip", "queue"):
        (tmp_path / f"pkg/{name}.py").write_text("raise ImportError('not for others')\n")
    if compiled:
        mine.write_text("from regents_cosim.planners.blind import ConstantVelocity\nclass P(ConstantVelocity): pass\n")
    case = find_cases(shipped("scenarios") / "quickstart")[0]
    done = regents("evaluate", case, "--planner", "pkg/secrets.py:P", "--in", "sumo", "--json", cwd=tmp_path, code=0)
    assert json.loads(done.stdout)[0]["planner_errors"] == 0
