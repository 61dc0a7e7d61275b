"""In the mirror others react to a planner that drives otherwise than the ego of the case, and for nothing else."""

import numpy as np
import pytest
from careful_scenes import scene, straight_road

from regents_cosim import Control
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.replays.replay import replay_each


class Brakes:
    """Brakes by as much as it is told, whatever it sees."""

    def __init__(self, braking):
        self.braking = braking

    def reset(self, scene):
        pass

    def act(self, observation):
        return Control(-self.braking if observation.ego.speed > 0.0 else 0.0, 0.0)


def driven(braking, lanes=2):
    followed = scene((0, 0, 15), (-25, 0, 15), (0, 3.2, 15), road=straight_road(lanes))
    (found,) = replay_each([followed], "mirror", PlannerUnderTest.of(Brakes(braking), own_process=False))
    return followed, found


def test_a_follower_brakes_for_a_planner_that_brakes():
    _, found = driven(4.0, lanes=1)
    assert found.found is None
    assert found.verified, found.reason
    assert found.driven == ("car01",)
    assert found.replayed.tracks.speed[1, -1] == pytest.approx(0.0, abs=0.5)


def test_a_follower_with_a_free_lane_beside_it_drives_around_a_planner_that_brakes():
    _, found = driven(4.0)
    assert found.found is None
    assert found.driven == ("car01",)
    tracks = found.replayed.tracks
    assert tracks.y[1].max() == pytest.approx(3.2, abs=0.3)
    assert tracks.x[1, -1] > tracks.x[0, -1] + 20.0


def test_where_the_planner_drives_as_recorded_all_keep_to_their_tracks():
    followed, found = driven(0.0)
    assert found.verified, found.reason
    assert found.driven == ()
    np.testing.assert_array_equal(found.replayed.tracks.x[1:], followed.tracks.x[1:])
