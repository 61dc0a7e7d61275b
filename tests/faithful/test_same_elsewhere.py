"""The same scene elsewhere gives the same answer: on the device to the bit where it is moved."""

import jax
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from moved_scenes import moved_scene, turned
from params import slow
from shipped_cases import shipped_window

from regents_cosim.attacks.accept.lawful import road_near_ego
from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import REGENTS, REGENTS_FOCUSED
from regents_cosim.mirror.world import scene_origin, to_world
from regents_cosim.planners.idm import IDM

SHIFTS = st.tuples(*[st.floats(-5e6, 5e6).map(lambda value: round(value, 3))] * 2)
TURNED_M = 2.0**-13  # half as much to either side


@pytest.fixture(scope="module")
def here():
    return shipped_window("crossing")


@pytest.fixture(scope="module")
def at_home(here):
    return on_the_device(here)


def on_the_device(scenario):
    """All that a search looks at: states, controls, the road's field and the ego's route."""
    world = to_world(scenario)
    route = IDM().on_route(scenario, scene_origin(scenario))
    fields = [without_room(field) for field in (world.road, road_near_ego(scenario))]
    return [np.asarray(leaf) for leaf in jax.tree.leaves((world.without_road(), fields, route))]


def without_room(field):
    rows, columns = np.asarray(field.shape).tolist()
    return np.asarray(field.cells)[: rows * columns, 0], field.shape, field.corner


@settings(max_examples=3, deadline=None, suppress_health_check=list(HealthCheck))
@given(by=SHIFTS)
def test_a_scene_that_is_moved_is_the_same_on_the_device(here, at_home, by):
    there = on_the_device(moved_scene(here, by))
    assert len(there) == len(at_home)
    assert all(np.array_equal(mine, theirs) for mine, theirs in zip(at_home, there, strict=True))


@pytest.mark.parametrize("quarters", [1, slow(2), slow(3)])
def test_a_scene_that_is_turned_is_the_same_on_the_device_but_for_that(here, quarters):
    home, there = to_world(here), to_world(moved_scene(here, (5e6, -1234.567), quarters))
    mine, theirs = (np.stack([world.log.x, world.log.y], axis=-1).astype(float) for world in (home, there))
    assert turned(theirs, -quarters) == pytest.approx(mine, abs=TURNED_M)
    assert np.asarray(there.log.speed) == pytest.approx(np.asarray(home.log.speed), abs=1e-6)
    turn = np.asarray(there.log.yaw, float) - np.asarray(home.log.yaw, float)
    assert turn[: len(here.agents)] == pytest.approx(0.5 * np.pi * quarters, abs=1e-5)
    assert np.array_equal(there.on_road, home.on_road)
    for name in ("accel", "curvature"):
        found, expected = (np.asarray(getattr(world.controls, name)) for world in (there, home))
        assert found == pytest.approx(expected, abs=2e-2)


@pytest.mark.slow
@pytest.mark.parametrize("config", [REGENTS_FOCUSED, REGENTS], ids=["focused", "regents"])
def test_an_attack_elsewhere_ends_the_same(here, config):
    config = config.but(iterations=20)
    (home,) = attack([here], config, progress=False)
    for by, quarters in (((5e6, 5e6), 0), ((1234.567, -89.1), 0), ((0.0, 0.0), 1), ((0.4, 2e5), 3)):
        (there,) = attack([moved_scene(here, by, quarters)], config, progress=False)
        assert there.attack.outcome == home.attack.outcome
        hits = [case.collision and (case.collision.agent, case.collision.step) for case in (home, there)]
        assert hits[0] == hits[1]
        if not quarters:
            valid = home.tracks.valid
            assert there.tracks.x[valid] - by[0] == pytest.approx(home.tracks.x[valid], abs=1e-8)
            assert there.attack.iterations == home.attack.iterations
