"""How unlikely a motion is in ordinary traffic, as the cost knows it: the rule of the host, on the device."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.test_util import check_grads
from scenes import moving, scene
from shipped_cases import shipped_windows

from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.descent import costs
from regents_cosim.attacks.descent.searched_agents import SearchedAgents
from regents_cosim.attacks.methods.presets import REGENTS_FOCUSED as FOCUSED
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.world import to_world
from regents_cosim.verdicts.usualness import VEHICLES, peak_effort, usualness

unlikeliness = eqx.filter_jit(costs.unlikeliness)
SCENE = scene((0, 0, 10), (20, 0, 10))
WORLD = to_world(SCENE)
STEPS = WORLD.valid.shape[1]


def moved(speed, yaw):
    """The motion of the scene, with other speeds and headings of agent 1."""
    of = {"speed": speed, "yaw": yaw}
    return Motion(
        WORLD.log.x, WORLD.log.y, *(getattr(WORLD.log, one).at[1].set(jnp.asarray(of[one])) for one in ("yaw", "speed"))
    )


def of_one(motion, world=WORLD, candidate=1):
    return unlikeliness(world, motion, SearchedAgents.only(candidate, world.valid.shape[0]))


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(-6.0, 6.0), min_size=4, max_size=4), st.floats(-0.5, 0.5))
def test_it_is_the_density_of_the_peak_effort_that_the_host_ranks(accelerations, turning):
    speed = np.maximum(12.0 + np.cumsum(np.repeat(accelerations, 21)[:STEPS]) * 0.1, 0.0)
    yaw = turning * np.sin(np.arange(STEPS) * 0.1)
    peak = peak_effort(speed, yaw, 0.1)
    expected = 0.5 * (max(np.log(peak / VEHICLES.median), 0.0) / VEHICLES.spread) ** 2 if peak else 0.0
    assert of_one(moved(speed, yaw)) == pytest.approx(expected, rel=1e-2, abs=1e-3)


def test_an_even_drive_costs_nothing_and_a_hard_one_more():
    assert of_one(WORLD.log) == 0.0
    braking = [moved(np.maximum(12.0 - b * np.arange(STEPS) * 0.1, 0.0), np.zeros(STEPS)) for b in (3.0, 6.0)]
    assert 0.0 < of_one(braking[0]) < of_one(braking[1])


def test_it_counts_candidates_alone_and_all_of_them():
    hard = moved(np.maximum(12.0 - 6.0 * np.arange(STEPS) * 0.1, 0.0), np.zeros(STEPS))
    assert of_one(hard, candidate=0) == 0.0
    among_all = SearchedAgents.among(jnp.arange(WORLD.valid.shape[0]) == 1)
    assert unlikeliness(WORLD, hard, among_all) == pytest.approx(float(of_one(hard)))


def test_what_happens_in_a_gap_of_the_log_counts_nothing():
    world = to_world(moving(SCENE, 1, valid=np.arange(STEPS) < 30))
    late = np.where(np.arange(STEPS) < 40, 12.0, 2.0)
    assert of_one(moved(late, np.zeros(STEPS)), world) == 0.0


def test_the_gradient_is_that_of_finite_differences(x64):
    at = np.arange(STEPS) * 0.1
    world = jax.tree.map(lambda v: v.astype(jnp.float64) if v.dtype == jnp.float32 else v, WORLD)
    speed, yaw = jnp.asarray(12.0 - 4.0 * np.sin(1.3 * at)), jnp.asarray(0.2 * np.sin(1.1 * at))
    rows = [row.astype(jnp.float64) for row in (WORLD.log.x, WORLD.log.y, WORLD.log.yaw, WORLD.log.speed)]

    def cost(own_speed, own_yaw):
        motion = Motion(rows[0], rows[1], rows[2].at[1].set(own_yaw), rows[3].at[1].set(own_speed))
        return costs.unlikeliness(world, motion, SearchedAgents.only(1, world.valid.shape[0]))

    check_grads(jax.jit(cost), (speed, yaw), order=1, modes=["rev"], eps=1e-6, rtol=1e-4)


@pytest.mark.slow
def test_a_search_accepts_no_adversary_less_usual_than_asked_for_and_one_is_one():
    windows = shipped_windows("crossing")[:3]
    short = FOCUSED.but(adversaries="one", nearest=3, attempts=1, iterations=20)
    free = list(attack(windows, short, "idm"))
    assert all(case.id.startswith(window.id) for case, window in zip(free, windows, strict=True))
    least = max(usual for case in free if (usual := usualness(case)) is not None)
    asked = list(attack(windows, short.but(at_least_usual=least), "idm"))
    assert len(asked) == len(windows)
    found = [usualness(case) for case in asked if case.attack.outcome == "collision"]
    assert found
    assert all(usual is None or usual >= least for usual in found)
