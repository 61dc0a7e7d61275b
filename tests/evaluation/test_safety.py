from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scenes import moving, scene

from regents_cosim.evaluation.drives.driving import drive_each, driving_rows
from regents_cosim.evaluation.drives.encounters import Approach, FrontPath, joining
from regents_cosim.evaluation.drives.safety import (
    Safety,
    arrival_time,
    crossing_ttc,
    deceleration_to_follow,
    deceleration_to_join,
    deceleration_to_yield,
    joining_ttc,
    measure_drive,
    post_encroachment_time,
)
from regents_cosim.norms.following import time_to_collision

DT = 0.1


def measured(made, contact=None):
    return measure_drive(made.agents, made.tracks, made.dt, contact)


def across(ego_speed, other_speed, ego_from=-40.0, other_from=-40.0, steps=81):
    """The ego along +x, another along +y; both ways cross at the origin."""
    made = scene((ego_from, 0, ego_speed), (0, other_from, other_speed), steps=steps)
    return moving(made, 1, x=0.0, y=other_from + other_speed * DT * np.arange(steps), yaw=np.pi / 2)


def turned(*agents, steps=81):
    """Agents at a constant speed from (x, y) along `yaw` [rad]: the ego first."""
    made = scene(*((x, y, speed) for x, y, _, speed in agents), steps=steps)
    along = DT * np.arange(steps)
    x = np.stack([x + speed * along * np.cos(yaw) for x, _, yaw, speed in agents])
    y = np.stack([y + speed * along * np.sin(yaw) for _, y, yaw, speed in agents])
    yaw = np.stack([np.full(steps, yaw) for _, _, yaw, _ in agents])
    return replace(made, tracks=replace(made.tracks, x=x, y=y, yaw=yaw))


def values(*numbers):
    return np.array(numbers, float)


def approach(entry, speed, accel=0.0, length=6.4):
    return Approach(values(entry), values(entry + length), values(speed), values(accel))


def test_time_to_collision_is_gap_by_closing_speed():
    assert time_to_collision(values(10.0, 10.0, 10.0), values(5.0, 0.0, -1.0)) == pytest.approx(
        [2.0, np.nan, np.nan], nan_ok=True
    )


def test_deceleration_of_a_follower():
    assert deceleration_to_follow(values(10.0), values(4.0)) == pytest.approx([0.8])  # 16 / 20
    assert np.isnan(deceleration_to_follow(values(10.0), values(-4.0)))


@pytest.mark.parametrize(
    ("way", "speed", "accel", "time"),
    [(20, 10, 0, 2.0), (20, 10, 3, 2.0), (18, 10, -2, 2.354), (25, 10, -2, 5.0), (26, 10, -2, np.inf), (-1, 0, 0, 0.0)],
)
def test_when_somebody_arrives(way, speed, accel, time):
    assert arrival_time(values(way), values(speed), values(accel)) == pytest.approx([time], abs=1e-3)


def test_two_that_meet_at_a_crossing():
    first, second = (
        approach(10.0, 10.0),
        approach(12.0, 10.0),
    )  # the first leaves after 1.64 s, the second comes at 1.2 s
    assert crossing_ttc(first, second) == pytest.approx([1.2])
    assert np.isnan(crossing_ttc(second, first))
    assert np.isnan(crossing_ttc(first, approach(17.0, 10.0)))
    # the second brakes for 1.64 s to cover 12 m: 2 (10 - 12 / 1.64) / 1.64; the first, for 1.84 s, 10 m: 4.96
    assert deceleration_to_yield(first, second) == pytest.approx([2 * (10 - 12 / 1.64) / 1.64])
    assert np.isnan(deceleration_to_yield(first, approach(17.0, 10.0)))


def test_who_stops_before_the_crossing_endangers_nobody():
    assert np.isnan(crossing_ttc(approach(10.0, 10.0), approach(12.0, 10.0, -5.0)))


