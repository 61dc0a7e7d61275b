"""`aim-bev-hardened`: AIM-BEV trained on crashes and lights, which comes beside `aim-bev`. Lights matter to it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shipped_cases import shipped_windows
from two_car_scenes import crossroads, moving

from regents_cosim.cli import run
from regents_cosim.evaluation.drives.driving import drive_each
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.rollout import others
from regents_cosim.mirror.world import to_world
from regents_cosim.norms.limits import ACCEL_LIMIT
from regents_cosim.planners.aim_bev.camera import Camera
from regents_cosim.planners.aim_bev.network_inputs import NetworkInputs
from regents_cosim.planners.aim_bev.observe import Surroundings
from regents_cosim.planners.aim_bev.planner import aim_bev_hardened
from regents_cosim.planners.aim_bev.route_ahead import all_red_and_all_green
from regents_cosim.planners.jax_planner import CompiledScene
from regents_cosim.planners.names import OURS, is_built_in
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.routes.route import route_into_gaps

NAME = "aim-bev-hardened"


def test_it_comes_with_the_package_and_may_be_named_by_a_case():
    planner = PlannerUnderTest.of(NAME)
    assert planner.loop is aim_bev_hardened()
    assert planner.loop.given == NetworkInputs(follows_route=True, camera=Camera.reaching(38.4))
    assert is_built_in(NAME)
    assert NAME in OURS


def planned(made, x, speed):
    """The distance [m] that it plans to cover in 0.8 s, at a place on its way."""
    planner, world = aim_bev_hardened(), to_world(made)
    scene = CompiledScene(made, world)
    memory = planner.init(scene)
    ego = Motion(*map(jnp.float32, (x - scene.origin[0], -scene.origin[1], 0.0, speed)))
    now = jax.tree.map(lambda values: values[0], planner.look(memory, others(world, world.log, world.valid)))
    view = Surroundings(now.boxes, now.speed, now.valid, memory.lights[0])
    return float(planner.plan(memory, view, ego)[-1, 0])


@pytest.mark.slow
@pytest.mark.parametrize("before_line_m", [8.0, 12.0])
def test_it_brakes_for_a_red_light_and_for_no_green_one(before_line_m):
    made = moving(crossroads("r", "G"), 1, y=np.full(81, -60.0), speed=np.zeros(81))
    nose_m = 0.5 * made.agents[0].length
    red, green = (planned(lit, -10.0 - before_line_m - nose_m, 8.0) for lit in all_red_and_all_green(made))
    assert green - red > 1.5


def can_stop(window):
    """Whether the ego can still stop before its first line with half of its brakes."""
    line_m = route_into_gaps(window).stop_lines(window.signals, window.tracks.steps)[0].distance_m
    room_m = line_m - 0.5 * window.ego.length
    return window.tracks.speed[0, 0] ** 2 < ACCEL_LIMIT * room_m


@pytest.mark.slow
def test_it_stops_at_red_lights_of_real_windows():
    """The same windows of a network with lights, all red and all green."""
    twins = [twin for window in shipped_windows("signals") if (twin := all_red_and_all_green(window))]
    twins = [twin for twin in twins if can_stop(twin[0])][:2]
    assert twins
    red, green = (list(drive_each(scenes, NAME)) for scenes in zip(*twins, strict=True))
    assert [drive.red_lights for drive in red] == [0] * len(red)
    assert sum(drive.completion for drive in green) > sum(drive.completion for drive in red) + 0.3


@pytest.mark.slow
def test_it_can_be_trained_further_by_its_name(tmp_path, capsys):
    """Its weights say what it was taught: it follows the route, which the log does not teach."""
    pytest.importorskip("torch", reason="torch is an extra")
    out = tmp_path / "further.safetensors"
    assert run(["train", "aim-bev", "shipped:quickstart", "-o", str(out), "--resume", NAME, "--quiet"]) == 2
    assert "weights that follow the route (target route), expected the teacher idm" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
