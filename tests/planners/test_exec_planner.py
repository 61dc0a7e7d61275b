"""Planners in other processes: real commands, small Python scripts here."""

import fcntl
import json
import re
import shlex
import sys
import time

import pytest
from scenes import scene

from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import REGENTS
from regents_cosim.errors import DriveError, PlannerError
from regents_cosim.planners.hosting.exec_planner import ExecPlanner
from regents_cosim.planners.hosting.host_process import HostProcess, Snapshot
from regents_cosim.planners.interface import Control, Observation, Others, Scene, Waypoints
from regents_cosim.planners.time_limits import Deadlines

# What it was asked goes to a file; what it answers is an expression of the question and the id of the scene.
SCRIPT = """
import json, os, sys, time
answers, heard = sys.argv[1:]
for line in sys.stdin:
    with open(heard, "a") as file:
        file.write(line)
    asked = json.loads(line)
    scene = asked["reset"]["id"] if "reset" in asked else scene
    said = {"ok": True} if "reset" in asked else eval(answers)
    print(said if isinstance(said, str) else json.dumps(said), flush=True)
"""

# Deaf to everything, its stdin included.
HOLDS = """
import fcntl, sys, time
lock = open(sys.argv[1], "w")
fcntl.flock(lock, fcntl.LOCK_EX)
sys.stdin.readline()  # the reset: an answer before the question is an error
print('{"ok": true}', flush=True)
time.sleep(60)
"""


@pytest.fixture
def planner(tmp_path):
    """The name of a planner that answers `act` with the value of an expression of `asked`."""
    script = tmp_path / "planner.py"
    script.write_text(SCRIPT)

    def name(answer: str) -> str:
        return "exec:" + shlex.join([sys.executable, "-S", str(script), answer, str(tmp_path / "heard")])

    return name


MADE = scene((0, 0, 10), (20, 0, 8), (30, 3.2, 9), steps=6)


def told(made=MADE):
    return Scene.of(made, 6.0, 0.3)


def seen(step=0, made=MADE):
    tracks = made.tracks
    return Snapshot(*(v[:, step] for v in (tracks.x, tracks.y, tracks.yaw, tracks.speed, tracks.valid, tracks.z)))


def observation(step=0):
    now = seen(step)
    return Observation(told(), step, told().ego, Others(told().others, *(values[1:] for values in now)))


def made(name: str) -> ExecPlanner:
    return ExecPlanner(name.removeprefix("exec:"))


def test_what_is_asked_and_answered(planner, tmp_path):
    under_test = made(planner('{"accel": asked["act"]["others"][0]["x"] / 10, "curvature": -0.25}'))
    for _ in range(2):
        under_test.reset(told())
        assert under_test.act(observation(0)) == Control(2.0, -0.25)
        assert under_test.act(observation(4)).accel == pytest.approx(2.32)
    asked = [json.loads(line) for line in (tmp_path / "heard").read_text().splitlines()]
    assert [list(question) for question in asked] == [["reset"], ["act"], ["act"]] * 2
    reset, act = asked[0]["reset"], asked[2]["act"]
    assert reset == {
        "id": "scene", "dt": 0.1, "steps": 6, "target": [5.0, 0.0], "max_accel": 6.0, "max_curvature": 0.3,
        "ego": {
            "id": "car00", "kind": "car", "x": 0.0, "y": 0.0, "yaw": 0.0, "speed": 10.0, "length": 4.6, "width": 1.8,
            "z": 0.0,
        },
        "others": [{"id": f"car0{k}", "kind": "car", "length": 4.6, "width": 1.8} for k in (1, 2)],
        "lanes": reset["lanes"], "connections": [], "route": reset["route"],
    }  # fmt: skip
    assert reset["route"]["points"][:2] == [[0.0, 0.0], [1.0, 0.0]]
    assert (reset["route"]["width"][0], reset["route"]["speed_limit"][0]) == (3.2, 15.0)
    assert [one["lane"] for one in reset["route"]["lanes"]] == ["lane0"]
    assert reset["lanes"][1] == {
        "id": "lane1", "centre": [[-200.0, 3.2], [600.0, 3.2]], "width": 3.2, "speed_limit": 15.0,
        "junction": False, "left": "lane2", "right": "lane0", "height": [0.0, 0.0], "approach": None,
    }  # fmt: skip
    assert {key: act[key] for key in ("step", "time_s", "target", "lights")} == {
        "step": 4, "time_s": 0.4, "target": [5.0, 0.0], "lights": [],
    }  # fmt: skip
    assert act["leader"]["agent"] == act["others"][0]
    assert (act["acceleration"], act["yaw_rate"], act["lights_ahead"]) == (0.0, 0.0, [])
    assert act["others"][1]["x"] == pytest.approx(33.6)
    assert set(act["ego"]) == set(act["others"][1]) == set(reset["ego"])