def test_two_that_join():
    first, second = approach(10.0, 10.0, length=4.6), approach(14.0, 10.0, length=4.6)
    assert joining_ttc(first, second) == pytest.approx([1.4])  # the first one's rear is there until 1.46 s
    assert deceleration_to_join(first, second) == pytest.approx([100 / 28])
    assert np.isnan(joining_ttc(second, first))
    later = approach(30.0, 16.0, length=4.6)  # 15.4 m behind the rear of the first, 6 m/s faster
    assert joining_ttc(first, later) == pytest.approx([15.4 / 6])
    assert deceleration_to_join(first, later) == pytest.approx([36 / (2 * 15.4)])
    assert np.isnan(joining_ttc(first, approach(30.0, 9.0, length=4.6)))
    assert np.isnan(joining_ttc(approach(-1.0, 10.0, length=4.6), second))  # it follows by now


def coming_round(radius, turn, ahead=20.0, steps=81):
    """The ego along +x through the origin; another one reaches +x there, on an arc that turned it by `turn`."""
    made = scene((-40, 0, 10.0), (0, 0, 10.0), steps=steps)
    driven = 10.0 * DT * np.arange(steps) - radius * turn - ahead  # [m] past the end of the arc
    angle = np.clip(-driven / radius, 0.0, turn)  # [rad] still to turn
    straight = driven + radius * angle  # [m] behind the arc, or before it
    x = -radius * np.sin(angle) + straight * np.cos(angle)
    y = -radius * (1 - np.cos(angle)) + straight * np.sin(angle)
    return moving(made, 1, x=x, y=y, yaw=angle)


def test_ways_join_where_the_turn_ends():
    made = coming_round(15.0, np.pi / 2)
    ego, other = (FrontPath(made.agents[i], made.tracks, i, DT) for i in (0, 1))
    for joint, order in ((joining(ego, other), (0, 1)), (joining(other, ego), (1, 0))):
        assert joint is not None
        mine, theirs = (joint[i] for i in order)
        assert mine.entry[0] == pytest.approx(40.0 - 2.3, abs=1.0)
        assert theirs.entry[0] == pytest.approx(15.0 * np.pi / 2 + 20.0 - 2.3, abs=1.0)
        assert mine.exit - mine.entry == pytest.approx(np.full(81, 4.6))


def test_a_change_of_lanes_is_no_join():
    made = coming_round(300.0, np.deg2rad(10.0))
    assert joining(*(FrontPath(made.agents[i], made.tracks, i, DT) for i in (0, 1))) is None


def test_an_oblique_crossing_takes_longer():
    # two bands of 1.8 m at 60 degrees: each body is in the other's from (1.8 + 1.8 / 2) / 2 / sin 60 before
    reach = 1.35 / np.sin(np.pi / 3)
    found = measured(turned((-30, 0, 0, 10), (-52 * 0.5, -52 * np.sin(np.pi / 3), np.pi / 3, 10)))
    assert found.min_pet_s == pytest.approx((52 - reach - 2.3 - 30 - reach - 2.3) / 10)


def test_who_drives_against_my_way_but_across_it_is_no_leader():
    oncoming = np.pi - np.deg2rad(30)
    found = measured(turned((-60, 0, 0, 5), (40 * np.cos(np.pi / 6), -20, oncoming, 10)))
    assert found.min_ttc_s is None


def turning_left(stop, steps=81):
    """The ego along +x at 10 m/s up to x = `stop`, and there 10 degrees to the left; another one comes on y = 3.5."""
    made = turned((-40, 0, 0, 10), (70, 3.5, np.pi, 10), steps=steps)
    x = np.minimum(made.tracks.x[0], stop)
    yaw = np.interp(x, [stop - 4, stop], [0.0, np.deg2rad(10)])
    y = np.maximum(x - stop + 4, 0.0) * np.deg2rad(5)
    return moving(made, 0, x=x, y=y, yaw=yaw, speed=np.where(x < stop, 10.0, 0.0))


def test_who_waits_to_turn_is_not_on_the_way_of_others():
    assert measured(turning_left(0.0)).min_ttc_s is None


@pytest.mark.parametrize(("y", "ttc"), [(-1.0, 1.0), (0.0, 1.0), (1.0, 1.0), (-8.0, None)])
def test_who_stands_across_my_way(y, ttc):
    found = measured(turned((-13.2, 0, 0, 10), (0, y, np.pi / 2, 0), steps=2))  # 13.2 = 10 + 2.3 + 0.9
    assert found.min_ttc_s == (ttc if ttc is None else pytest.approx(ttc - 0.1))


