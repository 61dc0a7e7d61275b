"""The history before a collision."""

import numpy as np
import pytest
from crossing_scenes import LANE_Y, scenario, straight
from scenes import absent, scene

from regents_cosim.scenario.attack_record import Collision
from regents_cosim.scenario.collisions import collision_at, first_contact
from regents_cosim.verdicts.law.crash_history import CrashHistory


def drifted(*cars):
    """The distance that the second car moved across its road in the 2 s before the contact at the last step."""
    made = scenario(*cars)
    hit = Collision(made.agents[1].id, made.tracks.steps - 1, 2.0, "side_swipe", 5.0, attributed=True)
    return CrashHistory(made, hit).drifted(1)


def test_who_keeps_to_the_road_does_not_drift():
    ego = straight("ego", -60.0, LANE_Y, 0.0, 10.0)
    assert drifted(ego, straight("other", -60.0, LANE_Y - 3.4, 0.0, 10.0)) == pytest.approx(0.0, abs=0.05)


def test_through_a_junction_the_nearest_lane_that_runs_its_way_is_its_road():
    ego = straight("ego", -30.0, LANE_Y, 0.0, 10.0)
    assert drifted(ego, straight("other", -10.0, LANE_Y - 0.5, 0.0, 10.0)) == pytest.approx(0.0, abs=0.3)


def test_lanes_across_are_not_its_road():
    ego = straight("ego", -30.0, LANE_Y, 0.0, 10.0)  # those that lead south lie on the west of the junction
    assert drifted(ego, straight("other", -8.0, LANE_Y - 1.0, 0.0, 4.0)) == pytest.approx(0.0, abs=0.3)


def test_who_drives_aslant_drifts():
    ego, slope = straight("ego", -60.0, LANE_Y, 0.0, 10.0), 0.1
    assert drifted(ego, straight("other", -60.0, LANE_Y - 3.0, slope, 10.0)) == pytest.approx(
        2.0 * 10.0 * np.sin(slope), rel=0.1
    )


@pytest.mark.parametrize("unseen", [slice(20, 31), slice(27, 30)])
def test_nothing_is_read_where_the_other_was_not_seen(unseen):
    """The ego runs into a slower car at step 31, which the log lost for a while before."""
    made = scene((0, 0, 10), (20, 0, 5))
    lost = absent(made, (1, unseen))
    assert first_contact(lost.agents, lost.tracks) == first_contact(made.agents, made.tracks) == (1, 31)
    hit = collision_at(lost.agents, lost.tracks, (1, 31), lost.dt, attributed=True)
    assert hit.collision_type == "rear_end_by_ego"
    crash = CrashHistory(lost, hit)
    assert (crash.first, crash.lately, crash.before) == (unseen.stop, unseen.stop, max(30, unseen.stop))
    assert crash.speed(1, crash.before) == 5.0
    assert crash.turned(1) == 0.0
