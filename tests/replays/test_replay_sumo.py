"""Replays in a real SUMO: everybody where the case says, at the step it says."""

import dataclasses
import functools
import os
import shutil
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from string import ascii_letters, digits
from typing import get_args

import numpy as np
import pytest
from crossing_scenes import DT, EGO, LANE_Y, STEPS, TIME, Car, road, scenario, straight, turning
from hypothesis import given, settings
from hypothesis import strategies as st
from params import slow
from places import ROOT
from x_windows import XDisplay, x_server

from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import find_cases
from regents_cosim.cases.shipped import ALL_NETWORKS, network_config
from regents_cosim.errors import PlannerError, RegentsError, ScenarioError, SumoError
from regents_cosim.geometry.frames import wrap
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.replays import replay as replays
from regents_cosim.replays.replay import replay, replay_each
from regents_cosim.replays.sumo.drive import compared_in_sumo
from regents_cosim.replays.sumo.replay import CaseToPlay, replay_in_sumo
from regents_cosim.replays.verify import compare
from regents_cosim.scenario.attack_record import AttackRecord, Collision
from regents_cosim.scenario.collisions import first_contact
from regents_cosim.scenario.scenario import Kind, Signal
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.simulators.sumo.process import load_libsumo
from regents_cosim.sources.record import record
from regents_cosim.system.workers import executor_for, local_processes, result_of, submit


@pytest.fixture(scope="module")
def in_sumo():
    """`replay_in_sumo` in one worker process for all tests: SUMO starts anew within it."""
    with local_processes(1) as pool:
        yield lambda case, driver=None, released=(): result_of(
            submit(pool, replay_in_sumo, CaseToPlay(case, released), driver)
        )


def assert_same(tracks, expected):
    """Far below the promised 1 mm and 0.01 degrees: SUMO is told numbers and tells them back."""
    assert (tracks.valid == expected.valid).all()
    np.testing.assert_allclose(tracks.x, expected.x, rtol=0, atol=1e-9)
    np.testing.assert_allclose(tracks.y, expected.y, rtol=0, atol=1e-9)
    np.testing.assert_allclose(wrap(tracks.yaw - expected.yaw), 0.0, atol=1e-10)
    np.testing.assert_allclose(tracks.speed, expected.speed, rtol=0, atol=1e-9)


# --- poses ------------------------------------------------------------------------------------

DRIVES = {
    "along the lane": straight("a", -60.0, LANE_Y, 0.0, 9.0),
    "against the traffic": straight("a", -20.0, LANE_Y, np.pi, 9.0),
    "across all lanes": straight("a", -40.0, -20.0, np.pi / 2, 12.0),
    "turning in the junction": turning("a", -10.0, LANE_Y, 0.0, 8.0, 0.15),
    "turning clockwise": turning("a", -10.0, LANE_Y, 0.0, 8.0, -0.2),
    "spinning": turning("a", -30.0, 20.0, 0.0, 15.0, 1.0),
    "standing": straight("a", -30.0, LANE_Y, 0.3, 0.0),
    "sideways on the lane": dataclasses.replace(straight("a", -60.0, LANE_Y, 0.0, 9.0), yaw=np.full(STEPS, 1.3)),
    "half a kilometre off the road": straight("a", 600.0, 700.0, 2.0, 20.0),
    "beyond the end of the road": straight("a", 140.0, LANE_Y, 0.0, 20.0),
    "faster than SUMO's cars": straight("a", -140.0, LANE_Y, 0.0, 90.0),
    "jumping": dataclasses.replace(straight("a", 0.0, 0.0, 0.0, 9.0), x=np.where(np.arange(STEPS) % 2, -90.0, 90.0)),
    "a long truck": straight("a", -40.0, 5.1, np.pi, 9.0, length=18.75, width=2.55, kind="truck"),
    "a pedestrian": straight("a", -5.0, 9.0, -1.0, 1.4, length=0.4, width=0.6, kind="pedestrian"),
}


@pytest.mark.parametrize("drive", DRIVES)
def test_any_drive_is_reproduced(in_sumo, drive):
    made = scenario(EGO, DRIVES[drive])
    assert_same(in_sumo(made).tracks, made.tracks)


