"""The way of an ego to its target begins on the lane that it is on, with the line and the light at that lane's end."""

import numpy as np
import pytest
import shapely

from regents_cosim.geometry.frames import Pose
from regents_cosim.maps.roadmap import Connection, Lane, RoadMap
from regents_cosim.routes.to_target import way_to_target

LINES = {"before": (-80.0, 0.0), "within": (0.0, 20.0), "after": (20.0, 100.0)}
ROAD = RoadMap(
    tuple(
        Lane(name, np.array([[begin, 0.0], [end, 0.0]]), 3.5, 14.0, junction=name == "within")
        for name, (begin, end) in LINES.items()
    ),
    (Connection("before", "within"), Connection("within", "after")),
    shapely.box(-80.0, -2.0, 100.0, 2.0),
)


@pytest.mark.parametrize("x", [-60.0, -10.0, -2.9, -0.1])
def test_it_begins_before_the_stop_line_however_near_that_is(x):
    way = way_to_target(ROAD, Pose(x, 0.3, 0.0), 0.0, (60.0, 0.0))
    assert [lane.id for lane in way] == ["before", "within", "after"]


@pytest.mark.parametrize(("x", "target", "expected"), [(5.0, 60.0, ["within", "after"]), (25.0, 60.0, ["after"])])
def test_what_lies_behind_is_no_part_of_it(x, target, expected):
    way = way_to_target(ROAD, Pose(x, 0.0, 0.0), 0.0, (target, 0.0))
    assert [lane.id for lane in way] == expected
