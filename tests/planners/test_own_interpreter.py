"""Planners in an environment of their own, whose packages clash with ours: a real one, made for these tests."""

import venv
from pathlib import Path

import numpy
import pytest
from command import regents
from scenes import scene

from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import REGENTS
from regents_cosim.errors import DriveError, PlannerError
from regents_cosim.planners.find import planner_of
from regents_cosim.planners.hosting.host_process import HostProcess
from regents_cosim.planners.interface import Scene, Snapshot
from regents_cosim.planners.under_test import PlannerUnderTest

SITE = Path(numpy.__file__).parents[1]
LENT = ("numpy", "numpy.libs", "msgspec", "shapely", "shapely.libs", "jaxtyping", "wadler_lindig")

ADAPTER = """
import sys
import clashing  # only in that environment
from regents_cosim import Control, Debug

class Mine:
    def reset(self, scene):
        assert "jax" not in sys.modules and clashing.VERSION == "0.1"
        self.scene = scene
    def act(self, observation):
        assert observation.scene is self.scene
        return Control(accel=-1.5, curvature=0.0, debug=Debug(text="brakes"))

class NotCalled(Mine):
    def __init__(self):
        raise ValueError("only the drive makes it")

class HasNoAct:
    pass

def leaves():
    import os
    print("on the way", flush=True)
    os._exit(3)

class Fails(Mine):
    def act(self, observation):
        if observation.step:
            import msgpack_that_nobody_has
        return super().act(observation)
"""


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """The interpreter of an environment that has what hosting needs, a package of its own, and nothing of ours."""
    folder = tmp_path_factory.mktemp("own")
    venv.create(folder, with_pip=False, symlinks=True)
    (site,) = folder.glob("lib/python*/site-packages")
    for name in LENT:
        for place in (*SITE.glob(name), *SITE.glob(f"{name}-*.dist-info")):
            (site / place.name).symlink_to(place)
    (site / "clashing.py").write_text('VERSION = "0.1"\n')
    return folder / "bin" / "python"


@pytest.fixture
def adapter(tmp_path):
    file = tmp_path / "my_adapter.py"
    file.write_text(ADAPTER)
    return file


@pytest.mark.slow
def test_it_drives_in_an_attack(python, adapter):
    planner = PlannerUnderTest.of(f"python:{python}:{adapter}:Mine")
    assert planner.where == "own process"
    made = scene((0, 0, 10), (20, 0, 8), steps=6)
    attacked = attack([made], REGENTS.but(iterations=1), planner=planner)
    (case,) = attacked
    assert case.attack.planner == planner.name
    assert case.attack.outcome in ("collision", "no_collision")
    with pytest.raises(PlannerError, match="what a case names is not run"):
        planner_of(case)


def test_what_it_thinks_and_raises_is_said_with_its_own_lines(python, adapter):
    host = HostProcess("mine", planner=f"python:{python}:{adapter}:Fails")
    try:
        made = scene((0, 0, 10), steps=6)
        host.reset([Scene.of(made, 6.0, 0.3)])
        tracks = made.tracks
        seen = Snapshot(*(v[:, 0] for v in (tracks.x, tracks.y, tracks.yaw, tracks.speed, tracks.valid)))
        (answer,) = host.act(0, [seen], debug=True)
        assert answer.decision.debug.text == "brakes"
        with pytest.raises(DriveError, match="ModuleNotFoundError: No module named 'msgpack_that_nobody_has'") as said:
            host.act(1, [seen])
        assert "my_adapter.py" in said.value.trace
    finally:
        host.close()


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("python:", "expected python:INTERPRETER:FILE.py:CLASS"),
        ("python:nowhere/python:a.py:Mine", "'nowhere/python' of the planner is neither an executable file nor"),
        ("python:/bin/true:a.py:Mine", "'/bin/true' of the planner is no Python 3.11 or newer"),
    ],
)
def test_a_name_that_does_not_fit_is_refused_in_one_line(name, said):
    with pytest.raises(PlannerError, match=said):
        PlannerUnderTest.of(name)


def test_an_environment_that_lacks_a_package_is_told_what_to_install(tmp_path):
    venv.create(tmp_path, with_pip=False, symlinks=True)
    python = tmp_path / "bin" / "python"
    with pytest.raises(PlannerError, match="lacks numpy, msgspec, shapely, jaxtyping: .* -m pip install numpy"):
        PlannerUnderTest.of(f"python:{python}:a.py:Mine")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("my_adapter.py:Nine", r"my_adapter.py has no 'Nine' \(did you mean Mine\?\)"),
        ("my_adapter.py:HasNoAct", "is a HasNoAct, expected a JaxPlanner, or an object with"),
        ("my_adapter.py:leaves", "cannot be made: SystemExit: 3"),
        ("none.py:Mine", "'none.py:Mine' cannot be imported: FileNotFoundError"),
        ("lacking.py:Mine", r"No module named 'nobody_has_it' \(lacking.py, line 1\); install it with .*python -m pip"),
    ],
)
def test_a_planner_that_is_not_there_is_refused_before_it_drives(python, adapter, monkeypatch, name, said):
    monkeypatch.chdir(adapter.parent)
    adapter.with_name("lacking.py").write_text("import nobody_has_it\n")
    with pytest.raises(PlannerError, match=said):
        PlannerUnderTest.of(f"python:{python}:{name}")
    assert PlannerUnderTest.of(f"python:{python}:my_adapter.py:NotCalled").where == "own process"


@pytest.mark.slow
def test_commands_take_it(python, adapter, tmp_path):
    mine = f"python:{python}:{adapter.name}:Mine"
    done = regents("evaluate", "shipped:quickstart", "--planner", mine, cwd=tmp_path, code=0)
    assert "Mine" in done.stdout
