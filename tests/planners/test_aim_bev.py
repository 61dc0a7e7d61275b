"""The neural ego: what it is made of, that both its forms agree, and that it drives."""

import os
import subprocess
import sys
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import SUPPORT
from scenes import TIME, moving, platoon, scene
from two_car_scenes import crossroads

from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import KING
from regents_cosim.cases.suite import load_suite
from regents_cosim.cli import run
from regents_cosim.errors import RegentsError
from regents_cosim.mirror.bicycle import ControlArrays, Motion, step
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.rollout import drive
from regents_cosim.mirror.world import to_world
from regents_cosim.norms.limits import ACCEL_LIMIT
from regents_cosim.planners.aim_bev.controller import steer
from regents_cosim.planners.aim_bev.network import to_network
from regents_cosim.planners.aim_bev.planner import AimBev, aim_bev, with_weights
from regents_cosim.planners.aim_bev.weights_file import SHIPPED, load_weights
from regents_cosim.planners.jax_planner import CompiledScene
from regents_cosim.replays.mirror import MirrorController
from regents_cosim.saving import SuiteWriter
from regents_cosim.training.lessons.classroom import Lesson, expert_waypoints, gather
from regents_cosim.training.lessons.curriculum import KINDS, plan
from regents_cosim.training.lessons.practice import practise
from regents_cosim.training.lessons.teacher import Teacher

DRIVE = compiled(drive)
NAME = "regents_cosim.planners.aim_bev.planner:aim_bev"


def waypoints_of(accel, curvature, speed):
    """The waypoints that constant controls reach in 0.8 s."""
    state, found = Motion(*map(jnp.float32, (0.0, 0.0, 0.0, speed))), []
    for _ in range(8):
        state = step(state, ControlArrays(jnp.float32(accel), jnp.float32(curvature)), 0.1)
        found.append([state.x, state.y])
    return jnp.array(found, jnp.float32)


@pytest.mark.parametrize(("accel", "curvature", "speed"), [(1.0, 0.02, 8.0), (-0.8, 0.0, 15.0), (0.5, -0.1, 4.0)])
def test_the_controller_finds_the_controls_behind_waypoints(accel, curvature, speed):
    found = steer(waypoints_of(accel, curvature, speed), jnp.float32(speed))
    assert float(found.accel) == pytest.approx(accel, abs=0.15)
    assert float(found.curvature) == pytest.approx(curvature, rel=0.05, abs=1e-4)


def test_the_controller_brakes_fully_where_the_plan_brakes_at_all_firmly():
    found = steer(waypoints_of(-3.0, 0.0, 15.0), jnp.float32(15.0))
    assert float(found.accel) == pytest.approx(-ACCEL_LIMIT)


def test_waypoints_that_stand_still_mean_stop():
    found = steer(jnp.zeros((8, 2)), jnp.float32(0.3))
    assert float(found.accel) == pytest.approx(-3.0), "to a stand within a step"


def expert(made, now, **changed):
    """Waypoints of the expert at a step of the ego's log, its state changed."""
    log = Motion(
        *(jnp.asarray(v[0], jnp.float32) for v in (made.tracks.x, made.tracks.y, made.tracks.yaw, made.tracks.speed))
    )
    state = {name: getattr(log, name)[now] for name in ("x", "y", "yaw", "speed")}
    for name, change in changed.items():
        state[name] = state[name] + change
    return np.asarray(expert_waypoints(log, jnp.int32(made.tracks.steps - 1), jnp.int32(now), Motion(**state), 0.1))


def test_on_its_log_the_expert_follows_it():
    found = expert(scene((0, 0, 10.0)), 20)
    assert found[:, 0] == pytest.approx(np.arange(1, 9) * 1.0, abs=1e-3)
    assert np.abs(found[:, 1]).max() < 1e-3


def test_beside_its_log_it_comes_back():
    left = expert(scene((0, 0, 10.0)), 20, y=0.5)
    assert (np.diff(left[:, 1]) < 0).all(), "to the right"
    assert expert(scene((0, 0, 10.0)), 20, x=-2.0)[-1, 0] > 8.1, "faster when it is late"
    assert expert(scene((0, 0, 10.0)), 20, speed=3.0)[-1, 0] < 10.3, "slower when it is too fast"


