"""Weights of AIM-BEV that follow the route: a target beyond the stop line, and the lights of the own way in view."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from two_car_scenes import crossroads, moving

from regents_cosim.cli import run
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.observe import COLOURS, Surroundings
from regents_cosim.mirror.rollout import others
from regents_cosim.mirror.world import to_world
from regents_cosim.planners.aim_bev.controller import Controller
from regents_cosim.planners.aim_bev.lessons import Lesson, gather
from regents_cosim.planners.aim_bev.planner import AimBev, aim_bev, with_weights
from regents_cosim.planners.aim_bev.teacher import Teacher
from regents_cosim.planners.aim_bev.way import AHEAD_M, relit
from regents_cosim.planners.aim_bev.weights_file import FOLLOWS_ROUTE, SHIPPED, load_weights, save_weights
from regents_cosim.planners.jax_planner import LoopScene

LIGHT = {"r": COLOURS[4], "G": COLOURS[5], "y": COLOURS[6]}


def waiting(west="r", south="G"):
    """The ego's log stands before the line, which is 10 m before the middle of the crossroads, for the whole window."""
    made = moving(crossroads(west, south), 0, x=np.full(81, -18.0), speed=np.zeros(81))
    made = moving(made, 1, y=np.full(81, -60.0), speed=np.zeros(81))
    return replace(made, target=(-18.0, 0.0))


def at(made, x=-18.0, speed=0.0):
    """The ego at a place on its way, as a lesson at the first step."""
    state = Motion(*map(jnp.float32, (x, 0.0, 0.0, speed)))
    goal = jnp.asarray(made.target, jnp.float32)
    one = Lesson(jnp.int32(0), jnp.int32(0), jnp.int32(0), goal, state)
    return jax.tree.map(lambda value: value[None], one)


def seen(made, x=-18.0, follows_route=True):
    """The view and the target that the planner's network is given, the ego being at a place on its way."""
    planner, world = AimBev(aim_bev().network, Controller(), follows_route), to_world(made)
    scene = LoopScene(made, world)
    memory = planner.init(scene)
    ego = Motion(jnp.float32(x - scene.origin[0]), jnp.float32(-scene.origin[1]), jnp.float32(0.0), jnp.float32(0.0))
    now = jax.tree.map(lambda values: values[0], planner.look(memory, others(world, world.log, world.valid)))
    view = Surroundings(now.boxes, now.speed, now.valid, memory.lights[0])
    picture, target = planner.shown(memory, view, ego)
    return np.asarray(picture), np.asarray(target)


def shows(picture, letter):
    return bool((picture == LIGHT[letter]).all(axis=-1).any())


@cache
def room():
    return gather([waiting()], follow_routes=True)


@settings(max_examples=20)
@given(st.floats(-15.0, 60.0))
def test_the_target_is_as_far_ahead_wherever_the_ego_is(x):
    assert np.asarray(room().targets(at(waiting(), x)))[0] == pytest.approx([AHEAD_M, 0.0], abs=1e-3)


@pytest.mark.slow
def test_a_log_that_waits_has_a_target_beyond_the_line():
    made = waiting()
    _, end = seen(made, follows_route=False)
    _, ahead = seen(made)
    assert end[0] == pytest.approx(0.0, abs=1e-3)
    assert ahead == pytest.approx([AHEAD_M, 0.0], abs=1e-3)


@pytest.mark.parametrize("letter", LIGHT)
def test_the_light_of_the_own_way_is_in_view_and_no_other(letter):
    for south in LIGHT:
        picture, _ = seen(waiting(letter, south))
        assert [shows(picture, one) for one in LIGHT] == [one == letter for one in LIGHT]


@pytest.mark.slow
def test_training_shows_what_the_planner_sees():
    for made in (waiting(), *relit(waiting())):
        taught = gather([made], follow_routes=True)
        picture, target = seen(made, x=-16.4)
        np.testing.assert_array_equal(np.asarray(taught.views(at(made, -16.4)))[0], picture)
        assert np.asarray(taught.targets(at(made, -16.4)))[0] == pytest.approx(target, abs=1e-3)


def test_the_same_scene_is_taught_all_red_and_all_green():
    made = waiting("y", "y")
    twins = relit(made)
    assert [[light.letters(80) for light in twin.signals] for twin in twins] == [["rr"], ["GG"]]
    stops, goes = (
        np.asarray(Teacher.of([twin]).labels(gather([twin], follow_routes=True), at(twin, -30.0, 10.0)))[0]
        for twin in twins
    )
    assert goes[-1, 0] - stops[-1, 0] > 0.5, "it brakes for the red light 18 m ahead"
    unlit = replace(made, signals=())
    assert relit(unlit) == ()


def test_weights_carry_what_they_were_trained_with(tmp_path):
    assert not aim_bev().follows_route
    file = tmp_path / "route.safetensors"
    save_weights(load_weights(SHIPPED) | {FOLLOWS_ROUTE: np.ones(1, np.float32)}, file)
    assert with_weights(file).follows_route


@pytest.mark.slow
def test_the_log_is_no_teacher_of_lights(tmp_path, capsys):
    pytest.importorskip("torch", reason="torch is an extra")
    words = ["train", "aim-bev", "shipped:quickstart", "-o", str(tmp_path / "w.safetensors"), "--target", "route"]
    assert run([*words, "--quiet"]) == 2
    assert "expected the teacher idm" in capsys.readouterr().err
