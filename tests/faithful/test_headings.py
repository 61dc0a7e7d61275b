"""No heading is made up: lanes, motion and traffic tell it, or a case says that it is a guess."""

from dataclasses import replace
from pathlib import Path

import log_files
import numpy as np
import pytest
from command import regents
from scenes import crash, scene

from regents_cosim.cases.files import load_case
from regents_cosim.saving import save_unlisted
from regents_cosim.scenario.scenario import Agent, LeftOut
from regents_cosim.sources.left_out import told_left_out
from regents_cosim.sources.logs.missing_headings import RawTrack, heading_from_motion, with_headings
from regents_cosim.sources.logs.record import record_log, scenes_of
from regents_cosim.sources.logs.scene import LoggedLane, LoggedMap
from regents_cosim.sources.windows import Windows
from regents_cosim.verdicts.judge import judge
from regents_cosim.verdicts.words import telling_words

INPUTS = Path(__file__).parent / "inputs"
NOISE = np.random.default_rng(1).uniform(-0.15, 0.15, (2, 200))


def stands(x, y, name="parked", kind="car", noise=0.0):
    return RawTrack(
        Agent(name, kind, 4.5, 1.8), np.arange(200), x + noise * NOISE[0], y + noise * NOISE[1], np.full(200, np.nan)
    )


def drives(y, speed=10.0, name="drives"):
    x = 0.1 * speed * (np.arange(200) - 100)
    return RawTrack(Agent(name, "car", 4.5, 1.8), np.arange(200), x, np.full(200, y), np.full(200, np.nan))


def degrees(track):
    assert np.ptp(track.yaw) == 0.0
    return round(float(np.rad2deg(track.yaw[0])) % 360.0, 6)


def lane(name, *points, width=3.5):
    return LoggedLane(name, np.array(points, float), width)


CROSSING = LoggedMap(
    (lane("east", (-50, 0), (50, 0)), lane("north", (20, -50), (20, 50)), lane("slip", (0, 9), (9, 18)))
)


def test_standing_vehicles_of_ngsim_point_along_the_road():
    (log,) = (INPUTS / "14-ngsim-standing").iterdir()
    ((_, _, found),) = scenes_of(log)
    tracks = {track.agent.id: track for track in found.tracks}
    assert (degrees(tracks["5"]), degrees(tracks["6"])) == (90.0, 90.0)
    assert (tracks["6"].x[0], tracks["6"].y[0]) == pytest.approx((9.144, 342.899 * 0.3048 - 0.5 * 40 * 0.3048))
    assert not any(track.guessed for track in found.tracks)


@pytest.mark.parametrize("noise", [0.0, 1.0])
@pytest.mark.parametrize(("x", "y", "expected"), [(-10, 1.0, 0.0), (21.0, -30.0, 90.0), (4.0, 14.0, 45.0)])
def test_who_never_moves_points_along_its_lane(x, y, expected, noise):
    (found,) = with_headings([stands(x, y, noise=noise)], CROSSING)
    assert degrees(found) == expected
    assert not found.guessed


def test_where_lanes_cross_neither_tells():
    (found,) = with_headings([stands(20.2, 0.1)], CROSSING)
    assert found.guessed


def test_beside_the_lanes_it_is_a_guess_along_the_nearest():
    (found,) = with_headings([stands(20.0 + 3.0, -30.0)], CROSSING)
    assert (degrees(found), found.guessed) == (90.0, True)


@pytest.mark.parametrize("speed", [10.0, -10.0, 33.0])
def test_without_a_map_the_traffic_over_the_place_tells(speed):
    found = with_headings([drives(0.0, speed), stands(-20.5, 1.2), stands(-20.0, 4.0, "beside")])
    expected = 0.0 if speed > 0 else 180.0
    assert [(degrees(one), one.guessed) for one in found] == [(expected, False)] * 2 + [(expected, True)]


@pytest.mark.parametrize("noise", [0.0, 0.5, 4.0])
def test_noise_is_no_heading(noise):
    (found,) = with_headings([stands(0.0, 0.0, noise=noise)])
    assert (degrees(found), found.guessed) == (0.0, True)


def test_who_creeps_points_where_it_creeps_to():
    creeps = stands(0.0, 0.0, noise=0.3)
    (found,) = with_headings([creeps._replace(y=creeps.y - np.linspace(0.0, 0.8, 200))])
    assert degrees(found) == pytest.approx(270.0, abs=5.0)
    assert not found.guessed


def test_traffic_of_two_ways_over_one_place_does_not_tell():
    found = with_headings([drives(0.0), drives(0.5, -10.0, "back"), stands(-20.0, 0.2)])
    assert found[-1].guessed


def test_who_waits_points_where_it_goes_next_and_where_it_went_last():
    way = np.concatenate([np.zeros(80), np.arange(0.0, 20.0, 0.5), np.full(80, 19.5)])
    one = RawTrack(Agent("a", "car", 4.5, 1.8), np.arange(200), NOISE[0], way + NOISE[1], np.full(200, np.nan))
    (found,) = with_headings([one], CROSSING)
    assert np.abs(np.rad2deg(found.yaw) - 90.0).max() < 25.0, "noise of 15 cm over half a metre"
    assert np.abs(np.rad2deg(found.yaw[:70]) - 90.0).max() < 25.0