def test_agents_come_go_and_come_back(in_sumo):
    step = np.arange(STEPS)
    cars = [
        straight("early exit", -60.0, 5.1, np.pi, 9.0, valid=step < 9),
        straight("gap", -60.0, LANE_Y, 0.0, 9.0, valid=(step < 5) | (step >= 8)),
        straight("gaps", -40.0, -5.1, 0.0, 9.0, valid=step % 2 == 0),
        straight("late entry", 1.7, -40.0, np.pi / 2, 9.0, valid=step >= 11),
        straight("never", -60.0, LANE_Y, 0.0, 9.0, valid=step < 0),
        straight("one instant", -1.7, 40.0, -np.pi / 2, 9.0, valid=step == 7),
        straight("the last instant", -80.0, -5.1, 0.0, 30.0, valid=step == STEPS - 1),
    ]
    made = scenario(EGO, *cars)
    found = in_sumo(made)
    assert_same(found.tracks, made.tracks)
    assert compare(made, found.tracks).verified


def test_a_crowd_enters_at_once_on_one_spot(in_sumo):
    made = scenario(EGO, *(straight(f"{i:03}", -100.0 + 0.1 * i, LANE_Y, 0.0, 10.0) for i in range(60)))
    assert_same(in_sumo(made).tracks, made.tracks)


bounded = functools.partial(st.floats, allow_nan=False)


@settings(max_examples=25)
@given(
    start=st.tuples(bounded(-150, 150), bounded(-150, 150), bounded(-np.pi, np.pi), bounded(0, 30)),
    wheel=st.lists(bounded(-0.3, 0.3), min_size=STEPS, max_size=STEPS),
    pedal=st.lists(bounded(-8, 8), min_size=STEPS, max_size=STEPS),
    length=bounded(0.5, 25),
    width=bounded(0.3, 3),
)
def test_random_smooth_drives_are_reproduced(in_sumo, start, wheel, pedal, length, width):
    speed = np.maximum(start[3] + DT * np.cumsum(pedal), 0.0)
    yaw = start[2] + DT * np.cumsum(np.array(wheel) * speed)
    x = start[0] + DT * np.cumsum(speed * np.cos(yaw))
    y = start[1] + DT * np.cumsum(speed * np.sin(yaw))
    made = scenario(EGO, Car("a", x, y, yaw, speed, np.ones(STEPS, bool), length, width))
    assert_same(in_sumo(made).tracks, made.tracks)


@pytest.mark.parametrize("dt", [0.05, 0.04, 0.1, 1.0])
def test_other_step_lengths(in_sumo, dt):
    made = scenario(EGO, DRIVES["turning clockwise"], dt=dt)
    assert_same(in_sumo(made).tracks, made.tracks)


@pytest.mark.parametrize("net", [one if one == "crossing" else slow(one) for one in ALL_NETWORKS])
def test_recorded_windows_of_every_network_are_reproduced(net, in_sumo):
    for made in record(SumoInput(network_config(net), end_s=120.0), count=2, tell=lambda _: None):
        found = in_sumo(made)
        assert_same(found.tracks, made.tracks)
        assert found.signals == made.signals
        assert compare(made, found.tracks, found.collisions).verified


@pytest.mark.parametrize("case", find_cases(ROOT / "scenarios" / "quickstart"), ids=lambda path: path.name)
def test_shipped_crashes_happen_in_sumo_at_the_same_step(case, in_sumo):
    made = load_case(case)
    found = in_sumo(made)
    assert_same(found.tracks, made.tracks)
    result = compare(made, found.tracks, found.collisions)
    assert result.verified
    hit = made.collision
    assert result.found == ((hit.agent, hit.step) if hit else None)
    assert compare(made.before_attack(), in_sumo(made.before_attack()).tracks).verified


# --- ids --------------------------------------------------------------------------------------


def test_ids_may_hold_any_character_that_shows(in_sumo):
    names = [" ", "a b", "a_b", "a_b#2", "a|b", "a;b", "a,b", "<&>", "'\"\\", "車", "é", "x" * 300, "ego "]
    cars = [straight(name, -60.0 + 10.0 * i, 5.1, np.pi, 8.0 + i) for i, name in enumerate(names)]
    made = scenario(EGO, *cars)
    assert_same(in_sumo(made).tracks, made.tracks)


def test_reports_speak_of_agents_not_of_sumos_names(in_sumo):
    step = np.arange(STEPS)
    rear = straight("the | rear", -88.0, LANE_Y, 0.0, 10.0, valid=(step < 3) | (step >= 6))
    front = straight("the front; one", -86.0, LANE_Y, 0.0, 10.0)
    found = in_sumo(scenario(EGO, front, rear))
    assert {(hit.collider, hit.victim) for hit in found.collisions} == {("the | rear", "the front; one")}
    assert {hit.step for hit in found.collisions} - {0} == {1, 2, *range(6, STEPS)}  # SUMO does not look at once


# --- contacts ---------------------------------------------------------------------------------


