"""Crashes with hand-computed verdicts, and properties of every verdict."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from avoidable_scenes import ONE_LANE, TWO_LANES, braking_lead, moved, pushed, standing_car
from hypothesis import given, settings
from hypothesis import strategies as st
from places import ROOT
from scenes import DT, crash, platoon, scene, straight_road

from regents_cosim.cases.files import load_case
from regents_cosim.cases.suite import load_suite
from regents_cosim.errors import CaseError, ScenarioError
from regents_cosim.geometry.boxes import Boxes, corners, overlap
from regents_cosim.norms.limits import ACCEL_LIMIT, CURVATURE_LIMIT
from regents_cosim.replays.replay import replay_each
from regents_cosim.saving import save_unlisted
from regents_cosim.scenario import Tracks
from regents_cosim.verdicts.escape.avoidability import avoidability
from regents_cosim.verdicts.escape.manoeuvres import FRICTION, GRAVITY, ManoeuvreBank
from regents_cosim.verdicts.judge import judge, judge_each

QUICKSTART = ROOT / "scenarios" / "quickstart"
EVERY_STEP = ((np.inf, DT),)
STOP = ManoeuvreBank(accels=(-6.0,), lasting_s=(None,), shifts=(), lateral_accels=())
HAND = ManoeuvreBank((-6.0, -4.0, -2.0), (None,), (1.8, 3.5), (4.0, 6.5), EVERY_STEP)


def test_braking_in_time():
    # 35.4 + 18.75 m to go: full braking from 15 m/s takes 18.75 m, at 4 m/s^2 28.1 m, at 2 m/s^2 56.3 m, too much
    found, evasion = avoidability(braking_lead(35.4), HAND)
    assert found.avoidable
    assert found.last_onset_step == 23  # 34.5 m at 15 m/s; 36 m are too far
    assert (found.gentlest.accel, found.gentlest.shift) == (-4.0, 0.0)
    assert found.gentlest.onset_step == 17  # 25.5 m; 27 m are too far
    assert found.gentlest.friction_share == pytest.approx(4.0 / (FRICTION * GRAVITY))
    assert evasion.speed[0, -1] == 0.0
    assert evasion.x[0, -1] == pytest.approx(25.5 + 15**2 / 8, abs=0.02)  # 0.02: the last step ends between two stops


def test_a_car_that_appears_right_in_front_cannot_be_avoided():
    made = scene((0, 0, 20), (4.6 + 3.0, 3.2, 5), road=straight_road(3))
    aside = np.maximum(3.2 - 8.0 * DT * np.arange(81), 0.0)
    found, evasion = avoidability(crash(made, moved(made, 1, y=aside)))
    assert (found.avoidable, found.evading, found.last_onset_step, found.gentlest) == (False, 0, None, None)
    assert found.tried > 0
    assert evasion is None


def test_only_steering_helps_where_the_way_is_too_short_to_brake():
    found, evasion = avoidability(standing_car(25.0, TWO_LANES), HAND)  # to stop takes 33 m
    assert found.gentlest.shift == 3.5  # to the left, where there is a lane
    assert found.gentlest.lateral_accel > 0
    assert evasion.y[0, -1] == pytest.approx(3.5, abs=0.05)
    assert evasion.yaw[0, -1] == pytest.approx(0.0, abs=1e-9)


def test_nobody_evades_off_the_road():
    assert not avoidability(standing_car(25.0, ONE_LANE), HAND)[0].avoidable
    assert avoidability(standing_car(35.0, ONE_LANE), HAND)[0].avoidable


def test_a_corner_that_was_off_the_road_does_not_count():
    beside = replace(ONE_LANE, drivable=shapely.box(-200.0, -0.2, 600.0, 1.6))
    assert avoidability(replace(standing_car(35.0, ONE_LANE), road=beside), HAND)[0].avoidable


def test_a_follower_who_drives_on_spoils_the_braking():
    alone, followed = braking_lead(35.4), braking_lead(35.4, (-4.6 - 3.0, 0, 15))
    assert avoidability(alone, HAND)[0].avoidable
    assert not avoidability(followed, HAND)[0].avoidable
    assert avoidability(braking_lead(35.4, (-4.6 - 3.0, 0, 15), road=TWO_LANES), HAND)[0].avoidable


def test_the_closer_the_crash_the_earlier_the_last_onset():
    found = [avoidability(braking_lead(gap), HAND)[0].last_onset_step for gap in (8.0, 16.0, 30.0, 60.0)]
    assert found == sorted(found)
    assert found[0] < found[-1]


def test_to_collide_beyond_the_horizon_is_not_to_evade():
    # a wall of cars across the only lane, 20 m/s, hit in the last step: from 13 m to go nobody stops
    late = standing_car(159.0, ONE_LANE)
    assert late.attack.collision.step == 80
    found, _ = avoidability(late, HAND)
    assert found.last_onset_step == round((159.0 - 0.1 - 20**2 / 12) / 2.0 - 0.5)


def test_the_own_way_is_kept_around_a_bend():
    curvature, speed = 1 / 30.0, 10.0
    turned = curvature * speed * DT * np.arange(81)
    made = scene((0, 0, speed), (0, 40, speed), road=replace(ONE_LANE, drivable=shapely.box(-99, -99, 99, 99)))
    ego = {"x": np.sin(turned) / curvature, "y": (1 - np.cos(turned)) / curvature, "yaw": turned}
    there = {"x": ego["x"][45], "y": ego["y"][45], "yaw": turned[45]}
    both = {name: np.stack([ego[name], np.full(81, there[name])]) for name in ego}
    tracks = Tracks(**both, speed=np.array([[speed], [0.0]]) + np.zeros((2, 81)), valid=np.ones((2, 81), bool))
    _, evasion = avoidability(crash(made, tracks), STOP)
    assert evasion.speed[0, -1] == 0.0
    off = np.hypot(evasion.x[0], evasion.y[0] - 1 / curvature) - 1 / curvature
    assert np.abs(off).max() < 0.02


def test_a_bend_that_no_tyres_can_drive_is_followed_as_well_as_they_can():
    made = scene((0, 0, 30), (150, 0, 30), road=replace(ONE_LANE, drivable=shapely.box(-99, -99, 399, 99)))
    yaw = np.array(made.tracks.yaw)
    yaw[0, 10:14] = 0.15  # to and fro within a step each, at 30 m/s
    swerving = replace(moved(made, 1, x=150.0, speed=0.0), yaw=yaw)
    found, evasion = avoidability(crash(made, swerving), STOP)
    assert found.last_onset_step is not None
    assert evasion.yaw[0, -1] == pytest.approx(0.0, abs=1e-6)


@given(st.integers(0, 10_000), st.floats(2.0, 8.0), st.floats(0.5, 3.0))
@settings(max_examples=10)
def test_an_evasion_touches_nobody_keeps_to_the_road_and_can_be_driven(seed, drift, accel):
    attacked = pushed(seed, drift, accel)
    if attacked is None:
        return
    found, ego = avoidability(attacked)
    assert (ego is not None) == found.avoidable == (found.evading > 0)
    if ego is None:
        return
    onset, own = found.gentlest.onset_step, attacked.tracks
    assert onset <= found.last_onset_step < attacked.attack.collision.step

    mine, others = Boxes(ego.x, ego.y, ego.yaw, 4.6, 1.8), Boxes(own.x[1:], own.y[1:], own.yaw[1:], 4.6, 1.8)
    assert not overlap(mine, others).any()

    off = shapely.distance(attacked.road.drivable, shapely.points(corners(mine)[0])) > 0.3 + 1e-9
    assert not off[onset:, ~off[onset]].any()

    for name in ("x", "y", "yaw", "speed"):
        np.testing.assert_array_equal(getattr(ego, name)[0, : onset + 1], getattr(own, name)[0, : onset + 1])
    speed, yaw = ego.speed[0], ego.yaw[0]
    travelled = 0.5 * (speed[1:] + speed[:-1]) * DT
    after = np.s_[onset:]
    mid = yaw[:-1] + 0.5 * ego.curvature[0] * travelled
    np.testing.assert_allclose(np.diff(speed), ego.accel[0] * DT, atol=1e-9)
    np.testing.assert_allclose(np.diff(yaw)[after], (ego.curvature[0] * travelled)[after], atol=1e-9)
    np.testing.assert_allclose(np.diff(ego.x[0])[after], (travelled * np.cos(mid))[after], atol=1e-9)
    np.testing.assert_allclose(np.diff(ego.y[0])[after], (travelled * np.sin(mid))[after], atol=1e-9)

    sideways = (travelled / DT) ** 2 * ego.curvature[0]
    used = np.hypot(ego.accel[0], sideways)[after].max() / (FRICTION * GRAVITY)
    assert used == pytest.approx(found.gentlest.friction_share, abs=1e-6)
    assert used <= 1.0 + 1e-6
    assert np.abs(ego.accel[0, after]).max() <= ACCEL_LIMIT + 1e-9
    assert np.abs(ego.curvature[0, after]).max() <= CURVATURE_LIMIT


def test_a_judged_case_is_read_as_it_was_written(tmp_path):
    judged = judge(braking_lead(35.4))
    folder = save_unlisted(judged, tmp_path)
    read = load_case(folder)
    assert read.judgement == judged.judgement
    assert read.judgement.actionable
    for name in ("x", "y", "yaw", "speed", "accel", "curvature"):
        np.testing.assert_array_equal(getattr(read.evasion, name), getattr(judged.evasion, name))
    (folder / "evasion.npz").unlink()
    with pytest.raises(CaseError, match=r"evasion.npz"):
        load_case(folder)


def test_what_has_no_crash_is_not_judged():
    recorded = platoon()
    assert judge(recorded) is recorded
    with pytest.raises(ScenarioError, match="no collision"):
        avoidability(recorded)


def test_only_an_avoidable_crash_can_be_evaded():
    with pytest.raises(ScenarioError, match="has no evasion"):
        standing_car(25.0, ONE_LANE).evaded()


@pytest.fixture(scope="module")
def judged():
    """Crashes of the cases that are shipped, with their judgement."""
    found = list(judge_each(load_suite(QUICKSTART)))
    assert [case.judgement is not None for case in found] == [case.attack.outcome == "collision" for case in found]
    return [case for case in found if case.evasion is not None]


@pytest.mark.slow
@pytest.mark.parametrize("where", ["sumo", "highway", "mirror"])
def test_simulators_replay_an_evasion_without_a_collision(judged, where):
    assert len(judged) >= 3
    for replay in replay_each([case.evaded() for case in judged[:3]], where):
        assert replay.verified, replay.reason
        assert (replay.expected, replay.found) == (None, None)
        assert replay.replayed.tracks.x[0] == pytest.approx(judged_track(judged, replay.case), abs=1e-3)


def judged_track(judged, name):
    """The track of the evasion of a case."""
    return next(case for case in judged if case.id == name).evasion.x[0]


@pytest.mark.slow
def test_an_evasion_that_collides_is_found_out(judged):
    case = judged[0]
    (replay,) = replay_each([replace(case, evasion=replace_ego(case)).evaded()], "mirror")
    assert not replay.verified
    assert "notes no collision" in replay.reason


def replace_ego(case):
    """Replace the evasion by the drive into the crash."""
    own = case.tracks
    return Tracks(own.x[:1], own.y[:1], own.yaw[:1], own.speed[:1], own.valid[:1])