def test_a_vehicle_that_backs_out_does_not_turn_round():
    x = np.concatenate([np.arange(0.0, -5.0, -0.6), np.arange(-5.0, 40.0, 0.6)])
    np.testing.assert_allclose(heading_from_motion(x, 0.0 * x, backs=True), 0.0, atol=1e-9)


def test_headings_that_the_log_has_stay():
    known = np.where(np.arange(200) < 5, 1.0, np.nan)
    (found,) = with_headings([stands(-10, 1.0)._replace(yaw=known)], CROSSING)
    np.testing.assert_array_equal(found.yaw, 1.0)


def test_pedestrians_are_as_wide_as_long():
    (found,) = with_headings([stands(20.0, 30.0, kind="pedestrian")])
    assert not found.guessed


def test_an_obstacle_of_commonroad_without_orientation_takes_its_lane(tmp_path):
    log = log_files.write("commonroad", tmp_path)
    text = log.read_text()
    bare = text.replace("<orientation><exact>0.0</exact></orientation>", "")
    assert bare != text
    log.write_text(bare)
    ((_, _, found),) = scenes_of(log)
    assert all(np.allclose(track.yaw, 0.0, atol=1e-6) for track in found.tracks if track.agent.kind != "pedestrian")


def test_a_heading_that_interaction_leaves_empty_is_that_of_the_lane(tmp_path):
    log = log_files.write("interaction", tmp_path)
    rows = [f"77,{k},{100 * k},car,50.0,2.0,0,0,,4.5,1.8" for k in range(1, 60)]
    log.write_text("\n".join([log.read_text().strip(), *rows]) + "\n")
    ((_, _, found),) = scenes_of(log)
    (parked,) = (track for track in found.tracks if track.agent.id == "77")
    assert degrees(parked) == pytest.approx(0.0, abs=1e-3)
    assert not parked.guessed


PARKED = "id,time,x,y,length,width\n" + "".join(
    f"{name},{k / 10:.1f},{x + 0.1 * v * k:.2f},{y},4.5,1.8\n"
    for name, x, y, v in (("a", 0.0, 0.0, 9.0), ("b", 20.0, 0.0, 9.0), ("c", 35.0, 0.5, 0.0), ("d", 60.0, 5.0, 0.0))
    for k in range(60)
)


@pytest.mark.slow
def test_the_terminal_names_who_is_guessed(tmp_path):
    (tmp_path / "parked.csv").write_text(PARKED)
    window = ("--ego", "a", "--horizon", 4, "--count", 1)
    done = regents("record", "--log", "parked.csv", *window, "-o", "out", cwd=tmp_path, code=0)
    assert "road users with a guessed heading" in done.stderr
    (folder,) = (one.parent for one in (tmp_path / "out").glob("*/scenario.json"))
    assert load_case(folder).provenance.guessed == {"d"}, "c stands where others drive"


def test_the_ledger_names_who_is_guessed(tmp_path):
    (tmp_path / "parked.csv").write_text(PARKED)
    (case,) = record_log(tmp_path / "parked.csv", Windows(horizon_s=4.0, count=1), ego="a", tell=lambda _: None)
    assert case.provenance.guessed == {"d"}, "c stands where others drive"
    (line,) = told_left_out([case])
    assert line.startswith("road users with a guessed heading")


def test_of_a_crash_with_a_guess_nothing_is_known(tmp_path):
    before = scene((0.0, 0.0, 10.0), (30.0, 0.0, 0.0))
    met = crash(before, before.tracks)
    other = met.collision.agent
    known = judge(met).judgement
    assert known.guessed == ()
    assert known.drivers
    ledger = (LeftOut("guessed", 1, (other,)),)
    guessed = judge(replace(met, provenance=replace(met.provenance, left_out=ledger)))
    assert guessed.judgement.guessed == (other,)
    assert (guessed.judgement.telling, guessed.judgement.prevention) == (None, "unknown")
    assert telling_words(guessed.judgement) == f"not known: the heading of {other} is a guess"
    assert load_case(save_unlisted(guessed, tmp_path)).judgement == guessed.judgement
    apart = replace(met, provenance=replace(met.provenance, left_out=(LeftOut("guessed", 1, ("z",)),)))
    assert judge(apart).judgement.guessed == ()


def test_a_standing_vehicle_of_a_recording_keeps_its_place(tmp_path):
    """The centre of a front bumper that nothing turns round lies half a length behind it."""
    (tmp_path / "front.csv").write_text(PARKED)
    (tmp_path / "front.toml").write_text('anchor = "front"\n')
    (case,) = record_log(tmp_path / "front.csv", Windows(horizon_s=4.0, count=1), ego="a", tell=lambda _: None)
    at = case.index("c")
    assert (case.tracks.x[at, 0], case.tracks.y[at, 0]) == pytest.approx((35.0 - 2.25, 0.5))
