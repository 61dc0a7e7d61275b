"""Weights of AIM-BEV that follow the route: a target beyond the stop line, and the lights of the own way in view."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from two_car_scenes import TIME, crossroads, moving

from regents_cosim.cli import run
from regents_cosim.errors import RegentsError
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.rollout import others
from regents_cosim.mirror.world import to_world
from regents_cosim.planners.aim_bev.camera import Camera
from regents_cosim.planners.aim_bev.network_inputs import AS_IN_THE_PAPERS, PIXEL_M, NetworkInputs
from regents_cosim.planners.aim_bev.observe import COLOURS, Surroundings
from regents_cosim.planners.aim_bev.planner import AimBev, aim_bev, with_weights
from regents_cosim.planners.aim_bev.route_ahead import AHEAD_M, all_red_and_all_green
from regents_cosim.planners.aim_bev.weights_file import SHIPPED, load_weights, save_weights
from regents_cosim.planners.jax_planner import CompiledScene
from regents_cosim.scenario.attack_record import AttackRecord
from regents_cosim.training.lessons.classroom import Lesson, gather
from regents_cosim.training.lessons.curriculum import plan
from regents_cosim.training.lessons.practice import ReachedStates
from regents_cosim.training.lessons.teacher import Teacher
from regents_cosim.training.lessons.train_config import TrainConfig

ROUTE, WIDE = NetworkInputs(follows_route=True), NetworkInputs(follows_route=True, camera=Camera.reaching(38.4))
LIGHT = {"r": COLOURS[4], "G": COLOURS[5], "y": COLOURS[6]}


def waiting(west="r", south="G"):
    """The ego's log stands before the line, which is 10 m before the middle of the crossroads, for the whole window."""
    made = moving(crossroads(west, south), 0, x=np.full(81, -18.0), speed=np.zeros(81))
    made = moving(made, 1, y=np.full(81, -60.0), speed=np.zeros(81))
    return replace(made, target=(-18.0, 0.0))


def marked(folder, marks):
    """The package's weights, marked as if they had been trained with other settings."""
    file = folder / "marked.safetensors"
    save_weights(load_weights(SHIPPED) | marks, file)
    return file


def at(made, x=-18.0, speed=0.0):
    """The ego at a place on its way, as a lesson at the first step."""
    state = Motion(*map(jnp.float32, (x, 0.0, 0.0, speed)))
    goal = jnp.asarray(made.target, jnp.float32)
    one = Lesson(jnp.int32(0), jnp.int32(0), jnp.int32(0), goal, state)
    return jax.tree.map(lambda value: value[None], one)


def seen(made, x=-18.0, given=ROUTE):
    """The view, target and closed light that the planner's network is given, the ego being at a place on its way."""
    planner, world = AimBev(aim_bev().network, given), to_world(made)
    scene = CompiledScene(made, world)
    memory = planner.init(scene)
    ego = Motion(jnp.float32(x - scene.origin[0]), jnp.float32(-scene.origin[1]), jnp.float32(0.0), jnp.float32(0.0))
    now = jax.tree.map(lambda values: values[0], planner.look(memory, others(world, world.log, world.valid)))
    view = Surroundings(now.boxes, now.speed, now.valid, memory.lights[0])
    return tuple(map(np.asarray, planner.shown(memory, view, ego)))


def shows(picture, letter):
    return bool((picture == LIGHT[letter]).all(axis=-1).any())


@cache
def room():
    return gather([waiting()], ROUTE)


@settings(max_examples=20)
@given(st.floats(-15.0, 60.0))
def test_the_target_is_as_far_ahead_wherever_the_ego_is(x):
    assert np.asarray(room().targets(at(waiting(), x)))[0] == pytest.approx([AHEAD_M, 0.0], abs=1e-3)


