"""The careful driver against the published one-dimensional results: cut-ins, cut-outs, decelerations.

Source: UN R157, Annex 4, Appendix 3 (performance models and their data sheets: a leader 2.0 s ahead that brakes by up
to 1 g, or that leaves the lane in front of a standing car, at up to 60 km/h, is preventable).
"""

import itertools

import numpy as np
import pytest
from careful_scenes import careful
from scenes import DT, crash, moved, moving, scene, straight_road

from regents_cosim.norms.careful import CAREFUL
from regents_cosim.scenario.collisions import first_contact

WIDTH, LONG = 3.5, 4.6
SPEEDS = np.array([20.0, 30.0, 40.0, 50.0, 60.0]) / 3.6  # [m/s] the regulation's
TIME = DT * np.arange(101)


def preventable(gap, closing, lateral):
    """Whether UN R157's performance model prevents the crash; `gap` [m] at the start of the cut-in, speeds [m/s]."""
    left = gap - closing * CAREFUL.wandering_m / lateral
    most, jerk = CAREFUL.most_braking_m_s2, CAREFUL.jerk_m_s3
    ramp_s = most / jerk
    lost = 0.5 * jerk * ramp_s**2
    needed = closing * (CAREFUL.evaluation_s + CAREFUL.delay_s)
    if closing <= lost:
        until = np.sqrt(2.0 * closing / jerk)
        return left > needed + closing * until - jerk * until**3 / 6.0
    return left > needed + closing * ramp_s - jerk * ramp_s**3 / 6.0 + (closing - lost) ** 2 / (2.0 * most)


def cut_in(gap, ego, other, lateral):
    """A crash of two cars in lanes of 3.5 m, or None where they never meet."""
    made = scene((0, 0, ego), (gap + LONG, WIDTH, other), road=straight_road(2, WIDTH), steps=101)
    y = WIDTH - np.clip(lateral * (TIME - 0.5), 0.0, WIDTH)
    yaw = np.append(0.0, np.arctan2(np.diff(y) / DT, other))
    tracks = moved(made, 1, x=made.tracks.x[1] + (ego - other) * 0.5, y=y, yaw=yaw)
    return crash(made, tracks) if first_contact(made.agents, tracks) else None


def compared():
    """(preventable by the formula, avoided by the verdict's braking) over the regulation's speeds, 20 to 60 km/h."""
    for ego, share, gap, lateral in itertools.product(
        SPEEDS, (0.2, 0.5, 0.8), np.arange(1.0, 32.0, 3.0), (0.6, 1.0, 1.8)
    ):
        attacked = cut_in(gap, ego, share * ego, lateral)
        if attacked is not None:
            drive = careful(attacked)
            yield preventable(gap, (1.0 - share) * ego, lateral), drive.avoids and drive.shift_m == 0.0


@pytest.mark.slow
def test_it_prevents_what_the_regulation_calls_preventable():
    found = list(compared())
    agree = sum(formula == verdict for formula, verdict in found) / len(found)
    less_able = sum(formula and not verdict for formula, verdict in found) / len(found)
    assert agree >= 0.93, agree  # 384 of 403; of the others it prevents 18 more
    assert less_able <= 0.01, less_able


def braked_m(speed, onset_s, most, jerk):
    """The distance [m] by each of `TIME` of a car that brakes from `onset_s` on, in the end with `most` [m/s^2]."""
    fine = np.linspace(0.0, TIME[-1], 10 * (len(TIME) - 1) + 1)
    braking = np.clip(jerk * (fine - onset_s), 0.0, most)
    lost = np.append(0.0, np.cumsum(0.5 * (braking[1:] + braking[:-1]) * np.diff(fine)))
    left = np.maximum(speed - lost, 0.0)
    return np.append(0.0, np.cumsum(0.5 * (left[1:] + left[:-1]) * np.diff(fine)))[::10]


def careful_m(speed, sees_s):
    """The distance [m] by each of `TIME` of the regulation's careful driver, who sees the risk at `sees_s`."""
    acts_s = sees_s + CAREFUL.evaluation_s + CAREFUL.delay_s
    return braked_m(speed, acts_s, CAREFUL.most_braking_m_s2, CAREFUL.jerk_m_s3)


def leader_brakes(gap, speed, braking):
    """A crash of an ego that keeps its speed with a leader that brakes steadily from 0.5 s on, or None."""
    made = scene((0, 0, speed), (gap + LONG, 0, speed), road=straight_road(1, WIDTH), steps=101)
    since = np.clip(TIME - 0.5, 0.0, speed / braking)
    along = gap + LONG + speed * np.minimum(TIME, 0.5) + speed * since - 0.5 * braking * since**2
    tracks = moved(made, 1, x=along, speed=np.maximum(speed - braking * since, 0.0))
    return crash(made, tracks) if first_contact(made.agents, tracks) else None


def leader_compared():
    """(headway [s], preventable by the formula, avoided by the verdict's braking) of leaders that brake."""
    for speed, headway_s, braking in itertools.product(SPEEDS, np.arange(0.4, 2.01, 0.2), (5.5, 6.5, 7.5, 8.5, 9.81)):
        gap = headway_s * speed
        attacked = leader_brakes(gap, speed, braking)
        if attacked is not None:
            leads = gap + np.asarray(attacked.tracks.x[1]) - attacked.tracks.x[1, 0]
            sees_s = 0.5 + DT  # at the first step at which its braking can be told
            drive = careful(attacked)
            yield headway_s, bool((leads > careful_m(speed, sees_s)).all()), drive.avoids and drive.shift_m == 0.0


def cut_out(ahead, speed, lateral):
    """A leader 2 s ahead avoids, from 0.5 s on, a car that stands `ahead` [m] beyond it; None where they touch."""
    gap = 2.0 * speed
    stands = gap + 2.0 * LONG + ahead
    made = scene((0, 0, speed), (stands, 0, speed), (gap + LONG, 0, speed), road=straight_road(2, WIDTH), steps=101)
    y = np.clip(lateral * (TIME - 0.5), 0.0, WIDTH)
    yaw = np.append(0.0, np.arctan2(np.diff(y) / DT, speed))
    tracks = moved(moving(made, 1, x=stands, speed=0.0), 2, y=y, yaw=yaw)
    beside = np.abs(tracks.x[2] - stands) < LONG
    return None if (beside & (y < 1.9)).any() else crash(made, tracks)


def test_a_cut_out_in_front_of_a_standing_car_is_prevented_at_two_seconds_headway():
    # At 60 km/h it does not: of who stands ahead in its lane it thinks 2 s before, so as to leave queues alone.
    for speed, lateral in itertools.product(SPEEDS[:-1], (0.9, 1.8)):
        nearest = next(one for ahead in np.arange(2.0, 60.0, 2.0) if (one := cut_out(ahead, speed, lateral)))
        assert careful(nearest).avoids, (speed, lateral)


def test_a_leader_that_brakes_by_a_g_is_prevented_at_two_seconds_headway():
    for speed in SPEEDS:
        attacked = leader_brakes(2.0 * speed, speed, 9.81)
        assert attacked is not None
        drive = careful(attacked)
        assert drive.avoids, speed
        assert drive.shift_m == 0.0, speed


@pytest.mark.slow
def test_it_follows_the_regulations_formula_behind_leaders_that_brake():
    found = list(leader_compared())
    agree = np.mean([formula == verdict for _, formula, verdict in found])
    less_able = np.mean([formula and not verdict for _, formula, verdict in found])
    assert agree >= 0.9, agree  # 209 of 225
    assert less_able <= 0.08, less_able  # 16: braking shows 0.2 s late over 0.3 s
