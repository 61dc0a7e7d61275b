"""Live traffic in a real SUMO around whoever is scripted."""

import dataclasses
import json

import numpy as np
import pytest
from command import regents
from crossing_scenes import DT, EGO, LANE_Y, STEPS, braking, scenario, straight
from shipped_cases import crash_on

from regents_cosim.benchmarks.transfer import PLACES, transfer
from regents_cosim.cases.files import load_case
from regents_cosim.cases.shipped import NETWORKS, network_config
from regents_cosim.errors import RegentsError
from regents_cosim.geometry.frames import wrap
from regents_cosim.planners.under_test import PlannerTicket, PlannerUnderTest
from regents_cosim.replays.replay import replay
from regents_cosim.replays.sumo.drive import SumoRun, drive_in_sumo
from regents_cosim.replays.verify import compare
from regents_cosim.scenario.collisions import find_overlaps, first_contact
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.simulators.sumo.drivers import background_drivers
from regents_cosim.simulators.sumo.routes import route_of
from regents_cosim.sources.record import record
from regents_cosim.system.workers import local_processes, result_of, run_each, submit


@pytest.fixture(scope="module")
def drive():
    """`drive_in_sumo` in one worker process for all tests."""
    with local_processes(1) as pool:
        yield lambda *args, **more: result_of(submit(pool, drive_in_sumo, SumoRun(*args, **more)))


def assert_on_track(found, made, agent):
    for name in ("x", "y", "speed", "valid"):
        np.testing.assert_allclose(getattr(found.tracks, name)[agent], getattr(made.tracks, name)[agent], atol=1e-6)
    np.testing.assert_allclose(wrap(found.tracks.yaw - made.tracks.yaw)[agent], 0.0, atol=1e-9)


def test_a_follower_brakes_behind_a_braking_ego_where_its_track_rams_it(drive):
    ego, follower = braking("ego", -80.0, 12.0, 8.0), straight("follower", -92.0, LANE_Y, 0.0, 12.0)
    made = scenario(ego, follower)
    assert first_contact(made.agents, made.tracks) is not None
    found = drive(made, released=background_drivers(made))
    assert found.driven == {1}
    assert_on_track(found, made, 0)
    assert first_contact(made.agents, found.tracks) is None
    assert found.tracks.speed[1, -1] < 3.0
    assert (found.tracks.x[1, 0], found.tracks.speed[1, 0]) == pytest.approx((-92.0, 12.0), abs=1e-9)


def test_a_vehicle_that_stands_all_the_time_is_not_set_off(drive):
    made = scenario(straight("ego", -80.0, LANE_Y, 0.0, 8.0), straight("waits", -40.0, LANE_Y, 0.0, 0.0))
    found = drive(made, released=background_drivers(made))
    assert found.driven == set()
    assert_on_track(found, made, 1)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["merge", "signals"])
def test_the_adversary_stays_exact_and_the_same_crash_happens(name):
    made = load_case(crash_on(name))
    adversary = [agent.role for agent in made.agents].index("adversary")
    result = replay(made, background="reactive")
    assert result.verified, result.reason
    assert result.found == (made.collision.agent, made.collision.step)
    assert set(result.driven) == {made.agents[index].id for index in background_drivers(made)}
    found = result.replayed
    assert_on_track(found, made, [0, adversary])
    others = [i for i in range(1, len(made.agents)) if i != adversary]
    both = found.tracks.valid[others] & made.tracks.valid[others]
    assert np.hypot(found.tracks.x - made.tracks.x, found.tracks.y - made.tracks.y)[others][both].max() > 0.5
    assert result.position_error_m.max() < 1e-6
    assert result.shift_m < 1e-6


@pytest.mark.slow
def test_routes_are_those_of_the_logged_vehicles():
    """Vehicles of the crossing are named after their routes: FROM_in.TO_out.NUMBER."""
    windows = record(SumoInput(network_config("crossing"), end_s=120.0), count=3)
    seen_whole = 0
    for made in windows:
        for index, agent in enumerate(made.agents):
            start, end = agent.id.split(".")[:2]
            whole = [start, start.replace("_in", "_stop"), end]
            away = np.hypot(made.tracks.x, made.tracks.y)[index, made.tracks.valid[index]]
            found = route_of(made, index)
            assert found[0] in whole
            if away.min() < 8.0 and away[-1] > 20.0:
                seen_whole += away[0] > 30.0
                assert found == whole[whole.index(found[0]) :]
    assert seen_whole >= 5


