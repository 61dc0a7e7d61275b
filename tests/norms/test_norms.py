"""Rules for drivers hold for NumPy's double precision and JAX's single precision alike."""

import hypothesis.strategies as st
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from hypothesis import assume, given

from regents_cosim.norms.careful import CAREFUL, braked_speed, careful_reaction_steps, swerve, swerve_length
from regents_cosim.norms.clean import closes_at, contact_share, hardest
from regents_cosim.norms.foresight import (
    PlaceOnPath,
    along_arc,
    between_lanes,
    can_wait,
    curvature_of,
    drifts,
    further,
    is_suspected,
    place_of,
)
from regents_cosim.norms.limits import CURVATURE_LIMIT, steps_of

DT = 0.1


def on_both(rule, *arrays, **numbers):
    """What a rule says of arrays in double precision; it says the same in single precision."""
    here = rule(np, *arrays, **numbers)
    there = rule(jnp, *(jnp.asarray(values) for values in arrays), **numbers)
    for mine, theirs in zip(here, there, strict=True) if isinstance(here, tuple) else [(here, there)]:
        np.testing.assert_allclose(mine, theirs, rtol=1e-4, atol=1e-3)
    return here


@given(
    seconds=st.sampled_from([0.3, 0.4, 1.0, 1.15]), dt=st.sampled_from([0.02, 0.04, 1 / 15, 0.08, 0.1, 0.12, 0.2, 0.5])
)
def test_steps_are_as_many_on_the_device(seconds, dt):
    steps = steps_of(np, seconds, dt)
    assert steps == steps_of(jnp, seconds, jnp.float32(dt))
    assert abs(steps * dt - seconds) <= 0.501 * dt


@given(
    own=st.sampled_from([5, 60]).flatmap(lambda steps: st.lists(st.floats(0.0, 30.0), min_size=steps, max_size=steps)),
    onset=st.integers(0, 40),
)
def test_braking_is_never_harder_than_the_brakes_nor_less_than_the_own(own, onset):
    speed, onset = np.array(own), min(onset, len(own) - 2)
    braked = on_both(braked_speed, speed, onset=onset, dt=DT)
    assert (braked >= 0.0).all()
    np.testing.assert_array_equal(braked[: onset + 1], speed[: onset + 1])
    after, own_accel = np.diff(braked[onset:]) / DT, np.diff(speed[onset:]) / DT
    assert (after >= np.minimum(own_accel, -CAREFUL.most_braking_m_s2) - 1e-9).all()
    moving = braked[onset + 1 :] > 0.0
    assert (after[moving] <= np.minimum(own_accel, 0.0)[moving] + 1e-9).all()


@pytest.mark.parametrize("dt", [0.05, 0.1, 0.2, 0.25])
def test_full_braking_takes_its_time_after_the_whole_reaction(dt):
    seen, steps = 2, round(3.0 / dt)
    onset = seen + int(careful_reaction_steps(np, dt))
    speed = braked_speed(np, np.full(steps, 30.0), onset, dt)
    braking_s = np.arange(steps) * dt - seen * dt - (0.4 + 0.75)  # since the brakes act
    # 0.6 s to 7.59 m/s^2 (0.774 g): half of it meanwhile, in the mean
    rises_s = 0.774 * 9.81 / 12.65
    full = braking_s >= rises_s
    lost = 0.774 * 9.81 * (braking_s - 0.5 * rises_s)
    np.testing.assert_allclose(speed[full], (30.0 - lost)[full], atol=1e-6)
    np.testing.assert_array_equal(speed[braking_s <= 0.0], 30.0)


@given(speed=st.floats(1.0, 30.0), shift=st.floats(0.1, 4.0).flatmap(lambda m: st.sampled_from([m, -m])))
def test_a_swerve_ends_aside_along_the_way_and_asks_for_no_more_than_it_may(speed, shift):
    length = swerve_length(np, speed, shift)
    along = np.linspace(0.0, 1.5 * length, 4001)
    aside, turn = on_both(swerve, along, length=length, shift_m=shift)
    assert (aside[0], turn[0]) == (0.0, 0.0)
    assert aside[-1] == pytest.approx(shift)
    assert turn[-1] == pytest.approx(0.0, abs=1e-9)
    curvature = np.abs(np.gradient(np.gradient(aside, along), along)).max()
    assert curvature <= 1.01 * min(CAREFUL.swerve_m_s2 / speed**2, 0.9 * CURVATURE_LIMIT)


@given(speed=st.floats(0.0, 40.0), braking=st.floats(0.0, 8.0), time=st.floats(0.0, 8.0))
def test_who_brakes_comes_as_far_as_physics_says(speed, braking, time):
    fine = np.linspace(0.0, time, 20001)
    driven = np.trapezoid(np.maximum(speed - braking * fine, 0.0), fine)
    assert on_both(further, np.array([speed]), braking=braking, time=time) == pytest.approx(driven, abs=1e-2)