def test_lessons_cover_what_vehicles_do():
    merging = scene((0, 0, 10.0), (30, 0, 9.0))
    made = moving(merging, 0, y=np.clip(TIME - 3.0, 0.0, 3.2))
    curriculum = plan(gather([made, platoon()]))
    assert len(curriculum.rows["merging"]) > 10
    assert len(curriculum.rows["following"]) > 100
    lesson = curriculum.draw(200, np.random.default_rng(0))
    away = np.hypot(
        *(
            np.asarray(v) - log[lesson.scene, lesson.agent, lesson.step]
            for v, log in zip((lesson.state.x, lesson.state.y), curriculum.log, strict=False)
        )
    )
    assert 0.1 < (away < 1e-6).mean() < 0.5, "most start beside their log"
    assert away.max() < 3.0
    assert set(curriculum.rows) == set(KINDS)


@pytest.mark.slow
def test_practice_of_an_expert_stays_on_the_log():
    room = gather([platoon(cars=6)])

    def straight(views, speed, target, _):
        assert views.shape == (2, 192, 192, 3)
        assert (target[:, 0] > 0).all()
        ahead = speed[:, None] * 0.1 * np.arange(1, 9)
        return np.stack([ahead, 0 * ahead], axis=-1).astype(np.float32)

    went = practise(room, straight, np.array([0, 0]))
    assert went.collision_rate == 0.0
    assert went.mean_away_m < 0.05
    assert went.met.rows[:, 2].max() >= 70


def taught(made, step=20, **off):
    """The label by IDM in the ego's place, limited to what the view shows, from the log's state or `off` it."""
    room = gather([made])
    state = Motion(
        *(jnp.float32(getattr(made.tracks, k)[0, step] + off.get(k, 0.0)) for k in ("x", "y", "yaw", "speed"))
    )
    one = Lesson(jnp.int32(0), jnp.int32(0), jnp.int32(step), jnp.zeros(2), state)
    (found,) = Teacher.of([made]).labels(room, jax.tree.map(lambda value: value[None], one))
    return np.asarray(found)


@pytest.mark.slow
def test_the_teacher_is_idm_at_the_pace_of_sumo_in_the_place_of_the_ego():
    made = scene((0, 0, 10.0), (14, 0, 7.0))
    with MirrorController("idm:max_accel=3,exponent=12,lateral_accel=5") as driver:
        drive = driver.drive(replace(made, tracks=made.tracks))
    found = taught(made, step=0)
    assert found[:, 0] == pytest.approx(drive.tracks.x[0, 1:9] - made.tracks.x[0, 0], abs=1e-3)
    assert np.abs(found[:, 1]).max() < 1e-3


@pytest.mark.slow
def test_the_teacher_brakes_for_what_is_in_view_only():
    alone, near, far = (taught(scene((0, 0, 10.0), *others)) for others in ([], [(31, 0, 2.0)], [(44, 0, 2.0)]))
    assert near[-1, 0] < alone[-1, 0] - 0.5, "15 m ahead at that step"
    assert far == pytest.approx(alone, abs=1e-5), "28 m ahead: beyond the view"


@pytest.mark.slow
def test_the_teacher_leads_back_to_the_route():
    assert taught(scene((0, 0, 10.0)), y=0.5)[-1, 1] < -0.05, "to the right"


def test_where_idm_teaches_only_egos_learn_and_know_where_they_go():
    made = platoon(cars=6)
    curriculum = plan(gather([made]), egos=True)
    assert all((rows[:, 1] == 0).all() for rows in curriculum.rows.values())
    lesson = curriculum.draw(20, np.random.default_rng(0))
    assert np.asarray(lesson.goal) == pytest.approx(np.tile(made.target, (20, 1)), abs=1e-3)


def test_weights_of_something_else_are_refused(tmp_path):
    with pytest.raises(RegentsError, match="no weights of AIM-BEV"):
        to_network({"conv.weight": np.zeros(3, np.float32)})
    (tmp_path / "broken.safetensors").write_bytes(b"nothing")
    with pytest.raises(RegentsError, match="cannot be read as safetensors"):
        with_weights(tmp_path / "broken.safetensors")


WITHOUT_TORCH = """
import sys
sys.modules["torch"] = None  # importing it raises
from scenes import scene
from regents_cosim.evaluation.drives.driving import drive_each
(drive,) = drive_each([scene((0, 3.2, 10.0), (40, 3.2, 10.0), (-20, 0.0, 10.0))], "aim-bev")
assert drive.hits is None, drive
assert drive.completion > 0.8, drive
"""


