"""Crashes with hand-computed verdicts, and properties of the careful driver."""

from dataclasses import replace

import numpy as np
import pytest
from avoidable_scenes import braking_lead
from careful_scenes import aside, careful, comes_over, cut_in
from hypothesis import given, settings
from hypothesis import strategies as st
from places import ROOT
from scenes import DT, TIME, crash, moved, moving, scene, straight_road

from regents_cosim.cases.suite import load_suite
from regents_cosim.verdicts.careful.careful_driver import careful_verdict
from regents_cosim.verdicts.law.fault import fault

QUICKSTART = ROOT / "scenarios" / "quickstart"


def test_a_cut_in_is_seen_once_it_has_left_the_middle_of_its_lane():
    # 0.375 m at 1 m/s after 1 s: at the first step beyond, 1.4 s; 0.4 s to evaluate, 0.75 s of delay
    found = careful(cut_in(18.0, 1.0))
    assert found.perceives_s == pytest.approx(1.4)
    assert found.acts_s == pytest.approx(2.5, abs=0.051)
    assert found.avoids
    assert found.shift_m == 0.0


def test_too_close_a_cut_in_is_not_avoided():
    found = careful(cut_in(2.0, 1.8))
    assert found.perceives_s is not None
    assert not found.avoids


def test_who_keeps_to_the_next_lane_is_not_suspected():
    # It is 12 m/s slower and beside the ego before it comes over, which it does within a step or two.
    found = careful(cut_in(24.0, 12.0, other=3.0))
    assert found.perceives_s is None or found.perceives_s >= 1.0


@pytest.mark.parametrize("ahead", [2.0, 0.0, -2.0])
def test_who_changes_lanes_looks_beside(ahead):
    attacked = comes_over(ahead)
    found, touches_s = careful(attacked), attacked.collision.step * DT
    # contact at 3 s and the 1.4 m between the two, at 1 m/s: seen 4 s and half a second of slack before
    assert touches_s == pytest.approx(4.4, abs=0.2)
    assert found.perceives_s < 0.5
    assert found.acts_s < 2.0
    assert found.avoids  # braking lets the other pass
    assert fault(attacked).at_fault == "ego"


def test_a_swerve_where_braking_does_not_do():
    made = scene((0, 3.2, 15), (36.5, 3.2, 15), road=straight_road(3))
    stands = crash(made, moved(made, 1, x=np.minimum(36.5 + 15.0 * TIME, 41.0), speed=15.0 * (TIME < 0.3)))
    narrow = replace(stands.agents[1], kind="motorcycle", length=2.0, width=0.8)
    narrowed = careful(replace(stands, agents=(stands.agents[0], narrow)))
    assert narrowed.avoids
    assert abs(narrowed.shift_m) in (0.9, 1.8)


def test_followers_that_brake_too_late_are_noted_and_third_parties_count():
    gap = 35.4
    assert careful(braking_lead(gap)).avoids
    assert careful(braking_lead(gap)).rear_ended_by == ()
    followed = careful(braking_lead(gap, (-4.6 - 1.0, 0, 15)))
    assert followed.avoids
    assert followed.rear_ended_by == ("car02",)
    brakes_in_time = careful(braking_lead(gap, (-4.6 - 18.0, 0, 15)))
    assert brakes_in_time.avoids
    assert brakes_in_time.rear_ended_by == ()
    crosses = braking_lead(gap)
    stopped_at = float(careful_verdict(crosses)[1].x[0, -1])
    made = scene((0, 0, 15), (gap + 4.6, 0, 15), (stopped_at + 3.0, 30.0, 0), road=straight_road(1))
    time = np.minimum(TIME, 2.5)
    hit = crash(made, moved(made, 1, x=gap + 4.6 + 15 * time - 3 * time**2, speed=15 - 6 * time))
    assert not careful(moving(hit, 2, y=np.where(TIME > 6.0, 0.0, 30.0))).avoids


@settings(max_examples=6)
@given(gap=st.floats(1.0, 30.0), lateral=st.floats(0.4, 2.5), other=st.floats(2.0, 12.0))
def test_until_it_acts_it_is_the_egos_own_drive_and_never_ahead_of_it(gap, lateral, other):
    made = scene((0, 0, 15), (gap + 4.6, 3.2, other), road=straight_road(2))
    try:
        attacked = crash(made, aside(made, lateral, other))
    except TypeError:  # they never met
        return
    found, evasion = careful_verdict(attacked)
    assert (evasion is not None) == found.avoids
    if evasion is not None:
        acts, x = int(found.acts_s / DT + 1e-6), evasion.x[0]
        np.testing.assert_allclose(x[: acts + 1], attacked.tracks.x[0, : acts + 1])
        assert (x <= attacked.tracks.x[0] + 1e-6).all()


def test_it_has_its_place_in_the_judgement_of_every_case():
    for case in load_suite(QUICKSTART):
        drive, _ = careful_verdict(case)
        assert (drive is not None) == (case.collision is not None)
        if drive is not None and drive.avoids:
            assert drive.perceives_s < drive.acts_s < case.collision.time_s
