"""A route that the ego's planner is known to have, whatever SUMO's own is."""

import numpy as np
import pytest
from shapely import box

from regents_cosim.errors import RegentsError
from regents_cosim.live.host.sumo_routes import KnownRoute
from regents_cosim.live.predict.paths import BEHIND_M
from regents_cosim.maps.roadmap import Lane, RoadMap

LIMIT = 14.0
ROAD = RoadMap(
    lanes=tuple(Lane(f"a_{k}", np.array([[0.0, 3.2 * k], [400.0, 3.2 * k]]), 3.2, LIMIT) for k in (0, 1)),
    connections=(),
    drivable=box(-50.0, -20.0, 450.0, 20.0),
)
CHANGING = np.array([[0.0, 0.0], [60.0, 0.0], [90.0, 3.2], [300.0, 3.2]])


def test_the_ego_is_expected_to_change_lanes_where_its_route_does():
    path = KnownRoute(CHANGING, ROAD).path((50.0, 0.0), 0.0, 0.0, 10.0, 8.0)
    ahead = path.points[BEHIND_M:]
    assert np.allclose(ahead[0], [50.0, 0.0])
    assert abs(ahead[50, 1] - 3.2) < 0.1
    assert np.allclose(path.limit, LIMIT)


def test_a_planner_is_told_the_very_points_of_its_route():
    way = KnownRoute(CHANGING, ROAD).ahead((50.0, 0.0), 0.0)
    assert way[0, 0] == pytest.approx(40.0)
    assert np.allclose(np.hypot(*np.diff(way, axis=0).T), 1.0, atol=0.01)
    assert way[-1, 1] == pytest.approx(3.2)


def test_where_a_route_comes_by_twice_the_first_time_counts():
    angle = np.linspace(0.0, 4.0 * np.pi, 400)  # twice around
    route = KnownRoute(20.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1), ROAD)
    assert len(route.ahead((0.0, 20.0), np.pi)) > 1.5 * 40.0 * np.pi


@pytest.mark.parametrize(("front", "yaw"), [((50.0, 40.0), 0.0), ((50.0, 0.0), np.pi), ((299.9, 3.2), 0.0)])
def test_far_off_the_other_way_or_at_its_end_it_says_nothing(front, yaw):
    route = KnownRoute(CHANGING, ROAD)
    assert route.ahead(front, yaw) is None
    assert route.path(front, 0.0, yaw, 10.0, 8.0) is None


@pytest.mark.parametrize("points", [[1.0, 2.0], [[0.0, 0.0]], [[0.0, 0.0], [np.nan, 1.0]], [[0.0, 0.0], [0.1, 0.0]]])
def test_what_is_no_line_is_refused_in_one_line(points):
    with pytest.raises(RegentsError, match="route"):
        KnownRoute(points, ROAD)
