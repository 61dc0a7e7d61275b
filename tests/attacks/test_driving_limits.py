"""How hard an adversary may drive: what is ordinary in a scene, and the controls that keep to it."""

import functools
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jax.test_util import check_grads
from scenes import platoon, scene
from shipped_cases import shipped_window
from usual_scenes import driven, traffic

from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.descent.driving_limits import limits_by_kind, with_bounds, within_bounds
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.methods.presets import KING, METHODS, REGENTS, REGENTS_FOCUSED
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.rollout import roll_out_background
from regents_cosim.mirror.world import to_world
from regents_cosim.norms.limits import ACCEL_LIMIT, CURVATURE_LIMIT
from regents_cosim.scenario.scenario import Overlap
from regents_cosim.verdicts.handling import handling
from regents_cosim.verdicts.ordinary import CAR, HEAVY, ordinary

NAMES = ("accel", "braking", "lateral_accel", "jerk")


def bounded(made, config=REGENTS_FOCUSED):
    return with_bounds(to_world(made), made, config, limits_by_kind(made, config))


# --- what is ordinary ----------------------------------------------------------------------------


def test_little_traffic_says_nothing_and_the_kind_is_asked():
    made = scene((0, 0, 10), (30, 0, 10))
    assert ordinary(made, "car") == CAR
    assert ordinary(made, "bus") == HEAVY


def test_gentle_traffic_does_not_forbid_what_is_ordinary_elsewhere():
    found = ordinary(traffic(cars=20), "car")
    assert all(getattr(found, name) >= getattr(CAR, name) for name in NAMES)


def test_hard_traffic_allows_more_but_no_emergency():
    made = traffic(cars=20)
    for car in range(20):
        made = driven(made, car, np.where(np.arange(80) % 40 < 20, 5.0, -5.0))
    found = ordinary(made, "car")
    assert found.accel == pytest.approx(5.0, rel=0.02)
    assert found.braking == pytest.approx(5.0, rel=0.02)
    assert 8.0 < found.jerk <= 12.65
    assert found.lateral_accel == CAR.lateral_accel


def test_what_is_driven_after_a_collision_is_not_ordinary():
    made = traffic(cars=20)
    for car in range(20):
        made = driven(made, car, np.where(np.arange(80) < 40, 0.0, -5.0))
    hit = tuple(Overlap((made.agents[i].id, made.agents[i + 1].id), 38, 80) for i in range(0, 20, 2))
    assert ordinary(made, "car").braking == pytest.approx(5.0, rel=0.02)
    assert ordinary(replace(made, overlaps=hit), "car") == CAR


def test_no_traffic_allows_more_than_vehicles_can_do():
    made = traffic(cars=20)
    for car in range(20):
        made = driven(made, car, np.where(np.arange(80) % 40 < 20, 9.0, -9.0))
    found = ordinary(made, "car")
    assert (found.accel, found.braking) == (ACCEL_LIMIT, ACCEL_LIMIT)


def test_numbers_go_before_the_traffic_and_without_either_there_is_no_bound():
    made = platoon()
    asked = bounded(made, REGENTS_FOCUSED.but(max_jerk=1.5)).bounds
    assert float(asked.jerk[1]) == 1.5
    assert float(asked.braking[1]) == CAR.braking
    for published in (KING, REGENTS):
        assert bounded(made, published).bounds is None
    alone = bounded(made, REGENTS.but(max_jerk=1.5)).bounds
    assert float(alone.jerk[1]) == 1.5
    assert float(alone.braking[1]) > 100.0


def test_the_bounds_need_no_other_program():
    assert REGENTS_FOCUSED.but(max_jerk=1.0, driving="any").compiled() == REGENTS_FOCUSED.compiled()


# --- controls that keep to it --------------------------------------------------------------------

_within = compiled(within_bounds)


def wild_controls(world, seed, scale=1.0):
    rng, shape = np.random.default_rng(seed), world.controls.accel.shape
    limits = (ACCEL_LIMIT, CURVATURE_LIMIT)
    return ControlArrays(*(jnp.asarray(rng.uniform(-limit, limit, shape) * scale, jnp.float32) for limit in limits))


BRAKES = np.where(np.arange(80) < 20, -5.5, 1.0)


@functools.cache
def braking():
    """A platoon in which one car brakes harder than usual, and its world."""
    made = driven(platoon(), 2, BRAKES)
    return made, bounded(made)