def test_behind_a_leader():
    found = measured(scene((0, 0, 10.0), (64.6, 0, 5.0)))  # 60 m between the bumpers, 20 m after 8 s
    assert found.min_gap_m == pytest.approx(20.0)
    assert found.min_ttc_s == pytest.approx(4.0)
    assert found.max_drac_m_s2 == pytest.approx(25.0 / 40.0)
    assert found.min_pet_s is None


def test_ahead_of_a_follower_is_the_same():
    behind, ahead = measured(scene((0, 0, 10.0), (64.6, 0, 5.0))), measured(scene((64.6, 0, 5.0), (0, 0, 10.0)))
    assert ahead.min_ttc_s == pytest.approx(behind.min_ttc_s)
    assert ahead.max_drac_m_s2 == pytest.approx(behind.max_drac_m_s2)


def test_another_lane_is_no_conflict():
    found = measured(scene((0, 0, 10.0), (64.6, 3.2, 5.0)))
    assert found.min_ttc_s is None
    assert found.max_drac_m_s2 is None
    assert found.min_gap_m is not None


def test_alone_nothing_is_defined():
    assert measured(scene((0, 0, 10.0))) == Safety(None, None, None, None)


def test_who_passes_first_leaves_time():
    # the ego's rear leaves the area 3.2 m behind the crossing, the other's front enters it 3.2 m before
    found = measured(across(10.0, 10.0, -30.0, -52.0))
    assert found.min_pet_s == pytest.approx((52.0 - 3.2) / 10.0 - (30.0 + 3.2) / 10.0)
    assert found.min_ttc_s is None


def test_an_encroachment_needs_both():
    assert post_encroachment_time(approach(1.0, 10.0), approach(2.0, 10.0), DT) is None
    assert measured(across(10.0, 1.0, -30.0, -52.0)).min_pet_s is None


def test_after_contact_nothing_is_left():
    found = measured(scene((0, 0, 10.0), (45.1, 0, 0.0)), contact=41)
    assert (found.min_ttc_s, found.min_pet_s, found.min_gap_m) == (0.0, 0.0, 0.0)
    assert found.max_drac_m_s2 == pytest.approx(100.0 / (2 * 0.5))  # one step before, 0.5 m ahead


@settings(max_examples=25)
@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-3.1, 3.1), st.floats(4.0, 14.0), st.floats(4.0, 14.0))
def test_neither_place_nor_direction_nor_side_matters(dx, dy, turn, ego_speed, other_speed):
    ego_way, other_way = 40.0123, 43.0456  # to the crossing: at round speeds, too, no arrival falls onto a step
    made = across(ego_speed, other_speed, -ego_way, -other_way)
    assume(abs(ego_way / ego_speed - other_way / other_speed) > 0.05)  # on a tie the rounding decides who is first
    cos, sin, tracks = np.cos(turn), np.sin(turn), made.tracks
    moved = replace(
        tracks, x=dx + cos * tracks.x - sin * tracks.y, y=dy + sin * tracks.x + cos * tracks.y, yaw=tracks.yaw + turn
    )
    mirrored = replace(tracks, y=-tracks.y, yaw=-tracks.yaw)
    here = measured(made)
    for other in (measured(replace(made, tracks=moved)), measured(replace(made, tracks=mirrored))):
        for name in ("min_ttc_s", "min_pet_s", "max_drac_m_s2", "min_gap_m"):
            there, expected = getattr(other, name), getattr(here, name)
            assert (there is None) == (expected is None), name
            assert expected is None or there == pytest.approx(expected, abs=1e-6, rel=1e-6), name


def test_a_drive_tells_how_close_it_was():
    safe, crash = drive_each(
        [scene((0, 0, 10.0), (64.6, 0, 5.0)), scene((0, 0, 10.0), (45.1, 0, 0.0))], "constant_velocity"
    )
    assert safe.min_ttc_s == pytest.approx(4.0, abs=0.01)
    assert crash.min_ttc_s == crash.min_gap_m == 0.0
    (row,) = driving_rows([safe, crash])
    assert row.min_ttc_p5_s == pytest.approx(0.2, abs=0.01)  # 5 % of the way from 0 to 4
