"""How hard both drivers brake, with what room the careful one avoids the crash, and when the ego's lane is entered."""

import re
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from scenes import DT, TIME, crash, moved, scene
from shipped_cases import QUICKSTART

from regents_cosim.cases.suite import load_suite
from regents_cosim.geometry.boxes import Boxes, corners
from regents_cosim.reports.crash_moments import braking_line, enters_lane
from regents_cosim.reports.drawing.pictured_case import PicturedCase
from regents_cosim.reports.drawing.texts.notes import mark_words
from regents_cosim.scenario.attack_record import Collision
from regents_cosim.verdicts.careful.evasion import room_m

EVADED = [case for case in load_suite(QUICKSTART) if case.evasion is not None]
LANE_M, CAR_M = 3.2, 1.8


def said_of(speeds):
    """The line for an ego that drives at these speeds [m/s] until it is hit."""
    made, last = scene((0, 0, 10), (20, 0, 5)), len(speeds) - 1
    driven = made.tracks.speed.copy()
    driven[0, : len(speeds)] = speeds
    hit = Collision("car01", last, last * DT, "rear_end_by_ego", 5.0, attributed=True)
    return braking_line(made, replace(made.tracks, speed=driven), hit)


@pytest.mark.parametrize(
    ("speeds", "said"),
    [
        ([10, 10, 10, 10], "the ego not at all"),
        ([8, 9, 10, 10], "the ego not at all"),
        ([10, 9.95, 9.9, 9.85], "the ego hardly, with no more than 0.5 m/s²"),
        ([10, 10, 10, 9.5, 9.0], "the ego from 0.2 s, with up to 5.0 m/s²"),
        ([10, 9.7, 9.4, 8.8, 8.5], "the ego from 0.0 s, with up to 6.0 m/s² at 0.2 s"),
        ([10, 9.0, 8.0, 8.0, 8.0], "the ego from 0.0 s to 0.2 s, with up to 10.0 m/s²"),
        ([10, 9.0, 9.0, 8.0], "the ego from 0.0 s, with up to 10.0 m/s²"),  # a short pause
        (
            [10, 9.0, *(6 * [9.0]), 8.5],
            "the ego from 0.7 s, with up to 5.0 m/s²",
        ),  # a long one: the last braking counts
    ],
)
def test_a_line_says_since_when_and_how_hard_the_ego_brakes(speeds, said):
    assert said_of(speeds) == f"Braking: {said}."


@given(st.lists(st.floats(0.0, 30.0), min_size=2, max_size=40))
def test_an_ego_that_does_not_brake_is_nowhere_shown_as_slower(speeds):
    said, lost = said_of(speeds), -np.diff(speeds) / DT
    if "not at all" in said:
        assert lost.max() <= 1.0
        assert max(speeds) - speeds[-1] <= 0.5 / 3.6
    elif "hardly" in said:
        assert lost.max() <= 1.0
    else:
        assert lost.max() > 1.0


@pytest.mark.parametrize("case", EVADED, ids=lambda case: case.id)
def test_the_careful_driver_stands_beside_the_ego_with_what_room_he_leaves(case):
    since, hit = case.evades_from, case.collision
    most = (-np.diff(case.evasion.speed[0, since:]) / case.dt).max()
    said = braking_line(case, case.tracks, hit)
    assert f"; a careful driver from {case.judgement.evades_s:.1f} s, with up to {most:.1f} m/s²" in said
    assert "careful" not in braking_line(case, case.tracks, hit, with_careful=False)
    other = case.index(hit.agent)
    apart = [
        _body(case, case.evasion, 0, step).distance(_body(case, case.tracks, other, step))
        for step in range(since, case.tracks.steps)
        if case.tracks.valid[other, step]
    ]
    assert room_m(case) == pytest.approx(min(apart), abs=1e-6)
    assert re.search(r"which leaves (\d+\.\d|less than 0\.1) m between the two\.$", said)


def _body(case, tracks, agent, step):
    one = case.agents[agent]
    x, y, yaw = (float(values[agent, step]) for values in (tracks.x, tracks.y, tracks.yaw))
    return shapely.Polygon(np.asarray(corners(Boxes(x, y, yaw, one.length, one.width))))


def test_a_careful_driver_who_stands_already_is_said_to_stand():
    case = EVADED[0]
    standing = replace(case.evasion, speed=np.zeros_like(case.evasion.speed))
    said = braking_line(replace(case, evasion=standing), case.tracks, case.collision)
    assert f"; a careful driver from {case.judgement.evades_s:.1f} s, standing still" in said


def test_without_a_crash_nobody_brakes_for_it():
    made = scene((0, 0, 10))
    assert braking_line(made, made.tracks, None) == ""
    assert room_m(made) is None


def test_the_lane_is_entered_where_a_body_is_0_3_m_over_its_marking():
    case = cut_in()
    over = case.tracks.y[1] - 0.5 * CAR_M < 0.5 * LANE_M - 0.3
    assert enters_lane(case) == np.argmax(over) < case.collision.step
    marked = PicturedCase.of(case)
    (mark,) = (one for one in marked.marks if one.kind == "enters_lane")
    assert mark_words(marked, mark) == f"{mark.step * DT:.1f} s: adversary enters the ego's path"
    assert mark.pose[:2] == (case.tracks.x[1, mark.step], case.tracks.y[1, mark.step])


def cut_in(y=LANE_M, **changes):
    """A car that comes over from `y` [m] into the ego's lane, close ahead, and is hit there."""
    made = scene((0.0, 0.0, 10.0), (12.0, y, 8.0), **changes)
    over = np.clip((np.arange(made.tracks.steps) - 10) / 20, 0.0, 1.0)
    return crash(made, moved(made, 1, y=y * (1.0 - over)))


def test_no_lane_is_entered_by_one_who_is_in_it_all_along_or_comes_from_behind():
    assert enters_lane(cut_in(y=0.0)) is None
    behind = scene((0.0, 0.0, 5.0), (-30.0, 0.0, 15.0))
    assert enters_lane(crash(behind, behind.tracks)) is None
    assert enters_lane(scene((0.0, 0.0, 10.0))) is None
    case = cut_in()
    nowhere = replace(case.road, lanes=())
    assert enters_lane(replace(case, road=nowhere)) is None


def test_one_who_drives_straight_across_enters_the_lane():
    made = scene((0.0, 0.0, 10.0), (40.0, -20.0, 5.0))
    y = -20.0 + 5.0 * TIME
    case = crash(made, moved(made, 1, x=40.0, y=y, yaw=0.5 * np.pi))
    assert enters_lane(case) == np.argmax(y + 2.3 > -0.5 * LANE_M + 0.3)


def test_speeds_of_a_story_and_its_braking_agree():
    """An ego of which the line says that it does not brake is as fast at the crash as before, to half a km/h."""
    for case in EVADED:
        hit, speed = case.collision, case.tracks.speed[0]
        if "not at all" in braking_line(case, case.tracks, hit):
            assert 3.6 * (speed[: hit.step + 1].max() - speed[hit.step]) <= 0.5
