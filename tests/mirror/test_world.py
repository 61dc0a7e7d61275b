from dataclasses import replace

import jax
import numpy as np
import pytest
from scenes import absent, moving, platoon, scene

from regents_cosim.attacks.accept.rules import candidates
from regents_cosim.attacks.methods.presets import REGENTS
from regents_cosim.mirror.rollout import roll_out_background
from regents_cosim.mirror.world import scene_origin, to_roadless_world, to_tracks, to_world


def partly_absent():
    return absent(platoon(), (3, slice(20)), (5, slice(60, None)))


@pytest.mark.parametrize("make", [platoon, partly_absent])
def test_to_the_device_and_back(make):
    scenario = make()
    world = to_world(scenario)
    tracks = to_tracks(roll_out_background(world, world.controls), world.controls, scenario)
    assert np.array_equal(tracks.valid, scenario.tracks.valid)
    for name, tolerance in (("x", 0.01), ("y", 0.01), ("yaw", 0.01), ("speed", 0.1)):
        assert getattr(tracks, name) == pytest.approx(getattr(scenario.tracks, name), abs=tolerance), name


def jumping():
    made = platoon()
    return moving(made, 4, y=made.tracks.y[4] + 3.2 * (np.arange(81) >= 40))


def test_an_agent_that_jumps_is_where_its_log_has_it_and_may_not_attack():
    scenario = jumping()
    world = to_world(scenario)
    motion = roll_out_background(world, world.controls)
    tracks = to_tracks(motion, world.controls, scenario)
    np.testing.assert_allclose(tracks.y[4], scenario.tracks.y[4], atol=1e-4)
    np.testing.assert_allclose(tracks.x[4], scenario.tracks.x[4], atol=1e-4)
    usual = candidates(to_world(platoon()), REGENTS)
    assert usual[4]
    assert np.flatnonzero(candidates(world, REGENTS) != usual).tolist() == [4]


def test_an_agent_that_enters_late_starts_at_its_first_step():
    scenario = partly_absent()
    world = to_world(scenario)
    assert not world.moving[3, :20].any()
    assert world.moving[3, 20:].all()
    origin = scene_origin(scenario)
    assert world.start.x[3] == pytest.approx(scenario.tracks.x[3, 20] - origin[0], abs=1e-3)


def test_padding_is_never_valid_and_finite():
    world = to_world(platoon())
    assert world.valid.shape == (32, 81)
    assert not world.valid[9:].any()
    assert not world.vehicle[9:].any()
    motion = roll_out_background(world, world.controls)
    assert np.isfinite(motion.x).all()


def test_without_its_road_a_world_is_the_same_and_all_road():
    scenario = partly_absent()
    world, bare = to_world(scenario), to_roadless_world(scenario)
    jax.tree.map(np.testing.assert_array_equal, replace(world, road=bare.road), bare)
    jax.tree.map(np.testing.assert_array_equal, world.without_road(), bare)
    away = world.start.y + 50.0
    assert world.road(world.start.x, away)[0] == 1.0
    assert bare.road(world.start.x, away)[0] == 0.0


def test_far_from_the_origin_nothing_is_lost():
    far = scene((8758.25, 0.0, 10.0), (8780.5, 3.2, 10.0))
    world = to_world(far)
    assert np.abs(world.log.x).max() < 200
    tracks = to_tracks(world.log, world.controls, far)
    assert tracks.x == pytest.approx(far.tracks.x, abs=2e-5)


def test_pairs_that_overlap_from_the_start_are_marked():
    apart = np.asarray(to_world(scene((0.0, 0.0, 10.0), (30.0, 0.0, 10.0), (32.0, 0.5, 10.0))).apart)
    assert apart[0, 1]
    assert apart[0, 2]
    assert not apart[1, 2]
    assert not apart[2, 1]


def test_corners_off_the_road_at_the_start_are_marked():
    on_road = np.asarray(to_world(scene((0.0, 0.0, 10.0), (30.0, -1.2, 10.0))).on_road)
    assert on_road[:, 0].all()
    assert on_road[:, 1].tolist() == [True, False, False, True]  # front left, front right, rear right, rear left


def test_pedestrians_are_no_vehicles():
    made = scene((0.0, 0.0, 10.0), (30.0, 0.0, 1.0), (60.0, 0.0, 5.0))
    kinds = ("car", "pedestrian", "bus")
    agents = tuple(replace(agent, kind=kind) for agent, kind in zip(made.agents, kinds, strict=True))
    assert np.asarray(to_world(replace(made, agents=agents)).vehicle)[:3].tolist() == [True, False, True]
