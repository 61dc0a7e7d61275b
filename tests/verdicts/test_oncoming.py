import numpy as np
import pytest
import shapely
from crossing_scenes import road
from hypothesis import given, settings
from hypothesis import strategies as st

from regents_cosim.geometry.boxes import Boxes, corners
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.verdicts.law.oncoming import oncoming, oncoming_share


def two_way(width=3.0, apart=3.0, side=1, height=0.0):
    """A road along x: to the east at y = 0, to the west `apart` to its left (right for side = -1)."""
    east = np.array([[-200.0, 0.0], [200.0, 0.0]])
    lanes = (
        Lane("east", east, width, 14.0, height=np.zeros(2)),
        Lane("west", east[::-1] + np.array([0.0, side * apart]), width, 14.0, height=np.full(2, height)),
    )
    return RoadMap(lanes, (), shapely.box(-200, -20, 200, 20))


def body(y, yaw=0.0, x=0.0, z=0.0):
    return Boxes(x, y, yaw, 4.6, 1.8, z)


def test_a_place_is_oncoming_where_all_lanes_run_the_other_way():
    points = np.array([[0.0, 0.0], [0.0, 3.0], [0.0, 9.0]])
    assert oncoming(two_way(), points, 0.0).tolist() == [False, True, False]
    assert oncoming(two_way(), points, np.pi).tolist() == [True, False, False]
    assert oncoming(two_way(), points, np.deg2rad([80.0, 80.0, 80.0])).tolist() == [False, True, False]


@pytest.mark.parametrize(("y", "share"), [(0.0, 0.0), (0.6, 0.0), (1.5, 0.5), (0.9, 1 / 6), (3.0, 1.0), (6.0, 0.0)])
def test_the_share_of_a_body(y, share):
    assert float(oncoming_share(two_way(), body(y))) == pytest.approx(share, abs=0.05)


def test_lanes_drawn_on_each_other_are_never_oncoming():
    assert not oncoming_share(two_way(apart=0.0), body(np.linspace(-3, 3, 9))).any()


def test_a_bridge_is_not_the_road_below():
    assert oncoming_share(two_way(height=6.0), body(3.0, z=0.0)) == 0.0
    assert oncoming_share(two_way(height=6.0), body(3.0, z=6.0)) == 1.0


def test_a_map_without_lanes_has_no_oncoming_places():
    assert not oncoming_share(RoadMap((), (), shapely.box(-5, -5, 5, 5)), body(np.zeros(3))).any()


@settings(max_examples=30)
@given(st.floats(-6, 6), st.floats(-1.0, 1.0), st.floats(1.0, 5.0))
def test_the_mirror_image_has_the_same_share(y, yaw, apart):
    left = oncoming_share(two_way(apart=apart), body(y, yaw))
    assert oncoming_share(two_way(apart=apart, side=-1), body(-y, -yaw)) == pytest.approx(left, abs=0.03)


@settings(max_examples=30)
@given(st.floats(-130, 130), st.floats(-8, 8), st.floats(-3, 3))
def test_the_share_is_that_of_the_areas(x, y, yaw):
    """The share equals that of the areas, away from the middle of the crossing."""
    found = float(oncoming_share(road("crossing"), body(y, yaw, x)))
    outside = [lane for lane in road("crossing").lanes if not lane.junction and abs(lane.centre.mean(axis=0)[0]) > 20]
    if abs(x) < 70 or abs(np.cos(yaw)) < 0.1:
        return
    ahead = np.array([np.cos(yaw), np.sin(yaw)])
    strips = {True: [], False: []}
    for lane in outside:
        strip = shapely.LineString(lane.centre).buffer(0.5 * lane.width, cap_style="flat")
        strips[bool((lane.centre[-1] - lane.centre[0]) @ ahead < 0)].append(strip)
    area = shapely.Polygon(corners(body(y, yaw, x)))
    only = shapely.union_all(strips[True]).difference(shapely.union_all(strips[False]))
    assert found == pytest.approx(area.intersection(only).area / area.area, abs=0.06)  # a tenth of the width is one row