@given(curvature=st.floats(-0.3, 0.3), yaw=st.floats(-3.0, 3.0), distance=st.floats(0.0, 50.0))
def test_an_arc_is_as_long_as_the_distance_and_turns_with_its_curvature(curvature, yaw, distance):
    steps = np.linspace(0.0, distance, 2001)
    x, y, turned = on_both(along_arc, *(np.array([value]) for value in (1.0, 2.0, yaw)), curvature * steps, steps)
    assert np.hypot(np.diff(x), np.diff(y)).sum() == pytest.approx(distance, abs=1e-3)
    assert turned[-1] - yaw == pytest.approx(curvature * distance)
    assert float(curvature_of(np, curvature * 10.0, 10.0, 1.0)) == pytest.approx(curvature)


@pytest.mark.parametrize(
    ("ahead_m", "aside_m", "turn", "leads", "in_way", "beside"),
    [
        (10.0, 0.0, 0.0, True, True, False),
        (-10.0, 0.0, 0.0, False, False, False),
        (10.0, 3.2, 0.0, False, False, False),
        (10.0, 3.2, np.pi / 2, False, True, False),  # across the way its length reaches in
        (4.9, 3.2, 0.0, False, False, True),
        (-4.9, 3.2, 0.0, False, False, True),
        (-5.1, 3.2, 0.0, False, False, False),
    ],
)
def test_the_place_on_the_path(ahead_m, aside_m, turn, leads, in_way, beside):
    place = on_both(place_of, *(np.array([v]) for v in (ahead_m, aside_m, turn, 2.5, 0.9)), ego_half=(2.5, 0.9))
    assert (bool(place.leads[0]), bool(place.in_way[0]), bool(place.beside[0])) == (leads, in_way, beside)


@pytest.mark.parametrize(
    ("off_m", "aside_m", "degrees", "in_way", "expected"),
    [
        (-0.4, 3.5, 0.0, False, True),  # in the next lane to the left, it comes to the right
        (0.4, 3.5, 0.0, False, False),  # it moves away from the ego's way
        (0.4, -3.5, 0.0, False, True),
        (-0.3, 3.5, 0.0, False, False),  # within the wandering zone
        (-0.4, 7.0, 0.0, False, False),  # it changes to the next lane, and is expected to end there
        (0.4, 3.5, 180.0, False, True),  # oncoming traffic may turn across the ego's way
        (-0.4, 7.0, 180.0, False, True),
        (0.4, 1.0, 0.0, True, True),  # in the ego's way already
        (np.inf, 7.0, 0.0, False, True),  # no lane runs its way
    ],
)
def test_who_drifts_from_its_lane(off_m, aside_m, degrees, in_way, expected):
    no = np.array([False])
    place = PlaceOnPath(no, np.array([in_way]), no, no, np.array([aside_m]), np.cos(np.deg2rad([degrees])))
    off = np.array([off_m])
    assert bool(drifts(np, off, place)[0]) == bool(drifts(jnp, jnp.asarray(off), place)[0]) == expected


@pytest.mark.parametrize(
    ("meets_s", "degrees", "in_way", "wanders", "waits", "braking", "expected"),
    [
        (3.0, 0.0, True, False, False, 0.0, False),  # a leader that keeps its lane is a danger below 2 s alone
        (1.5, 0.0, True, False, False, 0.0, True),
        (3.0, 0.0, True, False, False, 6.0, True),  # or when it brakes hard
        (3.0, 0.0, True, True, False, 0.0, False),  # so is one that leaves its lane
        (3.0, 0.0, False, True, False, 0.0, False),  # and one that cuts in
        (1.5, 0.0, False, True, False, 0.0, True),
        (3.0, 0.0, False, True, False, 6.0, True),
        (3.0, 180.0, False, True, False, 0.0, True),  # not so oncoming traffic that leaves its lane
        (3.0, 90.0, False, False, False, 0.0, True),  # crossing traffic
        (3.0, 90.0, False, True, True, 0.0, False),  # that can still wait where it has to
        (3.0, 90.0, True, False, True, 0.0, True),  # but stands in the way
        (np.inf, 90.0, True, True, False, 6.0, False),  # that never meets the ego
    ],
)
def test_who_is_suspected(meets_s, degrees, in_way, wanders, waits, braking, expected):
    yes = np.array([True])
    place = PlaceOnPath(yes, np.array([in_way]), yes, yes, np.zeros(1), np.ones(1))
    turn_cos, of_other = np.cos(np.deg2rad([degrees])), (np.array([one]) for one in (wanders, waits, braking))
    asked = (np.array([meets_s]), turn_cos, *of_other, np.array([False]))
    here, there = is_suspected(np, place, *asked), is_suspected(jnp, place, *map(jnp.asarray, asked))
    assert bool(here[0]) == bool(there[0]) == expected


