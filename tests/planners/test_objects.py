"""Planners handed over as objects: a class, an instance or a factory, wherever they were defined."""

import subprocess
import sys
import threading
from dataclasses import dataclass
from textwrap import dedent

import host_planners
import numpy as np
import pytest
from mirror_drives import replay_in_mirror
from params import slow
from places import SUPPORT
from scenes import scene

from regents_cosim import Control, ControlArrays, JaxPlanner
from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import REGENTS
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.errors import PlannerError
from regents_cosim.evaluation.drives.driving import drive_each
from regents_cosim.planners.idm import IDM
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.replays.replay import replay

BUSY = scene((0, 0, 10), (20, 3.2, 8), (30, 3.2, 9))
QUICK = REGENTS.but(iterations=20)


@dataclass
class Keeps:
    """A planner that brakes for any agent close ahead."""

    gap_m: float = 15.0

    def reset(self, scene):
        self.asked = 0

    def act(self, observation):
        self.asked += 1
        seen = [other.seen_from(observation.ego) for other in observation.others]
        near = any(0.0 < ahead < self.gap_m and abs(left) < 2.0 for ahead, left in seen)
        return Control(accel=-4.0 if near else 1.0, curvature=0.0)


class Locked(Keeps):
    """A planner that holds a value that cannot be pickled."""

    def __init__(self):
        super().__init__()
        self.lock = threading.Lock()
        self.fail_at = -1

    def act(self, observation):
        if observation.step == self.fail_at:
            raise KeyError("lost")
        return super().act(observation)


class Push(JaxPlanner):
    push: float = 1.0

    def step(self, memory, sight, ego):
        return ControlArrays(accel=self.push * 0.0 + 1.0, curvature=sight.motion.x[0] * 0.0), memory


def local_class():
    class Local(Keeps):
        pass

    return Local


@pytest.mark.parametrize(
    ("planner", "name", "where"),
    [
        ("idm", "idm", "compiled loop"),
        (IDM, "idm", "compiled loop"),
        (IDM(), "idm", "compiled loop"),
        (IDM(time_headway=0.2), "regents_cosim.planners.idm:IDM(time_headway=0.2)", "compiled loop"),
        (Push(2.0), "test_objects:Push(push=2.0)", "compiled loop"),
        (Keeps, "test_objects:Keeps", "own process"),
        (Keeps(), "test_objects:Keeps", "own process"),
        (Keeps(20.0), "test_objects:Keeps(gap_m=20.0)", "own process"),
        (host_planners.Cautious(), "host_planners:Cautious", "own process"),
        (local_class(), "test_objects:local_class.<locals>.Local", "own process"),
        (lambda: Keeps(), "test_objects:<lambda>", "own process"),
        (Locked, "test_objects:Locked", "own process"),
        (Locked(), "test_objects:Locked", "this process"),
        (PlannerUnderTest.of(Keeps(), name="mine", own_process=False), "mine", "this process"),
    ],
)
def test_what_it_is_called_and_where_it_runs(planner, name, where):
    found = PlannerUnderTest.of(planner)
    assert (found.name.rpartition("tests.")[2], found.where) == (name, where)


@pytest.mark.parametrize(
    ("planner", "said"),
    [
        (3, "is a int, expected a JaxPlanner"),
        (dict, "builtins:dict' is a dict, expected a JaxPlanner"),
        (lambda needed: None, "cannot be made: TypeError"),
    ],
)
def test_what_is_no_planner(planner, said):
    with pytest.raises(PlannerError, match=said):
        PlannerUnderTest.of(planner)


@pytest.mark.parametrize("name", ["idm", "idm:time_headway=0.2", "two words"])
def test_a_name_of_its_own_is_none_of_ours(name):
    with pytest.raises(PlannerError, match="expected one without blanks that none of ours has"):
        PlannerUnderTest.of(Keeps(), name=name)


@pytest.mark.slow
def test_by_name_as_an_object_and_in_this_process_it_drives_the_same():
    by_name = replay_in_mirror(BUSY, "host_planners:Cautious")
    for planner in (host_planners.Cautious(), Locked(), local_class()()):
        tracks = replay_in_mirror(BUSY, planner)
        for field in ("x", "y", "yaw", "speed"):
            assert np.array_equal(getattr(tracks, field), getattr(by_name, field)), (planner, field)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "planner"), [("host_planners:Cautious", host_planners.Cautious()), ("idm", IDM())], ids=["host", "jax"]
)
def test_attacked_by_name_and_as_an_object_the_cases_are_the_same(name, planner):
    first, second = (next(attack([BUSY], QUICK, one)) for one in (name, planner))
    assert content_hash(first) == content_hash(second)
    assert first.attack.planner == second.attack.planner