def t_bone(speed=10.0):
    """The ego from the west, the other from the south; they meet in the middle of the crossing."""
    ego = straight("ego", -14.0, LANE_Y, 0.0, 10.0)
    return scenario(ego, straight("other", 1.7, -16.0, np.pi / 2, speed))


def test_a_t_bone_is_one_in_sumo_at_the_same_step(in_sumo):
    made = t_bone()
    agent, step = first_contact(made.agents, made.tracks)
    found = in_sumo(made)
    result = compare(made, found.tracks, found.collisions)
    assert (agent, result.found, result.verified, result.reason) == (1, ("other", step), True, "")
    assert result.reports_same_pair
    assert min(hit.step for hit in found.collisions) in (step, step + 1)
    assert float(result.position_error_m.max()) < 1e-9


def test_side_swipes_are_ours_alone_to_see(in_sumo):
    ego = straight("ego", -100.0, -2.6, 0.0, 10.0)  # each centre stays in its own lane
    side = straight("side", -100.0, -4.5, 0.0, 10.0)
    made = scenario(ego, dataclasses.replace(side, y=side.y + 0.03 * np.arange(STEPS)))
    found = in_sumo(made)
    result = compare(made, found.tracks, found.collisions)
    assert result.verified
    assert result.found == ("side", 4)
    assert not result.reports_same_pair


def moved(made, **changes):
    return dataclasses.replace(made.tracks, **changes)


def with_note(made, step):
    """`made` as an attacked case that notes a collision with `other` at `step`."""
    hit = Collision("other", step, step * DT, "t_bone", 14.0, attributed=True)
    record = AttackRecord(
        case="made", method="regents", planner="idm", outcome="collision", iterations=1, collision=hit
    )
    return dataclasses.replace(made, attack=record, log=made.tracks)


def test_what_differs_is_said():
    made = t_bone()
    _, step = first_contact(made.agents, made.tracks)
    assert compare(made, made.tracks).verified

    away = np.zeros(made.tracks.x.shape)
    away[1, 7] = 0.002
    off = compare(made, moved(made, x=made.tracks.x + away))
    assert (off.verified, off.reason) == (False, "other is off by 2 mm and 0 degrees at step 7")
    turned = compare(made, moved(made, yaw=made.tracks.yaw + np.deg2rad(10.0 * away) + 2 * np.pi))
    assert turned.reason == "other is off by 0 mm and 0.02 degrees at step 7"
    assert compare(made, moved(made, yaw=made.tracks.yaw + 2 * np.pi)).verified

    valid = made.tracks.valid.copy()
    valid[1, 3] = False
    assert compare(made, moved(made, valid=valid)).reason == "other is not there at step 3"

    missed = compare(made, moved(made, y=made.tracks.y + 100.0 * np.array([[0.0], [1.0]])))
    assert missed.reason == f"no collision, expected one with other at step {step}"
    slower = t_bone(speed=8.0)
    _, later = first_contact(slower.agents, slower.tracks)
    assert later > step
    late = compare(made, slower.tracks)
    assert late.reason == f"collision with other at step {later}, expected other at step {step}"

    assert compare(with_note(made, step), made.tracks).verified
    stale = compare(with_note(made, step - 1), made.tracks)
    assert stale.reason == (
        f"the case notes a collision with other at step {step - 1}, its own tracks show one with other at step {step}"
    )


def test_a_driven_ego_may_leave_its_track_but_nobody_else(in_sumo):
    made = t_bone()
    ego = np.array([[1.0], [0.0]])
    assert compare(made, moved(made, x=made.tracks.x + 0.01 * ego), ego_is_free=True).verified
    assert not compare(made, moved(made, x=made.tracks.x + 0.01 * ego)).verified
    assert not compare(made, moved(made, x=made.tracks.x + 0.01 * (1 - ego)), ego_is_free=True).verified


# --- signals ----------------------------------------------------------------------------------


def lights(*changes):
    return scenario(EGO, net="signals", signals=(Signal("centre", changes),))


def test_signals_are_forced(in_sumo):
    (known,) = {link.signal for link in road("signals").connections if link.signal}
    assert known == "centre"
    shown = ((0, "r" * 16), (1, "GgyYuosO" * 2), (2, "G" * 16), (20, "O" * 16))
    shown = tuple((step, letters.replace("Y", "y")) for step, letters in shown)
    assert in_sumo(lights(*shown)).signals == (Signal("centre", shown),)


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lights((0, "rr")), "signal 'centre' shows 2 letters, SUMO's has 16 links"),
        (lights((0, "r" * 16), (3, "rx" * 8)), "signal 'centre' shows 'x' at step 3, expected SUMO's: rygGuosOY"),
        (scenario(EGO, signals=(Signal("s", ((0, "r"),)),)), "signal 's' is not in its SUMO network, .* no signals"),
    ],
)
def test_signals_that_do_not_fit(in_sumo, made, message):
    with pytest.raises(SumoError, match=message) as error:
        in_sumo(made)
    assert "\n" not in str(error.value)