@pytest.mark.parametrize(
    ("comes_over", "beside", "ahead", "degrees", "meets_s", "expected"),
    [
        (True, True, False, 0.0, 3.0, True),  # an ego that changes lanes gives way to one beside it, a bit behind
        (True, True, True, 0.0, 3.0, True),
        (False, True, True, 0.0, 3.0, False),  # one that keeps its lane need not look at those that keep theirs
        (True, False, False, 0.0, 3.0, False),  # who is wholly behind can brake
        (True, True, False, 0.0, np.inf, False),
        (True, True, False, 180.0, 3.0, False),  # oncoming traffic is no traffic beside
    ],
)
def test_who_changes_lanes_suspects_those_beside(comes_over, beside, ahead, degrees, meets_s, expected):
    no = np.array([False])
    place = PlaceOnPath(np.array([ahead]), no, np.array([beside]), no, np.zeros(1), np.ones(1))
    asked = np.array([meets_s]), np.cos(np.deg2rad([degrees])), no, no, np.array([0.0]), np.array([comes_over])
    here, there = is_suspected(np, place, *asked), is_suspected(jnp, place, *map(jnp.asarray, asked))
    assert bool(here[0]) == bool(there[0]) == expected


@pytest.mark.parametrize(("away_m", "between"), [(0.3, False), (0.4, True), (1.7, True), (1e6, False), (np.inf, False)])
def test_an_ego_between_two_lanes_changes_them(away_m, between):
    assert bool(between_lanes(away_m)) == between


@pytest.mark.parametrize(
    ("line_m", "speed", "waits"),
    [
        (12.5, 8.24, True),  # 10 m from its front to the line: 3.4 m/s^2 stop it from 8.25 m/s
        (12.5, 8.26, False),
        (2.6, 0.0, True),
        (2.4, 0.0, False),  # its front is over the line
        (0.0, 0.0, False),  # there is no line
    ],
)
def test_who_can_wait(line_m, speed, waits):
    assert bool(can_wait(line_m, 2.5, speed)) == waits


@given(
    ahead=st.floats(-6.0, 6.0),
    left=st.floats(-3.0, 3.0),
    yaw=st.floats(-3.1, 3.1),
    turn=st.floats(-3.1, 3.1),
)
def test_where_on_the_ego_it_is_met_is_the_middle_of_what_both_share(ahead, left, yaw, turn):
    x = np.array([100.0, 100.0 + ahead * np.cos(yaw) - left * np.sin(yaw)])
    y = np.array([50.0, 50.0 + ahead * np.sin(yaw) + left * np.cos(yaw)])
    half_length, half_width = np.array([2.5, 2.2]), np.array([0.9, 1.0])
    other = shapely.affinity.translate(
        shapely.affinity.rotate(_rectangle(2.2, 1.0), turn, use_radians=True, origin=(0, 0)), ahead, left
    )
    shared = shapely.intersection(_rectangle(2.5, 0.9), other)
    assume(shared.area > 0.05)
    headings = yaw + np.array([0.0, turn])
    found = on_both(contact_share, x, y, np.cos(headings), np.sin(headings), half_length, half_width)
    assert found == pytest.approx(0.5 + 0.5 * (shared.bounds[0] + shared.bounds[2]) / 5.0, abs=1e-5)


def _rectangle(half_length, half_width):
    return shapely.box(-half_length, -half_width, half_length, half_width)


@pytest.mark.parametrize("dt", [0.04, 0.1, 0.12, 0.2])
def test_accelerations_are_means_over_steps_at_which_the_road_user_is_there(dt):
    """A single step of harder braking is less, by as many steps as a window of 0.3 s has."""
    speed, there = np.full((2, 30), 12.0), np.ones((2, 30), bool)
    speed[0, 15:] -= 1.0
    speed[1, 15:] -= 9.0
    there[1, 14:16] = False
    yaw = 0.25 * dt * np.arange(30.0) * [[0.0], [1.0]]  # in the second a turn of 3 m/s^2
    assert on_both(hardest, speed, yaw, there, dt=dt) == pytest.approx([1.0 / (dt * steps_of(np, 0.3, dt)), 3.0])
    assert on_both(hardest, speed[:, :1], yaw[:, :1], there[:, :1], dt=dt).max() < 0.0


def test_a_gap_closes_after_its_share_of_the_step():
    assert closes_at(np, 2.0, -2.0) == 0.5
    assert closes_at(np, 2.0, 3.0) == 1.0  # never within the step
    assert closes_at(np, -0.3, -1.0) == -0.3
