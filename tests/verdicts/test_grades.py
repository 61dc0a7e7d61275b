"""The two grades of a crash in small scenes: what a careful driver could prevent, and what the adversary did."""

from dataclasses import replace

import numpy as np
import pytest
from careful_scenes import careful, cut_in
from hypothesis import given, settings
from hypothesis import strategies as st
from places import ROOT
from scenes import DT, TIME, crash, moved, moving, scene, straight_road

from regents_cosim.cases.files import load_case
from regents_cosim.norms.careful import CAREFUL, braked_speed
from regents_cosim.norms.grades import Conduct, Prevention
from regents_cosim.scenario.judgement import Fault, Judgement, Law, ReferenceDrive
from regents_cosim.verdicts.careful.careful_driver import expected_swerve
from regents_cosim.verdicts.careful.ego_path import braking_positions, ego_path
from regents_cosim.verdicts.careful.others_around import OthersAround
from regents_cosim.verdicts.judge import judge, up_to_date
from regents_cosim.verdicts.law.offences import law_of

FORMER = ROOT / "tests" / "cases" / "former"
DECIDES, ACTS = 7, 14  # steps, in `stopping_at`


def stopping_at(y, drift=0.0):
    """A motorcycle ahead at `y` m that stops at once; from 1 s on it stands `drift` m further to the left."""
    made = scene((0, 3.2, 15), (36.5, y, 15), road=straight_road(3))
    narrow = replace(made.agents[1], kind="motorcycle", length=2.0, width=0.8)
    made = replace(made, agents=(made.agents[0], narrow))
    x = np.minimum(36.5 + 15.0 * TIME, 41.0)
    return crash(made, moved(made, 1, x=x, y=y + np.where(TIME > 1.0, drift, 0.0), speed=15.0 * (x < 41.0)))


def swerves_that_avoid(hit):
    """The swerves that avoid a crash of `stopping_at`, with knowledge of all that comes."""
    drives = {shift: braking_positions(hit, ego_path(hit), braked(hit), ACTS, shift) for shift in CAREFUL.swerves_m}
    around = OthersAround(hit, 1)
    return {shift for shift, drive in drives.items() if not around.met_by(drive).counts.any()}


def braked(hit):
    own = np.append(hit.tracks.speed[0], np.full(20, hit.tracks.speed[0, -1]))
    return braked_speed(np, own, ACTS, DT)


@pytest.mark.parametrize(
    ("hit", "prevention"),
    [
        (cut_in(18.0, 1.0), Prevention.PREVENTABLE),
        (stopping_at(3.6), Prevention.BY_SWERVING),
        (cut_in(2.0, 1.8), Prevention.NOT_PREVENTABLE),
    ],
)
def test_whether_a_careful_driver_prevents_it(hit, prevention):
    assert Judgement((), drivers=(careful(hit),)).prevention is prevention


@pytest.mark.parametrize(
    ("blamed", "flawless"), [("ego", True), ("nobody", None), ("adversary", False), ("both", False)]
)
def test_a_crash_is_flawless_only_if_the_adversary_is_known_not_to_be_at_fault(blamed, flawless):
    drive = ReferenceDrive("careful", avoids=True)
    found = Judgement((), law=Law((), ()), drivers=(drive,), fault=Fault(blamed, "cut_in", ""))
    assert (found.telling, found.flawless) == (True, flawless)
    assert found.conduct is {True: Conduct.KEEPS_RULES, None: Conduct.UNKNOWN, False: Conduct.MISTAKE}[flawless]


@pytest.mark.parametrize(("y", "shift"), [(3.6, -1.8), (2.8, 1.8)])
def test_it_swerves_to_the_side_where_it_expects_more_room(y, shift):
    found = careful(stopping_at(y))
    assert round(found.acts_s / DT) == ACTS
    assert (found.avoids, found.shift_m) == (True, shift)


def test_a_side_that_only_hindsight_would_choose_does_not_count():
    hit = stopping_at(3.6, drift=-1.6)  # it moves into the way of the swerve after the driver has decided
    assert swerves_that_avoid(hit) == {0.9, 1.8}
    assert not careful(hit).avoids
    assert Judgement((), drivers=(careful(hit),)).prevention is Prevention.NOT_PREVENTABLE


@settings(max_examples=10)
@given(st.floats(-30.0, 30.0), st.floats(-3.0, 3.0), st.floats(0.0, 20.0))
def test_what_comes_after_the_decision_does_not_change_it(ahead, aside, speed):
    hit, later = stopping_at(3.6), TIME > DECIDES * DT + 1e-9
    track = hit.tracks
    x, y, v = (
        np.where(later, value, values[1])
        for value, values in zip((41.0 + ahead, 3.6 + aside, speed), (track.x, track.y, track.speed), strict=True)
    )
    other = moving(hit, 1, x=x, y=y, speed=v)
    chosen = [expected_swerve(one, ego_path(hit), 1, DECIDES, ACTS, braked(hit))[0] for one in (hit, other)]
    assert chosen == [-1.8, -1.8]


@pytest.mark.parametrize(
    ("km_h", "named", "conduct"),
    [
        (50.0, set(), Conduct.KEEPS_RULES),
        (52.0, set(), Conduct.KEEPS_RULES),  # a camera may err by 3 km/h
        (57.0, {"over_limit"}, Conduct.MISTAKE),
        (62.0, {"over_limit", "speeding"}, Conduct.GROSS),
    ],
)
def test_to_drive_up_to_a_fifth_too_fast_is_a_mistake_and_more_is_gross(km_h, named, conduct):
    road = straight_road(2)
    road = replace(road, lanes=tuple(replace(lane, speed_limit=50.0 / 3.6) for lane in road.lanes))
    made = scene((0, 0, 20), (10.0, 0, 10.0), road=road)
    speed = km_h / 3.6
    law = law_of(crash(made, moved(made, 1, x=10.0 + speed * TIME, speed=speed)))
    assert {offence.name for offence in law.adversary} & {"over_limit", "speeding"} == named
    assert law.conduct is conduct


def test_who_gives_way_is_unknown_only_where_the_ways_cross_on_a_map_without_priorities():
    alike = cut_in(18.0, 1.0)
    assert "gives_no_way" not in law_of(alike).unknown
    across = law_of(moving(alike, 1, yaw=np.pi / 2))
    assert "gives_no_way" in across.unknown


def test_a_case_judged_before_there_were_grades_is_judged_again():
    assert not load_case(FORMER / "crossing-several").judgement.is_current
    judged = judge(cut_in(18.0, 1.0))
    assert judged.judgement.is_current
    assert up_to_date(judged) is judged
    assert up_to_date(replace(judged, judgement=replace(judged.judgement, edition=0))).judgement == judged.judgement