@pytest.mark.slow
def test_it_drives_without_torch():
    assert SHIPPED.stat().st_size < 12e6
    path = os.pathsep.join([str(SUPPORT), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"PYTHONPATH": path}
    done = subprocess.run([sys.executable, "-c", WITHOUT_TORCH], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr


class Forgetful(AimBev):
    """A planner that makes every plan anew."""

    def keep(self, last):
        return jax.tree.map(lambda values: jnp.full_like(values, jnp.nan), last.last_drive)


def forgetful():
    return Forgetful(aim_bev().network)


def drives(planner, memory, world, background):
    """The ego's x, y, yaw and speed, and the memory at the end."""
    motion, _, last = DRIVE(planner, memory, world, background)
    return np.stack([motion.x, motion.y, motion.yaw, motion.speed]), last


@pytest.mark.slow
def test_what_it_remembers_changes_nothing():
    made, planner = platoon(), aim_bev()
    world = to_world(made)
    memory = planner.init(CompiledScene(made, world))
    log, last = drives(planner, memory, world, world.log)
    known = planner.recall(memory, planner.keep(last))
    np.testing.assert_array_equal(drives(planner, known, world, world.log)[0], log)
    nearest = int(np.argmin(np.hypot(made.tracks.x[1:, 40] - log[0, 40], made.tracks.y[1:, 40] - log[1, 40]))) + 1
    other = replace(world.log, x=world.log.x.at[nearest, 40:].add(3.0))
    fresh, _ = drives(planner, memory, world, other)
    np.testing.assert_array_equal(drives(planner, known, world, other)[0], fresh)
    np.testing.assert_array_equal(fresh[:, :41], log[:, :41])
    assert np.abs(fresh - log).max() > 0.01


@pytest.mark.slow
def test_it_plans_only_where_something_in_view_is_new():
    """False memories show this: they are followed up to the first new thing in view."""
    made, planner = platoon(), aim_bev()
    world = to_world(made)
    memory = planner.init(CompiledScene(made, world))
    _, last = drives(planner, memory, world, world.log)
    stop = replace(last.last_drive, waypoints=last.last_drive.waypoints.at[0].set(0.0))
    stopping, _ = drives(planner, replace(memory, last_drive=stop), world, world.log)
    assert stopping[3, 1] < stopping[3, 0] - 0.5
    far = replace(world.log, y=world.log.y.at[3].add(500.0))
    away, _ = drives(planner, replace(memory, last_drive=stop), world, far)
    fresh, _ = drives(planner, memory, world, far)
    np.testing.assert_array_equal(away, fresh, "somebody has gone from view")


@pytest.mark.slow
def test_attacks_end_as_without_a_memory():
    few = KING.but(iterations=12, replan_every=4, nearest=2, attempts=1)
    with_memory, without = (list(attack([platoon()], few, name)) for name in ("aim-bev", f"{__file__}:forgetful"))
    for one, other in zip(with_memory, without, strict=True):
        assert one.attack.outcome == other.attack.outcome
        np.testing.assert_array_equal(one.tracks.x, other.tracks.x)
        np.testing.assert_array_equal(one.tracks.y, other.tracks.y)


@pytest.mark.slow
def test_torch_and_jax_agree():
    torch = pytest.importorskip("torch", reason="torch is an extra")
    from regents_cosim.training.lessons.torch_network import AimBevNetwork

    weights = {name: values.astype(np.float32) for name, values in load_weights(SHIPPED).items()}
    network = AimBevNetwork().eval()
    network.load_state_dict({name: torch.tensor(values) for name, values in weights.items()}, strict=False)
    rng = np.random.default_rng(0)
    view = np.repeat(np.repeat(rng.integers(0, 256, (24, 24, 3), np.uint8), 8, axis=0), 8, axis=1)
    forward = jax.jit(lambda network, *seen: network(*seen))
    weights["mlp.0.weight"][:, -1] = rng.normal(size=len(weights["mlp.0.weight"]))  # it was never told of lights
    network.load_state_dict({"mlp.0.weight": torch.tensor(weights["mlp.0.weight"])}, strict=False)
    told = to_network(weights)
    for speed, target, light in ((0.0, (5.0, 1.0), 0.0), (9.0, (60.0, -20.0), 0.5), (22.0, (0.0, 0.0), 1.0)):
        with torch.inference_mode():
            pictures = torch.tensor(view).permute(2, 0, 1)[None] / 255.0
            theirs = network(pictures, *map(torch.tensor, ([speed], [target], [light])))[0].numpy()
        ours = forward(told, jnp.asarray(view), jnp.float32(speed), jnp.array(target, jnp.float32), jnp.float32(light))
        assert np.abs(theirs - np.asarray(ours)).max() < 1e-5 * max(1.0, np.abs(theirs).max())


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cases")
    suite = SuiteWriter(folder, 0)
    for seed in range(2):
        suite.add(platoon(seed=seed))
    return folder


@pytest.mark.slow
def test_training_goes_on_where_it_stopped(cases, tmp_path):
    pytest.importorskip("torch", reason="torch is an extra")
    from regents_cosim.training.lessons.train import TrainConfig, checkpoint_path, train

    config = TrainConfig(epochs=2, lessons=64, drives=1, warm_up=0, threads=1, frozen=11)
    out = tmp_path / "weights.safetensors"
    first = next(train(load_suite(cases), out, config))
    weights = load_weights(out)
    (both,) = train(load_suite(cases), out, config, checkpoint_path(out))
    assert both[0] == first[0]
    assert np.isfinite(both[1].loss_m)
    after = load_weights(out)
    assert np.array_equal(after["encoder.features.0.0.weight"], weights["encoder.features.0.0.weight"]), "frozen"
    assert not np.array_equal(after["output.weight"], weights["output.weight"])


@pytest.mark.slow
def test_training_is_the_same_in_a_process_of_double_precision(cases, tmp_path):
    pytest.importorskip("torch", reason="torch is an extra")
    from regents_cosim.training.lessons.train import TrainConfig, train

    config = TrainConfig(epochs=1, lessons=64, drives=1, warm_up=0, threads=1, frozen=11)
    for double in (False, True):
        with jax.enable_x64(double):
            (done,) = train(load_suite(cases), tmp_path / f"{double}.safetensors", config)
        assert np.isfinite(done[0].held_back_m)
    assert (tmp_path / "True.safetensors").read_bytes() == (tmp_path / "False.safetensors").read_bytes()


@pytest.mark.slow
def test_a_checkpoint_keeps_where_a_careful_teacher_braked(tmp_path):
    pytest.importorskip("torch", reason="torch is an extra")
    from regents_cosim.training.lessons.train import TrainConfig, checkpoint_path, train

    crosses = crossroads("G", "G")
    config = TrainConfig(epochs=2, lessons=256, batch=32, drives=1, threads=1, frozen=11, teacher="careful", view=38.4)
    out = tmp_path / "weights.safetensors"
    first = next(train([crosses], out, config, SHIPPED))
    saved = load_weights(checkpoint_path(out))
    assert len(saved["urgent.rows"]) == len(saved["urgent.states"]) > 10
    (both,) = train([crosses], out, config, checkpoint_path(out))
    assert both[0] == first[0]
    (again,) = train([crosses], tmp_path / "again.safetensors", config, checkpoint_path(out))
    assert again == both  # no epoch is left, and the weights are those that were learnt
    learnt, written = load_weights(out), load_weights(tmp_path / "again.safetensors")
    assert all(np.array_equal(written[name], values) for name, values in learnt.items())


@pytest.mark.slow
@pytest.mark.parametrize("teacher", ["log", pytest.param("idm", marks=pytest.mark.slow)])
def test_training_from_the_command_line(cases, tmp_path, capsys, teacher):
    pytest.importorskip("torch", reason="torch is an extra")
    out = tmp_path / "weights.safetensors"
    words = ["train", "aim-bev", str(cases), "--lessons", "64", "--drives", "0", "--epochs", "1", "--frozen", "13"]
    words += ["--teacher", teacher]
    assert run([*words, "-o", str(out), "--resume", str(SHIPPED), "--quiet"]) == 0
    assert "weights in" in capsys.readouterr().out
    assert with_weights(out).network.join.weight.shape == (576, 512)
    assert run([*words, "-o", str(tmp_path / "weights.pt")]) == 2


def test_evaluate_prints_scores(cases, capsys):
    assert run(["evaluate", str(cases), "--planner", "constant_velocity", "--quiet"]) == 0
    said = capsys.readouterr().out
    assert "constant_velocity on 2 cases" in said
    assert "collision rate percent" in said