@pytest.mark.slow
def test_a_log_that_waits_has_a_target_beyond_the_line():
    made = waiting()
    _, end, _ = seen(made, given=AS_IN_THE_PAPERS)
    _, ahead, _ = seen(made)
    assert end[0] == pytest.approx(0.0, abs=1e-3)
    assert ahead == pytest.approx([AHEAD_M, 0.0], abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("letter", LIGHT)
def test_the_light_of_the_own_way_is_in_view_and_no_other(letter):
    for south in LIGHT:
        picture, _, _ = seen(waiting(letter, south))
        assert [shows(picture, one) for one in LIGHT] == [one == letter for one in LIGHT]


@pytest.mark.slow
@pytest.mark.parametrize("given", [ROUTE, WIDE, NetworkInputs(camera=WIDE.camera)])
def test_training_shows_what_the_planner_sees(given):
    for made in (waiting(), *all_red_and_all_green(waiting())):
        taught = gather([made], given)
        picture, target, light = seen(made, -16.4, given)
        same = np.asarray(taught.views(at(made, -16.4)))[0] == picture
        assert same.mean() > (0.99 if given.camera == WIDE.camera else 0.9999), "cells of another grid in a wider view"
        assert np.asarray(taught.targets(at(made, -16.4)))[0] == pytest.approx(target, abs=1e-3)
        assert np.asarray(taught.closed_lights(at(made, -16.4)))[0] == pytest.approx(light, abs=1e-4)


@settings(max_examples=20)
@given(st.floats(-5.0, 45.0))
def test_a_closed_light_is_told_of_the_nearer_the_more(gap_m):
    """The line is 10 m before the middle of the crossroads; from 1 m past it on the light is behind."""
    x = -10.0 - gap_m - 0.5 * waiting().agents[0].length
    told = float(room().closed_lights(at(waiting(), x))[0])
    if abs(gap_m + 1.0) > 0.01:
        assert told == pytest.approx(np.clip(1.0 - gap_m / 40.0, 0.0, 1.0) if gap_m > -1.0 else 0.0, abs=1e-3)


@pytest.mark.parametrize(("letter", "closed"), [("r", True), ("y", True), ("G", False)])
def test_a_light_that_is_not_closed_is_not_told_of(letter, closed):
    assert (float(gather([waiting(letter)], ROUTE).closed_lights(at(waiting()))[0]) > 0.0) == closed


def test_weights_from_before_lights_were_told_of_plan_as_they_did(tmp_path):
    before = {name: v[:, :-1] if name == "mlp.0.weight" else v for name, v in load_weights(SHIPPED).items()}
    save_weights(before, tmp_path / "before.safetensors")
    again = load_weights(tmp_path / "before.safetensors")
    assert {name: v.shape for name, v in again.items()} == {name: v.shape for name, v in load_weights(SHIPPED).items()}
    assert not again["mlp.0.weight"][:, -1].any()
    assert all(
        np.array_equal(v, again[name][:, : v.shape[1]] if v.ndim == 2 else again[name]) for name, v in before.items()
    )


@pytest.mark.slow
def test_the_same_scene_is_taught_all_red_and_all_green():
    made = waiting("y", "y")
    twins = all_red_and_all_green(made)
    assert [[light.letters(80) for light in twin.signals] for twin in twins] == [["rr"], ["GG"]]
    stops, goes = (
        np.asarray(Teacher.of([twin]).labels(gather([twin], ROUTE), at(twin, -30.0, 10.0)))[0] for twin in twins
    )
    assert goes[-1, 0] - stops[-1, 0] > 0.5, "it brakes for the red light 18 m ahead"
    unlit = replace(made, signals=())
    assert all_red_and_all_green(unlit) == ()


@pytest.mark.parametrize("nose_m", [-2.5, -0.5, 0.5])
def test_the_teacher_stands_with_room_before_a_closed_light(nose_m):
    """IDM alone stands half a metre before the line, and drives on once it has passed it."""
    made = waiting()
    x = -10.0 + nose_m - 0.5 * made.agents[0].length
    red, green = (
        np.asarray(Teacher.of([twin]).labels(gather([twin], ROUTE), at(twin, x, 1.0)))[0]
        for twin in all_red_and_all_green(made)
    )
    assert red[-1, 0] < 0.3
    assert green[-1, 0] > 0.8


def test_weights_carry_what_they_were_trained_with(tmp_path):
    assert aim_bev().given == AS_IN_THE_PAPERS
    for one in (ROUTE, WIDE, NetworkInputs(camera=Camera.reaching(25.0))):
        assert with_weights(marked(tmp_path, one.marks())).given == one


@pytest.mark.parametrize("pixel_m", [0.01, 3.0, np.nan, [0.2, 0.2]])
def test_weights_with_an_impossible_view_are_refused(tmp_path, capsys, pixel_m):
    file = marked(tmp_path, {PIXEL_M: np.array(pixel_m, np.float32).reshape(-1)})
    assert run(["evaluate", "shipped:quickstart", "--planner", f"aim-bev:{file}", "--quiet"]) == 2
    assert "expected one number for a view of 10 to 100 m to each side" in capsys.readouterr().err


@pytest.mark.slow
def test_who_is_further_away_is_in_a_wider_view():
    made = moving(crossroads("r", "G"), 1, x=np.full(81, -18.0), y=np.full(81, 30.0), speed=np.zeros(81))
    shown = [bool((seen(made, given=given)[0] == COLOURS[7]).all(axis=-1).any()) for given in (ROUTE, WIDE)]
    assert shown == [False, True]


@pytest.mark.parametrize(("option", "says"), [("--view=5", "view is 5.0, expected 10 to 100")])
def test_a_view_that_is_none_is_refused(tmp_path, capsys, option, says):
    pytest.importorskip("torch", reason="torch is an extra")
    words = ["train", "aim-bev", "shipped:quickstart", "-o", str(tmp_path / "w.safetensors"), option, "--quiet"]
    assert run(words) == 2
    assert says in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_who_learns_from_crashes_keeps_the_view(tmp_path, capsys):
    pytest.importorskip("torch", reason="torch is an extra")
    words = ["train", "aim-bev", "shipped:quickstart", "--finetune", "shipped:quickstart", "--view", "30"]
    assert run([*words, "-o", str(tmp_path / "w.safetensors"), "--quiet"]) == 2
    assert "expected the view of the weights" in capsys.readouterr().err


def test_lessons_with_a_light_in_view_are_kinds_of_their_own():
    made = moving(waiting("r"), 0, x=-60.0 + np.arange(81.0), speed=np.full(81, 10.0))
    for twin, kind in zip(all_red_and_all_green(made), ("held", "free"), strict=True):
        steps = plan(gather([twin], WIDE), egos=True).rows[kind][:, 2]
        nose = -60.0 + steps + 0.5 * made.agents[0].length
        assert nose.min() > -10.0 - 38.4 - 1.0
        assert nose.max() <= -10.0
        assert len(steps) > 20


@pytest.mark.slow
def test_a_window_that_is_held_back_is_so_with_all_its_lights():
    made = [moving(waiting("r"), 0, x=-60.0 - i + np.arange(81.0), speed=np.full(81, 10.0)) for i in range(10)]
    twins = [(index, twin) for index, one in enumerate(made) for twin in all_red_and_all_green(one)]
    window = np.array([*range(10), *(index for index, _ in twins)])
    curriculum = plan(gather([*made, *(twin for _, twin in twins)], WIDE), egos=True)
    taught, held_back = curriculum.split(window)
    for kind in ("held", "free"):
        assert set(window[held_back.rows[kind][:, 0]]) == {9}
        assert set(window[taught.rows[kind][:, 0]]) == set(range(9))
        assert len(taught.rows[kind]) + len(held_back.rows[kind]) == len(curriculum.rows[kind])


@pytest.mark.parametrize("share", ["evading", "urgent"])
def test_a_share_of_all_or_none_of_the_lessons_is_refused(share):
    for value in (0.0, 1.0, np.nan):
        with pytest.raises(RegentsError, match="expected one between 0 and 1"):
            TrainConfig(**{share: value})


@pytest.mark.slow
def test_a_teacher_is_as_fast_as_traffic_that_keeps_to_the_limit():
    """The planner `idm` accelerates less near the limit, and is slower."""
    made = moving(crossroads("G", "G"), 0, x=-60.0 + np.arange(81.0), speed=np.full(81, 10.0))
    speed = 0.9 * made.road.lanes[0].speed_limit
    way = np.asarray(Teacher.of([made]).labels(gather([made], WIDE), at(made, -60.0, speed)))[0, :, 0]
    assert (way[-1] - way[-2]) / 0.1 > speed + 0.9


@pytest.mark.slow
def test_a_careful_teacher_brakes_for_who_will_be_in_its_way():
    """IDM sees nothing in its way; the other comes from the side, with a time to collision of 1.4 s."""
    crosses = moving(crossroads("G", "G"), 1, y=-14.0 + TIME * 10.0, speed=np.full(81, 10.0))
    waits = moving(crosses, 1, y=np.full(81, -14.0), speed=np.zeros(81))
    labels, brakes = {}, {}
    for name, made in {"crosses": crosses, "waits": waits}.items():
        for careful in (False, True):
            asked = gather([made], WIDE), at(made, -14.0, 10.0)
            teacher = Teacher.of([made], careful, WIDE.camera)
            (labels[name, careful],) = np.asarray(teacher.labels(*asked))
            brakes[name, careful] = bool(teacher.brakes(*asked)[0])
    assert [asked for asked, braking in brakes.items() if braking] == [("crosses", True)]
    assert labels["crosses", False] == pytest.approx(labels["waits", False], abs=1e-3)
    assert labels["waits", True] == pytest.approx(labels["waits", False], abs=1e-3)
    assert labels["crosses", True][-1, 0] < labels["crosses", False][-1, 0] - 1.0


@pytest.mark.slow
def test_a_careful_teacher_does_not_brake_for_one_that_stops_in_time():
    """At first both look the same: at 10 m/s the other would meet the ego. In the recording one of them gives way."""
    crosses = moving(crossroads("G", "G"), 1, y=-19.0 + TIME * 10.0, speed=np.full(81, 10.0))
    speed = np.maximum(10.0 - 5.0 * TIME, 0.0)
    stops = moving(crosses, 1, y=-19.0 + np.cumsum(np.append(0.0, speed[:-1])) * 0.1, speed=speed)
    assert stops.tracks.y[1].max() < -5.0, "it stands before the ego's way"
    brakes = [
        bool(Teacher.of([made], True, WIDE.camera).brakes(gather([made], WIDE), at(made, -17.0, 10.0))[0])
        for made in (crosses, stops)
    ]
    assert brakes == [True, False]


@pytest.mark.slow
def test_near_its_log_an_ego_is_taught_what_the_log_did_and_far_from_it_what_the_teacher_does():
    """The log waits before the crossroads though the light is green: IDM sees nothing to wait for."""
    made = waiting("G", "G")
    room, near, far = gather([made], WIDE), at(made, -18.5, 0.0), at(made, -24.0, 0.0)
    ahead = {
        (by_log, name): float(Teacher.of([made], True, WIDE.camera, [by_log]).labels(room, one)[0, -1, 0])
        for by_log in (False, True)
        for name, one in {"near": near, "far": far}.items()
    }
    assert ahead[True, "near"] < 0.1
    assert ahead[False, "near"] > 0.5
    assert ahead[True, "far"] == ahead[False, "far"] > 0.5


@pytest.mark.slow
def test_where_the_log_shows_what_to_do_no_danger_is_braked_for():
    """In the recording the two just miss each other: were the ego half a second later they would meet."""
    crosses = moving(crossroads("G", "G"), 1, y=-19.0 + TIME * 10.0, speed=np.full(81, 10.0))
    made = moving(crosses, 0, x=-17.0 + TIME * 10.0, speed=np.full(81, 10.0))
    brakes = [
        bool(Teacher.of([made], True, WIDE.camera, [by_log]).brakes(gather([made], WIDE), at(made, -17.0, 10.0))[0])
        for by_log in (False, True)
    ]
    assert brakes == [True, False]


@pytest.mark.slow
@pytest.mark.parametrize(("teacher", "taught_by_log"), [("careful", [True, False, False, False]), ("idm", [False] * 4)])
def test_logs_teach_where_neither_an_attack_nor_other_lights_changed_a_window(
    monkeypatch, tmp_path, teacher, taught_by_log
):
    """A window and its twins with all lights red and green, and a window with an attack that has no lights."""
    pytest.importorskip("torch", reason="torch is an extra")
    from regents_cosim.training.lessons import train as training

    asked = []

    def of(windows, careful, camera, by_log):
        asked.append((len(windows), careful, by_log))
        raise InterruptedError

    monkeypatch.setattr(training.Teacher, "of", of)
    attack = AttackRecord("case", "king", "idm", "no_collision", 3, None)
    made = crossroads()
    dark = replace(made, signals=(), road=replace(made.road, connections=()))
    attacked = replace(dark, attack=attack, log=dark.tracks)
    with pytest.raises(InterruptedError):
        next(
            training.train(
                [crossroads(), attacked], tmp_path / "w.safetensors", TrainConfig(teacher=teacher, target="route")
            )
        )
    assert asked == [(4, teacher == "careful", taught_by_log)]


@pytest.mark.slow
def test_before_a_closed_light_the_teacher_shows_where_to_stand_though_the_log_is_near():
    """Logs of SUMO stand a metre before the line; the teacher three."""
    made = moving(waiting("r", "G"), 0, x=np.full(81, -13.5))
    near = moving(waiting("G", "G"), 0, x=np.full(81, -13.5))
    teacher = [Teacher.of([made], True, WIDE.camera, [by_log]) for by_log in (False, True)]
    room, one = gather([made], WIDE), at(made, -14.9, 1.5)
    without, beside = (np.asarray(of.labels(room, one)) for of in teacher)
    assert np.array_equal(without, beside)
    open_light = Teacher.of([near], True, WIDE.camera, [True]).labels(gather([near], WIDE), one)
    assert not np.allclose(open_light, without), "near enough for the log, which goes on to where it stands"


def test_egos_are_looked_for_anywhere_along_their_logs():
    made = moving(crossroads("G", "G"), 0, x=-60.0 + np.arange(81.0), speed=np.full(81, 10.0))
    rows, states = plan(gather([made], WIDE), egos=True).anywhere(300, np.random.default_rng(0))
    assert (rows[:, 1] == 0).all(), "none but the ego"
    off = states[:, 0] - made.tracks.x[0, rows[:, 2]]
    assert 8.0 < np.abs(off).max() < 15.0
    assert (off > 5.0).any()
    assert (off < -5.0).any()
    assert np.abs(states[:, 1]).max() < 2.0, "on its way"
    assert states[:, 3].min() < 7.0 < 13.0 < states[:, 3].max()


def test_states_in_danger_are_kept_with_as_many_others_and_have_a_share_of_the_lessons():
    rng = np.random.default_rng(0)
    rows = np.stack([np.arange(10), np.zeros(10, int), np.zeros(10, int)], axis=-1)
    kept = ReachedStates(rows, np.zeros((10, 4))).balanced(np.arange(10) < 3, rng)
    assert (kept.rows[:, 0] < 3).tolist() == [True] * 3 + [False] * 3
    own = ReachedStates(np.full((400, 3), 99), np.ones((400, 4)))
    drawn = kept.drawn_into(own, 0.3, rng)
    replaced = drawn.rows[:, 0] < 99
    assert 0.2 < replaced.mean() < 0.4
    assert ((drawn.states == 0.0).all(axis=1) == replaced).all()
    assert ReachedStates.nothing().drawn_into(own, 0.3, rng) is own


@pytest.mark.slow
def test_the_log_is_no_teacher_of_lights(tmp_path, capsys):
    pytest.importorskip("torch", reason="torch is an extra")
    words = ["train", "aim-bev", "shipped:quickstart", "-o", str(tmp_path / "w.safetensors"), "--target", "route"]
    assert run([*words, "--quiet"]) == 2
    assert "expected the teacher idm" in capsys.readouterr().err