def test_one_that_raises_in_this_process_says_where():
    here = Locked()
    here.fail_at = 5
    (failed,) = drive_each([BUSY], here)
    assert "failed in `act` at step 5: KeyError: 'lost'" in failed.error
    assert "in act" in failed.trace


def test_in_this_process_it_can_be_looked_at_afterwards():
    mine = Keeps()
    list(drive_each([BUSY], PlannerUnderTest.of(mine, own_process=False)))
    assert mine.asked == BUSY.tracks.steps - 1


@pytest.mark.slow
@pytest.mark.parametrize("planner", [Locked(), slow(Keeps())], ids=["this process", "own process"])
def test_it_drives_in_sumo(planner):
    found = replay(BUSY, "sumo", planner)
    assert not found.planner_failed, found.reason
    inside = replay_in_mirror(BUSY, planner)
    assert np.abs(found.replayed.tracks.x[0] - inside.x[0]).max() < 0.05


@pytest.mark.slow
def test_what_fails_in_this_process_is_said_in_sumo_too():
    here = Locked()
    here.fail_at = 5
    found = replay(BUSY, "sumo", here)
    assert found.planner_failed
    assert "KeyError: 'lost'" in found.reason


@pytest.mark.slow
def test_it_drives_in_highway_env():
    assert not replay(BUSY, "highway", Locked()).planner_failed


# --- defined in a script, in a notebook, in a test ------------------------------------------------

MINE = """
    from regents_cosim import Control

    LIMIT = 15.0

    class Mine:
        def reset(self, scene):
            pass

        def act(self, observation):
            seen = [other.seen_from(observation.ego) for other in observation.others]
            near = any(0.0 < ahead < LIMIT and abs(left) < 2.0 for ahead, left in seen)
            return Control(accel=-4.0 if near else 1.0, curvature=0.0)
"""
USED = """
    import sys
    from scenes import scene
    from regents_cosim.evaluation.drives.driving import drive_each
    from regents_cosim.planners.under_test import PlannerUnderTest

    planner = PlannerUnderTest.of(Mine())
    (drive,) = drive_each([scene((0, 0, 10), (20, 3.2, 8), (30, 3.2, 9))], planner)
    print(planner.name, planner.where, sep="|")
    print(drive.completion, drive.error)
"""


def ended(words, folder, given=None):
    path = [str(SUPPORT), *sys.path]
    code = f"import sys; sys.path[:0] = {path!r}\n"
    done = subprocess.run(
        [sys.executable, *words(code)], cwd=folder, input=given and code + given, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    called, drove = done.stdout.splitlines()
    name, where = called.split("|")
    completion, _, error = drove.partition(" ")
    assert error == ""
    return name, where, float(completion)


def as_script(folder):
    """Run code as a script without a `__main__` guard, since nothing imports it again."""

    def words(code):
        (folder / "script.py").write_text(code + dedent(MINE + USED))
        return ["script.py"]

    return ended(words, folder)


def as_notebook(folder):
    """Cells are executed in `__main__`, which has no file."""
    cells = [dedent(MINE), dedent(USED)]
    return ended(lambda _: ["-"], folder, "\n".join(f"exec(compile({cell!r}, 'cell', 'exec'))" for cell in cells))


@pytest.mark.slow
def test_a_class_of_a_script(tmp_path):
    name, where, _ = as_script(tmp_path)
    assert (name, where) == ("script.py:Mine", "own process")


@pytest.mark.slow
def test_a_class_of_a_notebook_drives_as_that_of_a_script(tmp_path):
    name, where, completion = as_notebook(tmp_path)
    assert (name, where) == ("__main__:Mine", "own process")
    assert completion == as_script(tmp_path)[2]


TEST = """
    def test_mine(regents):
        drive = regents.drive(SCENE, planner=Mine())
        assert (drive.error, drive.hits) == ("", None)
        assert regents.drive(SCENE, planner=PlannerUnderTest.of(Mine(), own_process=False)).score == drive.score
"""


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["prepend", "importlib"])
def test_a_class_of_a_test(tmp_path, mode):
    setup = f"""
    import sys
    sys.path.insert(0, {str(SUPPORT)!r})
    from scenes import scene
    from regents_cosim.planners.under_test import PlannerUnderTest
    SCENE = scene((0, 0, 10), (20, 3.2, 8), (30, 3.2, 9))
    """
    (tmp_path / "test_mine.py").write_text(dedent(setup) + dedent(MINE) + dedent(TEST))
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", f"--import-mode={mode}", "test_mine.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
