"""Planners that do what no planner should: each costs its drive, never the next one, and leaves nothing behind."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from params import slow
from places import SUPPORT
from scenes import scene
from shipped_cases import shipped_window

from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import REGENTS
from regents_cosim.errors import DriveError, RegentsError
from regents_cosim.evaluation.drives.driving import drive_each
from regents_cosim.planners.hosting.host_messages import SUMMARY_LIMIT, TRACE_LIMIT, shortened
from regents_cosim.planners.hosting.host_pool import HostPool
from regents_cosim.planners.hosting.host_process import HostProcess
from regents_cosim.planners.interface import Control, Scene, Snapshot
from regents_cosim.planners.time_limits import Deadlines
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.replays.mirror import MirrorController
from regents_cosim.replays.replay import replay_each

FILE = SUPPORT / "hostile_planners.py"
MADE = scene((0, 0, 10), (20, 0, 8), (30, 3.2, 9), steps=6)


def named(attribute):
    return f"{FILE}:{attribute}"


def patience(attribute, act_s=10.0, reset_s=30.0, make_s=60.0):
    made = Deadlines(act_s)
    made.reset_s, made.make_s = reset_s, make_s
    return made


def told(name="scene"):
    return Scene.of(replace(MADE, id=name), 6.0, 0.3)


def seen(step):
    tracks = MADE.tracks
    return Snapshot(*(v[:, step] for v in (tracks.x, tracks.y, tracks.yaw, tracks.speed, tracks.valid)))


def decided(host, step):
    (answer,) = host.act(step, [seen(step)])
    return answer.decision


@pytest.fixture
def hosted(monkeypatch, tmp_path):
    """Makes processes that host a planner of `hostile_planners`, and ends them."""
    monkeypatch.setenv("REGENTS_BOMB", str(tmp_path / "bomb"))
    monkeypatch.setenv("REGENTS_CHILDREN", str(tmp_path / "children"))
    made = []

    def host(attribute, act_s=10.0, reset_s=30.0):
        made.append(HostProcess(named(attribute), patience(attribute, act_s, reset_s)))
        return made[-1]

    yield host
    for one in made:
        one.close()
    assert not (tmp_path / "bomb").exists(), "something was unpickled"


@pytest.mark.parametrize(
    ("attribute", "said"),
    [
        ("StrayByte", "broke the protocol in `act` at step 1: b'x.*rc1.* where a message begins"),
        slow("StrayAndDeaf", "gave no answer within 1 s in `act` at step 1"),
        slow("Pickles", "broke the protocol in `act` at step 1"),
        slow("PicklesInFrame", "broke the protocol in `act` at step 1"),
        ("TooLong", "broke the protocol in `act` at step 1: a message of 4294967295 bytes, more than 1048576"),
        slow("AnswersAnother", "broke the protocol in `act` at step 1: an answer to another question"),
        slow("AnswersTwice", "broke the protocol in `act` at step 2: .* unasked"),
        slow("AnswersNaN", "broke the protocol in `act` at step 1: no decision within the limits for each scene"),
        slow("AnswersTooMuch", "broke the protocol in `act` at step 1: no decision within the limits for each scene"),
        slow("AnswersForTwo", "broke the protocol in `act` at step 1: no decision within the limits for each scene"),
        ("ClosesAll", "ended its process in `act` at step 1"),
        slow("Shouts", "failed in `act` at step 1: ValueError: aaaa"),
        slow("Unspeakable", "SpeechlessError, whose text cannot be had: RuntimeError"),
        slow("Surrogates", r"failed in `act` at step 1: ValueError: half \\ud800 a character"),
        ("FarAway", "x=1000000.0, .* expected a place within 50 km of the start"),
        slow("TooFast", "speed=1e.308.* expected .* a speed of at most 100000 m/s"),
        slow("AnswersFarAway", "broke the protocol in `act` at step 1: no decision within the limits for each scene"),
        slow("Infinite", "accel is inf, expected a finite number"),
    ],
)
def test_it_costs_one_drive(hosted, attribute, said):
    host = hosted(attribute, act_s=1.0 if attribute == "StrayAndDeaf" else 10.0)
    host.reset([told()])
    begin = time.monotonic()
    with pytest.raises(DriveError, match=said) as failure:
        drive_to_the_end(host)
    assert time.monotonic() - begin < 60.0
    assert len(str(failure.value)) < SUMMARY_LIMIT + 300
    assert len(failure.value.trace) <= TRACE_LIMIT
    host.reset([told()])
    assert decided(host, 0) == Control(1.0, 0.0)


def drive_to_the_end(host):
    for step in range(5):
        assert decided(host, step) == Control(1.0, 0.0)
        time.sleep(0.05)  # for what comes late


def test_one_that_forks_goes_on(hosted):
    host = hosted("Forks")
    host.reset([told()])
    assert [decided(host, step) for step in range(5)] == [Control(1.0, 0.0)] * 5


def test_it_needs_no_temporary_folder_and_leaves_none(hosted, monkeypatch, tmp_path):
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr(tempfile, "tempdir", None)
    host = hosted("NoTemporaryFolder")
    host.reset([told()])
    decided(host, 0)
    assert not list(folder.iterdir())
    with pytest.raises(DriveError, match="OSError: gone"):
        decided(host, 1)
    other = hosted("Good")
    other.reset([told()])
    assert decided(other, 1) == Control(1.0, 0.0)


@pytest.mark.slow
def test_in_sumo_one_process_drives_many_cases_and_leaves_nothing(monkeypatch, tmp_path):
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setenv("REGENTS_CHILDREN", str(tmp_path / "children"))
    cases = [replace(shipped_window("grid"), id=name) for name in "abcdef"]
    assert not any(drive.error for drive in drive_each(cases, named("HasChildren"), where="sumo"))
    assert not list(folder.iterdir())
    started = (tmp_path / "children").read_text().split()
    assert len(started) == 2 * len(cases)
    assert len(set(started[::2])) <= len(os.sched_getaffinity(0)), "one for each worker"
    assert ends(list(map(int, started)))


def test_shortened_keeps_head_and_tail():
    assert shortened("short", 10) == "short"
    text = shortened("a" * 500 + "z" * 500, 100)
    assert len(text) <= 100
    assert text.startswith("aaa")
    assert text.endswith("zzz")
    assert "900 characters left out" in text


# --- what it starts ---------------------------------------------------------------------------


def alive(process):
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state not in "ZX"


def ends(processes, within_s=30.0):
    until = time.monotonic() + within_s
    while any(map(alive, processes)) and time.monotonic() < until:
        time.sleep(0.05)
    return not any(map(alive, processes))


def test_its_children_end_with_it(hosted, tmp_path):
    host = hosted("HasChildren")
    host.reset([told()])
    started = list(map(int, (tmp_path / "children").read_text().split()))
    assert all(map(alive, started))
    host.close()
    assert ends(started)


OWNER = """
import sys, time
sys.path[:0] = {tests!r}
from test_hostile_planners import HostProcess, named, told
host = HostProcess(named("HasChildren"))
host.reset([told()])
print("ready", flush=True)
time.sleep(1000)
"""


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGKILL, slow(signal.SIGTERM)])
def test_they_end_with_whoever_asked(how, tmp_path):
    code = OWNER.format(tests=[str(FILE.parent), str(Path(__file__).parent)])
    environment = os.environ | {"REGENTS_CHILDREN": str(tmp_path / "children")}
    owner = subprocess.Popen([sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE)
    assert owner.stdout.readline() == b"ready\n"
    started = list(map(int, (tmp_path / "children").read_text().split()))
    assert all(map(alive, started))
    owner.send_signal(how)
    owner.wait()
    owner.stdout.close()
    assert ends(started)


# --- how long it is waited for ----------------------------------------------------------------


@pytest.mark.slow
def test_one_that_hangs_when_it_is_made_is_waited_for_once():
    with HostPool(PlannerUnderTest.of(named("NeverMade"))) as pool:
        pool._patience.make_s = 1.0
        for said in ("gave no answer within 1 s when it was made$", "made; it was not asked again"):
            begin = time.monotonic()
            with pool.lend() as host, pytest.raises(DriveError, match=said) as failure:
                host.reset([told()])
            assert time.monotonic() - begin < 60.0
    assert "line" not in failure.value.trace


@pytest.mark.slow
def test_one_that_hangs_in_its_first_reset_is_waited_for_once(hosted):
    host = hosted("DeafInReset", reset_s=1.0)
    with pytest.raises(DriveError, match=r"gave no answer within 1 s in `reset`$") as failure:
        host.reset([told("deaf")])
    assert "in reset" in failure.value.trace
    with pytest.raises(DriveError, match="it was not asked again"):
        host.reset([told("fine")])


@pytest.mark.slow
def test_one_that_has_worked_is_given_up_when_it_hangs_twice_in_a_row(hosted):
    host = hosted("DeafInReset", reset_s=1.0)
    for name in ("fine", "deaf", "fine", "deaf", "deaf"):
        if name == "fine":
            host.reset([told(name)])
            continue
        with pytest.raises(DriveError, match=r"in `reset`$"):
            host.reset([told(name)])
    with pytest.raises(DriveError, match="it was not asked again"):
        host.reset([told("fine")])


@pytest.mark.parametrize("seconds", [float("nan"), float("inf"), 1e300, 0.0, -1.0])
def test_a_time_that_cannot_be_waited(seconds):
    for ask in (
        lambda: MirrorController("idm", seconds),
        lambda: next(attack([MADE], REGENTS, "idm", act_timeout_s=seconds)),
        lambda: next(drive_each([MADE], "idm", seconds, "highway")),
        lambda: next(replay_each([MADE], "sumo", "idm", act_timeout_s=seconds)),
    ):
        with pytest.raises(RegentsError, match="act-timeout is .*, expected"):
            ask()


def test_answers_are_as_exact_as_they_were(hosted):
    """What a scene and an instant hold survives the way to the other side."""
    from regents_cosim.planners.hosting import host_messages as messages

    scene_told, now = told(), seen(3)
    question = messages.questions.decode(messages.encoder.encode(messages.Reset(1, [scene_told])))
    (again,) = question.scenes
    assert again.ego == scene_told.ego
    assert again.others == scene_told.others
    for one, other in zip(again.road.lanes, scene_told.road.lanes, strict=True):
        assert np.array_equal(one.centre, other.centre)
    assert again.road.drivable.equals(scene_told.road.drivable)
    for one, other in zip(messages.unpacked(messages.packed(now)), now, strict=True):
        assert np.array_equal(one, np.broadcast_to(other, one.shape))  # one height may stand for all
        assert one.flags.writeable