@pytest.mark.parametrize("net", NETWORKS)
@pytest.mark.slow
def test_recorded_traffic_stays_free_of_collisions_when_sumo_drives_all_of_it(net, drive):
    """From where it was, as fast as it was, on its routes."""
    (made,) = record(SumoInput(network_config(net), end_s=120.0), count=1)
    assert not made.overlaps
    found = drive(made, released=range(len(made.agents)))
    assert len(found.driven) == len(made.agents)
    assert not find_overlaps(made.agents, found.tracks)
    entry = made.tracks.valid.argmax(axis=1)
    there = np.arange(len(entry)), entry
    came = found.tracks.valid[there]
    off = np.hypot(found.tracks.x - made.tracks.x, found.tracks.y - made.tracks.y)[there]
    assert came.mean() > 0.8
    assert off[came].max() < 1e-6
    assert np.abs(found.tracks.speed - made.tracks.speed)[there][came].max() < 1e-6


@pytest.mark.slow
def test_the_same_seed_gives_the_same_traffic():
    made = load_case(crash_on("grid"))
    drives = [SumoRun(made, released=background_drivers(made), seed=seed) for seed in (1, 1, 2)]
    first, again, other = (found.tracks for found in run_each(drive_in_sumo, drives))
    for name in ("x", "y", "yaw", "speed", "valid"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    assert np.abs(first.x - other.x).max() > 0.1


@pytest.mark.slow
def test_whom_sumo_cannot_drive_stays_on_its_track(drive):
    lost = straight("lost", 600.0, 700.0, 2.0, 20.0)
    against = straight("against", -20.0, LANE_Y, np.pi, 9.0)
    never = straight("never", -60.0, LANE_Y, 0.0, 9.0, valid=np.zeros(STEPS, bool))
    walker = straight("walker", -5.0, 9.0, -1.0, 1.4, length=0.4, width=0.6, kind="pedestrian")
    driven = straight("yes", -60.0, LANE_Y, 0.0, 9.0)
    made = scenario(EGO, lost, against, never, walker, driven)
    result = replay(made, background="reactive")
    assert result.verified, result.reason
    assert (result.driven, result.unmatched) == (("yes",), ("against", "lost", "never"))
    for agent in (i for i, one in enumerate(made.agents) if one.id != "yes"):
        assert_on_track(result.replayed, made, agent)


def test_whoever_enters_later_waits_for_a_free_place(drive):
    """The log has one go where the other, who must stop for the standing ego, now is."""
    ego = straight("ego", -50.0, LANE_Y, 0.0, 0.0)
    first = straight("first", -75.0, LANE_Y, 0.0, 12.0)
    late = straight("late", -58.0 - 12.0 * 1.9, LANE_Y, 0.0, 12.0, valid=np.arange(STEPS) >= 19)
    made = scenario(ego, first, late)
    found = drive(made, released=background_drivers(made))
    assert not find_overlaps(made.agents, found.tracks)
    assert found.tracks.valid[1].all()
    assert not found.tracks.valid[2].any()


def test_lights_hold_for_those_whom_sumo_drives(drive):
    made = record(SumoInput(network_config("signals"), end_s=120.0), count=1)[0]
    (signal,) = made.signals
    red = dataclasses.replace(signal, changes=((0, "r" * len(signal.letters(0))),))
    found = drive(dataclasses.replace(made, signals=(red,)), released=background_drivers(made))
    junction = [lane for lane in made.road.lanes if lane.junction]
    centre = np.mean([lane.centre.mean(axis=0) for lane in junction], axis=0)
    away = np.hypot(made.tracks.x - centre[0], made.tracks.y - centre[1])
    now = np.hypot(found.tracks.x - centre[0], found.tracks.y - centre[1])
    far = [i for i in sorted(found.driven) if made.tracks.valid[i, 0] and away[i, 0] > 60.0]
    assert far
    assert all(now[i, found.tracks.valid[i]].min() > 10.0 for i in far)


def yields():
    """One from the south has to give way to the ego from the west."""
    ego = straight("ego", -21.0, LANE_Y, 0.0, 13.0)
    return scenario(ego, straight("other", 1.7, -28.0, np.pi / 2, 13.0))


@pytest.mark.slow
def test_a_planner_drives_the_ego_among_live_traffic():
    made = load_case(crash_on("grid"))
    known = PlannerUnderTest.of("constant_velocity").ticket
    unknown = PlannerTicket("no_such_planner", "no_such_planner", in_loop=False)
    drives = [SumoRun(made, background_drivers(made), planner=known), SumoRun(made, planner=unknown)]
    found, error = run_each(drive_in_sumo, drives)
    assert np.ptp(found.tracks.speed[0]) < 1e-3
    assert found.tracks.valid[0].all()
    assert "no_such_planner" in str(error)


def test_a_crash_may_come_earlier_or_later_among_live_traffic():
    ego = straight("ego", -14.0, LANE_Y, 0.0, 10.0)
    made, slower = (scenario(ego, straight("other", 1.7, -16.0, np.pi / 2, speed)) for speed in (10.0, 8.0))
    steps = [first_contact(s.agents, s.tracks)[1] for s in (made, slower)]
    assert steps[0] < steps[1]
    assert compare(made, slower.tracks, driven={1}).verified
    strict = compare(made, slower.tracks)
    assert not strict.verified
    moved = [np.abs(at[1] - at[0]) for at in ((10.0 * DT * np.array(steps)), (DT * np.array([10.0, 8.0]) * steps))]
    assert strict.shift_m == pytest.approx(max(moved))
    gone = compare(
        made, dataclasses.replace(made.tracks, y=made.tracks.y - 100.0 * np.array([[0.0], [1.0]])), driven={1}
    )
    assert gone.reason == f"no collision, expected one with other at step {steps[0]}"
    assert gone.shift_m is None


# --- the report and the command ---------------------------------------------------------------


def under_constant_velocity(name):
    """A shipped case, as if a planner had been attacked that compiles at once."""
    case = load_case(crash_on(name))
    return dataclasses.replace(case, attack=dataclasses.replace(case.attack, planner="constant_velocity"))


@pytest.mark.slow
def test_the_transfer_report_names_every_case_in_every_place():
    cases = [under_constant_velocity(name) for name in ("grid", "merge")]
    places = [place for place in PLACES if place.name in ("SUMO, reactive, planner drives", "highway-env, track")]
    report = {row.place: (row, each) for row, each in transfer(cases, places)}
    assert list(report) == [place.name for place in places]
    for row, each in report.values():
        assert (row.cases, row.crashes) == (2, 2)
        assert [one.case for one in each] == [case.id for case in cases]
        hits = [case.collision for case in cases]
        assert [one.expected for one in each] == [(hit.agent, hit.step) for hit in hits]
        assert row.same_crash == sum(one.found == one.expected for one in each)
        assert all(one.verified or one.reason for one in each)
    live, scripted = (report[place.name] for place in places)
    assert scripted[0].driven == 0 < live[0].driven
    assert (scripted[0].same_crash, scripted[0].steps_apart_max, scripted[0].own_list) == (2, 0, 2)
    assert scripted[0].shift_max_mm < 1e-3
    assert live[0].position_error_mm < 1e-3


@pytest.mark.slow
def test_places_that_cannot_have_the_cases_are_left_out():
    made = yields()
    no_net = dataclasses.replace(made, road=dataclasses.replace(made.road, sumo_net=None))
    assert [row.place for row, _ in transfer([made], PLACES[:3])] == ["SUMO", "SUMO, reactive"]
    assert [row.place for row, _ in transfer([made, no_net], PLACES[:3])] == ["SUMO"]


@pytest.mark.slow
def test_the_command_replays_among_live_traffic():
    case = crash_on("merge")
    done = regents("replay", case, "--in", "sumo", "--background", "reactive", "--json", code=0)
    (row,) = json.loads(done.stdout)
    others = sum(agent.role == "background" for agent in load_case(case).agents)
    assert (row["verified"], row["unmatched"], row["steps_later"]) == (True, 0, 0)
    assert 0 < row["driven"] <= others


def test_only_sumo_has_live_traffic():
    with pytest.raises(RegentsError, match="SUMO's own traffic; expected --in sumo, found --in mirror"):
        replay(yields(), "mirror", background="reactive")