# --- the driver -------------------------------------------------------------------------------


class Straight:
    """Keeps the speed that SUMO reports, straight on; remembers what it saw."""

    def start(self, made):
        self.background = made.tracks
        self.last = None

    def advance(self, step, seen):
        x, y, yaw, speed, valid, _ = seen
        for seen, log in ((x, "x"), (y, "y"), (yaw, "yaw"), (speed, "speed"), (valid, "valid")):
            np.testing.assert_allclose(seen[1:], getattr(self.background, log)[1:, step], atol=1e-9)
        if self.last is not None:
            np.testing.assert_allclose((x[0], y[0], yaw[0], speed[0]), self.last, atol=1e-9)
        self.last = (x[0] + DT * speed[0] * np.cos(yaw[0]), y[0] + DT * speed[0] * np.sin(yaw[0]), yaw[0], speed[0])
        x[:] = np.nan  # its own copy
        return self.last


class Inspector:
    """Looks at SUMO's own vehicles while it drives."""

    def start(self, made):
        self.made = made

    def advance(self, step, seen):
        x, y, yaw, speed, valid, _ = seen
        vehicle = load_libsumo().vehicle
        sizes = sorted((vehicle.getLength(name), vehicle.getWidth(name)) for name in vehicle.getIDList())
        assert sizes == sorted((a.length, a.width) for a, v in zip(self.made.agents, valid, strict=True) if v)
        assert all(set(name) <= set(ascii_letters + digits + "_.-#") for name in vehicle.getIDList())
        assert sorted(vehicle.getSpeed(name) for name in vehicle.getIDList()) == sorted(speed[valid])
        return x[0], y[0], yaw[0], speed[0]


class Faulty:
    def __init__(self, answer):
        self.answer = answer

    def start(self, made):
        if self.answer == "at once":
            raise KeyError("no\nmap")

    def advance(self, step, seen):
        if step < 2:
            return tuple(values[0] for values in seen[:4])
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


def test_a_driver_sees_the_step_that_was_and_decides_the_next(in_sumo):
    ego = turning("ego", -14.0, LANE_Y, 0.0, 10.0, 0.05)
    step = np.arange(STEPS)
    made = scenario(ego, straight("late", 1.7, -16.0, np.pi / 2, 10.0, valid=step > 3), DRIVES["spinning"])
    found = in_sumo(made, Straight()).tracks
    np.testing.assert_allclose(found.x[0], -14.0 + 10.0 * TIME, atol=1e-9)
    np.testing.assert_allclose(found.y[0], LANE_Y, atol=1e-9)
    np.testing.assert_allclose(found.speed[0], 10.0, atol=1e-9)
    assert not compare(made, found).verified
    assert first_contact(made.agents, found) is not None


@pytest.mark.parametrize("kind", get_args(Kind))
def test_every_kind_of_road_user_may_take_part(in_sumo, kind):
    made = scenario(EGO, dataclasses.replace(DRIVES["along the lane"], kind=kind))
    assert_same(in_sumo(made).tracks, made.tracks)


def test_sumo_knows_sizes_and_speeds(in_sumo):
    cars = [
        straight("a long | truck", -60.0, 5.1, np.pi, 9.0, length=18.75, width=2.55, kind="truck"),
        straight("a slow bicycle", -60.0, -9.0, 0.0, 4.0, length=1.8, width=0.65, kind="bicycle"),
        straight("a gap", -60.0, LANE_Y, 0.0, 9.0, valid=np.arange(STEPS) % 3 > 0, kind="motorcycle"),
        straight("something", 60.0, LANE_Y, 0.0, 9.0, kind="other"),
    ]
    in_sumo(scenario(EGO, *cars), Inspector())


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        ("at once", "planner failed before the first step .KeyError: 'no..map'"),
        (ValueError("two\nlines"), "planner failed at step 2 .ValueError: two lines"),
        ((0.0, 0.0, np.nan, 1.0), "at step 2|after step 2, expected finite numbers"),
        ((0.0, 0.0, 0.0, -1.0), "after step 2, expected finite numbers and speed >= 0"),
        ((0.0, 0.0), "answered .0.0, 0.0. at step 2, expected four numbers"),
        (None, "answered None at step 2, expected four numbers"),
    ],
)
def test_a_driver_that_fails_is_a_planner_error(in_sumo, answer, message):
    with pytest.raises(PlannerError, match=message) as error:
        in_sumo(t_bone(), Faulty(answer))
    assert "\n" not in str(error.value)