def test_waypoints(planner):
    under_test = made(planner('{"waypoints": [[1, 2], [3, 4]], "spacing_s": 0.25}'))
    under_test.reset(told())
    answer = under_test.act(observation())
    assert isinstance(answer, Waypoints)
    assert answer.points.tolist() == [[1, 2], [3, 4]]
    assert answer.spacing_s == 0.25


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ('"straight on"', "answered 'straight on' to `act`, expected one JSON object: JSON is malformed"),
        ('{"accel": float("nan"), "curvature": 0}', "NaN.* expected one JSON object: JSON is malformed"),
        ('{"accel": "full", "curvature": 0}', "Expected `float | null`, got `str` - at `$.accel`"),
        ('{"accel": 1.0}', 'answered \'{"accel":1.0}\' to `act`, expected {"accel": .., "curvature": ..}'),
        ('{"accel": 1.0, "curvature": 0.0, "waypoints": [[1, 2]]}', 'expected {"accel": .., "curvature": ..} or'),
        ('{"accel": 1.0, "steering": 0.1}', "unknown field `steering`"),
        ('{"waypoints": [[1, 2, 3]]}', "length 2"),
        ('{"ok": True}', "to `act`, expected"),
        ("[1.0, 0.0]", "Expected `object`, got `array`"),
        (r'"{\"accel\": 1.0, \"curvature\": 0.0}\nthank you"', "wrote 'thank you' unasked"),
        ('{"error": "no lane here"}', "the command gave `act` up: no lane here"),
        ("os._exit(3)", "ended instead of answering `act` (exit code 3)"),
        ("os.kill(os.getpid(), 11)", "(killed by SIGSEGV)"),
        ("1 / 0", "ended instead of answering `act` (exit code 1)"),
    ],
)
def test_an_answer_that_is_none(planner, answer, said):
    under_test = made(planner(answer))
    pattern = said if ".*" in said else re.escape(said)
    for _ in range(2):  # it is at hand again for the next scene
        under_test.reset(told())
        with pytest.raises(PlannerError, match=pattern):
            under_test.act(observation())


def test_an_answer_without_an_end(planner):
    under_test = made(planner('[sys.stdout.write("x" * 100_000) for _ in iter(int, 1)]'))
    under_test.reset(told())
    with pytest.raises(PlannerError, match="wrote 'xxx.*unasked, expected one line for every question"):
        under_test.act(observation())


def test_extra_text_that_comes_late(planner):
    under_test = made(
        planner('print(\'{"accel": 1.0, "curvature": 0.0}\', flush=True) or time.sleep(0.1) or "thank you"')
    )
    under_test.reset(told())
    under_test.act(observation())
    time.sleep(0.3)
    with pytest.raises(PlannerError, match="wrote 'thank you' unasked"):
        under_test.act(observation())


def test_what_a_crash_leaves(planner, capfd):
    host = HostProcess(planner('{"accel": 1 / (2 - asked["act"]["step"]), "curvature": 0}'))
    host.reset([told()])
    assert [host.act(step, [seen(step)])[0].decision for step in (0, 1)] == [Control(0.5, 0.0), Control(1.0, 0.0)]
    with pytest.raises(DriveError, match="in `act` at step 2.*ended instead of answering .* code 1") as failure:
        host.act(2, [seen(2)])
    assert "ZeroDivisionError: division by zero" in failure.value.trace
    assert "ZeroDivisionError: division by zero" in capfd.readouterr().err
    host.reset([told()])
    assert host.act(0, [seen()])[0].decision == Control(0.5, 0.0)
    host.close()


@pytest.mark.slow
def test_one_that_hangs_is_ended_with_all_that_it_started(planner, tmp_path):
    lock, script, holds = tmp_path / "lock", tmp_path / "hangs.sh", tmp_path / "holds.py"
    holds.write_text(HOLDS)
    script.write_text(f"{shlex.join([sys.executable, '-S', str(holds), str(lock)])}\ntrue\n")
    name = f"exec:sh {shlex.quote(str(script))}"
    host = HostProcess(name, Deadlines(0.3))
    host.reset([told()])
    assert not free(lock)
    with pytest.raises(DriveError, match="gave no answer within 0.3 s in `act` at step 0"):
        host.act(0, [seen()])
    until = time.monotonic() + 20.0
    while not free(lock) and time.monotonic() < until:
        time.sleep(0.1)
    assert free(lock)


def free(path) -> bool:
    with path.open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("exec:", "names no command"),
        ("exec:./no_such_planner --fast", "'./no_such_planner' is neither an executable file nor on the PATH"),
        ("exec:python 'planner.py", "No closing quotation"),
    ],
)
def test_a_command_that_there_is_not(name, said):
    with pytest.raises(PlannerError, match=said):
        next(attack([MADE], REGENTS, name))


@pytest.mark.slow
def test_attacked(planner):
    cases = [scene((0, 0, 10), (20, 0, 8), (30, 3.2, 9), name=name) for name in ("fine", "lost")]
    name = planner('{"error": "no way"} if "lost" in scene else {"accel": -2.0, "curvature": 0.0}')
    fine, lost = attack(cases, REGENTS.but(iterations=20), name)
    assert fine.attack.outcome in ("collision", "no_collision")
    assert fine.attack.act_time.decisions >= 80
    assert lost.attack.outcome == "planner_error"
    assert "gave `act` up: no way" in lost.attack.planner_error