@pytest.mark.slow
@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(0.05, 1.0))
def test_controls_keep_to_the_bounds_unless_the_log_does_more(seed, scale):
    made, world = braking()
    searched = SearchedAgents.among(world.vehicle)
    kept = _within(world, searched, wild_controls(world, seed, scale))
    logged, bounds, rows = world.controls, world.bounds, slice(0, len(made.agents))
    accel, curvature = (np.asarray(values)[rows] for values in (kept.accel, kept.curvature))
    log_accel = np.asarray(logged.accel)[rows]
    assert (accel <= np.maximum(np.asarray(bounds.accel)[rows, None], log_accel) + 1e-4).all()
    assert (accel >= np.minimum(-np.asarray(bounds.braking)[rows, None], log_accel) - 1e-4).all()
    jerk = np.asarray(bounds.jerk)[rows, None]
    for steps in range(1, 11):
        change, of_log = (np.abs(values[:, steps:] - values[:, :-steps]) for values in (accel, log_accel))
        assert (change <= np.maximum(np.minimum(12.65 * steps * made.dt, jerk), of_log) + 1e-4).all()
    speed = np.asarray(_driven(world, kept).speed)[rows]
    aside = np.abs(curvature) * (0.5 * (speed[:, 1:] + speed[:, :-1])) ** 2
    own = np.abs(np.asarray(logged.curvature)[rows]) * made.tracks.speed.max(axis=1, keepdims=True) ** 2
    assert (aside <= np.maximum(CAR.lateral_accel, own) + 1e-2).all()


@compiled
def _driven(world, controls):
    return roll_out_background(world, controls)


@pytest.mark.slow
@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(0.05, 1.0))
def test_what_is_allowed_is_left_as_it_is(seed, scale):
    _, world = braking()
    searched = SearchedAgents.among(world.vehicle)
    once = _within(world, searched, wild_controls(world, seed, scale))
    twice = _within(world, searched, once)
    np.testing.assert_allclose(twice.accel, once.accel, atol=1e-4)
    log = _within(world, searched, world.controls)
    np.testing.assert_allclose(log.accel, world.controls.accel, atol=1e-5)
    np.testing.assert_allclose(log.curvature, world.controls.curvature, atol=1e-6)


def test_of_one_mover_they_are_those_of_all():
    world = bounded(platoon())
    wild = wild_controls(world, 3)
    everyone = _within(world, SearchedAgents.among(world.vehicle), wild)
    one = SearchedAgents.only(4, len(world.valid))
    alone = _within(world, one, one.rows(wild))
    np.testing.assert_allclose(alone.accel[0], everyone.accel[4], atol=1e-5)
    np.testing.assert_allclose(alone.curvature[0], everyone.curvature[4], atol=1e-6)


def test_they_have_the_gradient_of_finite_differences(x64):
    world = jax.tree.map(lambda v: v.astype(jnp.float64) if v.dtype == jnp.float32 else v, bounded(platoon()))
    one = SearchedAgents.only(4, len(world.valid))
    rng = np.random.default_rng(0)
    wild = ControlArrays(*(jnp.asarray(rng.uniform(-s, s, (1, 80))) for s in (ACCEL_LIMIT, 0.03)))
    weight = jnp.asarray(rng.normal(size=(1, 80)))

    @jax.jit
    def pulled(accel, curvature):
        kept = within_bounds(world, one, ControlArrays(accel, curvature))
        return (weight * kept.accel).sum() + (weight * kept.curvature).sum()

    check_grads(pulled, (wild.accel, wild.curvature), order=1, modes=["rev"], eps=1e-6, rtol=1e-4)


# --- crashes -------------------------------------------------------------------------------------


def felt(tracks, agent, dt, end):
    """The greatest acceleration, braking, lateral acceleration and jerk of an agent while it moves."""
    drives = [one for one in handling(tracks, agent, dt, end) if len(one.speed)]
    accel, aside, jerk, speed = (np.concatenate([getattr(d, name) for d in drives])
                                 for name in ("accel", "aside", "jerk", "speed"))  # fmt: skip
    on = speed + 2.0 * np.minimum(accel, 0.0) > 0.5  # it does not come to a stop, which is one of a moment
    return [accel.max(), -accel.min(), aside.max(), np.abs(jerk[on]).max(initial=0.0)]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["crossing-1"])
def test_the_adversary_of_a_crash_drives_as_hard_as_the_traffic(name):
    made = shipped_window(name)
    few = REGENTS_FOCUSED.but(iterations=40, nearest=3)
    crashes = [case for case in attack([made], few, "idm") if case.attack.outcome == "collision"]
    for case in crashes:
        hit = case.collision
        agent = case.index(hit.agent)
        limits = ordinary(made, case.agents[agent].kind)
        now, log = (felt(tracks, agent, made.dt, hit.step + 1) for tracks in (case.tracks, case.log))
        for name, value, before in zip(NAMES, now, log, strict=True):
            assert value <= 1.02 * max(getattr(limits, name), before) + 0.02, (case.id, name)
    assert crashes


def test_every_method_of_ours_drives_as_people_do():
    assert {name for name, preset in METHODS.items() if preset.limits.driving == "any"} == {"king", "regents"}
