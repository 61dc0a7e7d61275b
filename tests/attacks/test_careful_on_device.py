"""The careful driver of the search agrees with that of the verdict, which counts."""

import jax.numpy as jnp
import pytest
from avoidable_scenes import braking_lead
from careful_scenes import careful, comes_over, cut_in
from places import ROOT
from scenes import platoon

from regents_cosim.attacks.accept.careful_driver import careful_avoids
from regents_cosim.cases.suite import load_suite
from regents_cosim.mirror.lane_centres import lane_centres
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.world import scene_origin, to_world

STANDARD = ROOT / "scenarios" / "standard"


@compiled
def asked(world, lanes, adversary, step):
    return careful_avoids(world, world.log, world.boxes(world.log), lanes, adversary, step)


def on_device(attacked):
    hit = attacked.collision
    adversary = attacked.index(hit.agent)
    return bool(
        asked(
            to_world(attacked),
            lane_centres(attacked, scene_origin(attacked)),
            jnp.int32(adversary),
            jnp.int32(hit.step),
        )
    )


def prevents(attacked):
    """Whether braking alone avoids the crash by the verdict."""
    found = careful(attacked)
    return found.avoids and not found.shift_m


@pytest.mark.slow
def test_it_agrees_on_cut_ins_and_leaders_that_brake():
    crashes = [cut_in(gap, lateral) for gap in (2.0, 18.0) for lateral in (1.0, 1.8)]
    crashes += [braking_lead(gap) for gap in (4.0, 35.4)]
    crashes += [comes_over(ahead) for ahead in (2.0, -2.0)]
    found = [(prevents(crash), on_device(crash)) for crash in crashes]
    assert {here for here, _ in found} == {True, False}
    assert not any(there and not here for here, there in found)
    assert sum(here == there for here, there in found) >= len(found) - 1


def test_lane_centres_are_those_of_lanes_that_run_the_same_way():
    made = platoon()
    centres, origin = lane_centres(made, scene_origin(made)), to_world(made).log.x[0, 0] - made.tracks.x[0, 0]
    x = jnp.full(4, 50.0) + origin
    off = centres.off_centre(x, jnp.array([0.0, 0.3, -1.6, 0.0]) + offset(made), jnp.array([0.0, 0.1, 0.0, 3.0]))
    assert off[:3].tolist() == pytest.approx([0.0, 0.3, -1.6], abs=1e-3)
    assert off[3] > 1e3


def offset(made):
    """How far the device's coordinates are from the map's, north [m]."""
    return float(to_world(made).log.y[0, 0]) - made.tracks.y[0, 0]


@pytest.mark.slow
def test_it_agrees_on_the_standard_suite_and_is_the_stricter_one():
    crashes = [case for case in load_suite(STANDARD) if case.collision is not None]
    found = [(prevents(crash), on_device(crash)) for crash in crashes]
    assert sum(here == there for here, there in found) >= 0.95 * len(found)  # 19 of 19
    assert sum(there and not here for here, there in found) <= 0.02 * len(found)
