"""The careful driver's cut-ins against the regulation's own formula, in one dimension."""

import itertools

import numpy as np
import pytest
from scenes import DT, crash, scene, straight_road
from test_reference_drivers import careful

from regents_cosim.collisions import first_contact
from regents_cosim.planners.reference.parameters import CAREFUL

WIDTH, LONG = 3.5, 4.6


def preventable(gap, closing, lateral):
    """By UN R157's performance model: `gap` [m] when the cut-in begins, speeds [m/s]. It sees 0.375 m of it first."""
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
    time = DT * np.arange(101)
    y, yaw = (np.array(values) for values in (made.tracks.y, made.tracks.yaw))
    y[1] = WIDTH - np.clip(lateral * (time - 0.5), 0.0, WIDTH)
    yaw[1] = np.append(0.0, np.arctan2(np.diff(y[1]) / DT, other))
    x = np.array(made.tracks.x)
    x[1] += (ego - other) * 0.5
    tracks = made.tracks.__class__(x, y, yaw, made.tracks.speed, made.tracks.valid)
    return crash(made, tracks) if first_contact(made.agents, tracks) else None


def compared():
    """(preventable by the formula, avoided by the verdict's braking) over the regulation's speeds, 20 to 60 km/h."""
    for ego, share, gap, lateral in itertools.product(
        np.array([20.0, 30.0, 40.0, 50.0, 60.0]) / 3.6, (0.2, 0.5, 0.8), np.arange(1.0, 32.0, 3.0), (0.6, 1.0, 1.8)
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