# --- maps that do not come from SUMO ----------------------------------------------------------


def test_a_crash_of_a_map_without_a_network_happens_on_its_bare_lanes(in_sumo):
    made = t_bone()
    lanes = tuple(dataclasses.replace(lane, id=f"{lane.id} | {k}") for k, lane in enumerate(made.road.lanes))
    elsewhere = RoadMap(lanes, (), made.road.drivable)
    light = Signal("a light of the log", ((0, "rG"),))
    bare = dataclasses.replace(made, road=elsewhere, signals=(light,))
    seen, expected = in_sumo(bare), in_sumo(made)
    assert np.array_equal(seen.tracks.valid, made.tracks.valid)
    assert np.allclose(seen.tracks.x, made.tracks.x, atol=1e-9, rtol=0)
    assert np.allclose(seen.tracks.y, made.tracks.y, atol=1e-9, rtol=0)
    assert first_contact(made.agents, seen.tracks) == first_contact(made.agents, expected.tracks)
    assert seen.signals == ()


def test_a_crash_of_a_map_without_lanes_happens_in_sumo_all_the_same(in_sumo):
    made = t_bone()
    bare = dataclasses.replace(made, road=RoadMap((), (), made.road.drivable), signals=())
    seen = in_sumo(bare)
    assert np.allclose(seen.tracks.x, made.tracks.x, atol=1e-9, rtol=0)
    assert first_contact(made.agents, seen.tracks) == first_contact(made.agents, made.tracks)


@pytest.mark.slow
def test_sumo_drives_nobody_on_bare_lanes(in_sumo):
    made = t_bone()
    bare = dataclasses.replace(made, road=dataclasses.replace(made.road, sumo_net=None))
    with pytest.raises(
        ScenarioError, match=r"case made: its map has no SUMO network \(source: test\) for SUMO to drive in"
    ):
        in_sumo(bare, released={1})


# --- what cannot be replayed ------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("net", [b"no gzip", b"", b"\x1f\x8b\x08\x00broken"])
def test_a_damaged_network_is_said(in_sumo, net):
    made = t_bone()
    with pytest.raises(SumoError, match="SUMO refused") as error:
        in_sumo(dataclasses.replace(made, road=dataclasses.replace(made.road, sumo_net=net)))
    assert "\n" not in str(error.value)


def crash_if_doomed(job):
    if job.scenario.id == "doomed":
        os.kill(os.getpid(), signal.SIGSEGV)
    return compared_in_sumo(job)


@pytest.mark.slow
def test_a_crash_of_sumo_is_a_failed_verification_of_that_case_only(monkeypatch):
    monkeypatch.setattr(replays, "compared_in_sumo", crash_if_doomed)
    made = t_bone()
    names = ["a", "b", "doomed", "c", "d"]
    found = list(replay_each([dataclasses.replace(made, id=name) for name in names]))
    assert [result.case for result in found] == names
    assert [result.verified for result in found] == [True, True, False, True, True]
    assert found[2].reason.startswith("the worker process died without a word")
    assert found[2].expected == found[0].expected
    assert (found[2].found, found[2].replayed, found[2].position_error_m) == (None, None, None)


@pytest.mark.slow
def test_replays_run_on_a_cluster_also_in_threads_of_one_process():
    distributed = pytest.importorskip("distributed")
    made = [t_bone(speed) for speed in (8.0, 9.0, 10.0, 11.0)]
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=4, dashboard_address=":0", silence_logs=50) as cluster,
        executor_for(f"dask:{cluster.scheduler_address}") as executor,
    ):
        found = list(replay_each(made, executor=executor))
    assert [result.verified for result in found] == [True] * 4
    assert [result.found for result in found] == [result.found for result in replay_each(made)]


# --- sumo-gui ---------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_window_needs_a_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(RegentsError, match="DISPLAY is not set"):
        replay(t_bone(), gui=True)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("Xvfb") is None, reason="no virtual display")
def test_the_window_shows_the_replay_and_stays_until_it_is_closed(monkeypatch):
    with ThreadPoolExecutor(1) as thread, x_server() as name:
        monkeypatch.setenv("DISPLAY", name)
        replayed = thread.submit(replay, t_bone(), gui=True, progress=False)
        display = XDisplay(name)
        window = display.wait_for_one(60.0)
        time.sleep(STEPS * DT + 3.0)
        assert not replayed.done()
        display.close(window)
        result = replayed.result(30.0)
    assert result.verified, result.reason
