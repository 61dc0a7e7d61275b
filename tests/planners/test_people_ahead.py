"""Planners see people on foot and on bicycles, and stop for them."""

import numpy as np
import pytest
from scenes import TIME, scene
from test_idm import driven
from walkers import as_kind, walked

from regents_cosim.mirror.rollout import roll_out_background, with_ego
from regents_cosim.mirror.world import to_tracks
from regents_cosim.planners.find import find_attribute
from regents_cosim.planners.interface import Others
from regents_cosim.scenario.collisions import first_contact

NAMES = ["idm", "careful"]


def drive_of(made, name):
    """The tracks driven by a planner, and the step at which it touches someone."""
    motion, _, world = driven(made, find_attribute(name)())
    around = roll_out_background(world, world.controls)
    tracks = to_tracks(with_ego(around, motion), world.controls, made)
    return tracks, first_contact(made.agents, tracks)


def crossing(leaves_s):
    """A person that crosses the ego's lane 40 m ahead, at 1.4 m/s from 5.5 m beside its middle."""
    return walked(scene((0, 0, 10), (80, 0, 0)), 1, 0 * TIME + 40.0, 5.5 - 1.4 * np.maximum(TIME - leaves_s, 0.0))


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_it_stops_for_who_stands_in_its_lane(name):
    for kind in ("pedestrian", "bicycle"):
        tracks, contact = drive_of(as_kind(scene((0, 0, 10), (42.5, 0, 0)), 1, kind), name)
        assert contact is None
        assert tracks.speed[0, -1] < 1.0


@pytest.mark.slow
def test_who_crosses_is_seen_by_idm_once_in_its_lane_and_by_the_careful_driver_before():
    early, late = crossing(-1.5), crossing(-0.5)
    assert drive_of(early, "idm")[1] is None
    assert drive_of(early, "careful")[1] is None
    assert drive_of(late, "idm")[1] is not None
    assert drive_of(late, "careful")[1] is None


def test_planners_of_others_are_told_who_walks():
    made = crossing(0.0)
    state = (values[1:, 20] for values in (made.tracks.x, made.tracks.y, made.tracks.yaw, made.tracks.speed))
    (one,) = Others(made.agents[1:], *state, made.tracks.valid[1:, 20])
    assert (one.kind, one.length, one.width) == ("pedestrian", 0.5, 0.6)
    assert one.speed == pytest.approx(1.4)
