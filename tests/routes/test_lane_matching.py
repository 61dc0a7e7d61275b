"""Which lane is under each point of a path."""

import numpy as np
import pytest
from scenes import straight_road

from regents_cosim.routes.lane_matching import match_lanes


@pytest.mark.parametrize("number", [0, 1, 2, 5])
def test_every_point_of_a_path_has_an_answer_and_a_single_one_no_direction(number):
    path = np.stack([5.0 + 2.0 * np.arange(number), np.zeros(number)], axis=-1)
    found = match_lanes(straight_road(2), path, np.zeros(number))
    assert len(found) == number
    assert all((lane is not None) == (number > 1) for lane in found)
