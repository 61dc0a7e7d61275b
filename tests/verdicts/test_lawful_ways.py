from dataclasses import replace

import numpy as np
import pytest
import shapely
from crossing_scenes import EGO, road, scenario, straight, turning
from scenes import scene

from regents_cosim.maps.roadmap import Connection, Lane, RoadMap
from regents_cosim.verdicts.law.lane_pieces import lane_pieces, neighbours
from regents_cosim.verdicts.law.lawful_ways import lawful_area, lawful_lanes, ways_ahead


def ends_on(way):
    return way.lanes[-1].id.rsplit("_", 1)[0]


def test_every_turn_that_begins_at_the_lane_is_a_way_and_the_logged_one_is_first():
    made = scenario(EGO, straight("a", 80.0, 1.7, np.pi, 35.0))
    ways = ways_ahead(made, 1)
    assert ways[0].logged
    assert [way.logged for way in ways[1:]] == [False] * (len(ways) - 1)
    assert ends_on(ways[0]) == "west_out"
    assert {ends_on(way) for way in ways} == {"west_out", "north_out", "south_out"}
    assert {way.changes for way in ways} == {0, 1}


def test_no_way_changes_lanes_over_a_solid_line():
    made = scenario(EGO, straight("a", 30.0, 1.7, np.pi, 12.0))
    ways = ways_ahead(made, 1)
    assert {ends_on(way) for way in ways if way.changes == 0} == {"west_out", "south_out"}
    assert not any({"east_stop_0", "east_stop_1"} <= {lane.id for lane in way.lanes} for way in ways)


def test_a_way_begins_at_the_agent_and_keeps_to_its_area():
    made = scenario(EGO, straight("a", 60.0, 2.4, np.pi, 12.0))
    area = lawful_area(made, 1).buffer(1e-6)
    for way in ways_ahead(made, 1):
        assert way.points[0].tolist() == [60.0, 2.4]
        assert shapely.LineString(way.points).difference(area).length < 1e-3
        assert np.hypot(*np.diff(way.points, axis=0).T).min() > 0.0


def test_the_area_leaves_out_what_only_runs_the_other_way():
    made = scenario(EGO, straight("a", 30.0, 1.7, np.pi, 12.0))
    area = lawful_area(made, 1)
    inside = set()
    for lane in (lane for lane in made.road.lanes if not lane.junction):
        strip = shapely.LineString(lane.centre).buffer(0.5 * lane.width, cap_style="flat")
        covered = area.intersection(strip).area
        inside |= {lane.id} if covered > 0.5 else set()
    assert inside == {"east_stop_1", "west_out_0", "west_out_1", "south_out_0"}
    assert made.road.drivable.buffer(1e-6).contains(area)


def test_who_begins_inside_a_junction_may_go_on():
    made = scenario(EGO, turning("a", 0.0, 1.7, np.pi, 8.0, 0.02))
    assert "west_out" in {ends_on(way) for way in ways_ahead(made, 1)}
    assert shapely.contains_xy(lawful_area(made, 1), 0.0, 1.7)


def test_a_standing_agent_has_ways_too():
    ways = ways_ahead(scenario(EGO, straight("a", 40.0, 1.7, np.pi, 0.0)), 1)
    assert len(ways) == 2
    assert ways[0].logged


def test_a_map_without_lanes_tells_nothing():
    made = scene((0, 0, 10), (30, 0, 10), road=RoadMap((), (), shapely.box(-200, -5, 600, 5)))
    assert lawful_area(made, 1) is None
    assert lawful_lanes(made, 1) is None
    assert ways_ahead(made, 1) == ()


def test_who_is_beside_all_lanes_has_no_ways():
    assert lawful_area(scene((0, 0, 10), (30, 40, 0)), 1) is None


def test_lanes_drawn_on_each_other_are_no_others():
    lines = {"there": [[-200.0, 0.0], [600.0, 0.0]], "back": [[600.0, 0.0], [-200.0, 0.0]]}
    lanes = tuple(Lane(name, np.array(line), 4.0, 14.0) for name, line in lines.items())
    made = scene((0, 0, 10), (30, 0, 10), road=RoadMap(lanes, (), shapely.box(-200, -2, 600, 2)))
    assert [lane.id for lane in lawful_lanes(made, 1)] == ["there"]
    assert lawful_area(made, 1).bounds[1::2] == pytest.approx((-2.0, 2.0))


def test_neighbours_that_a_map_does_not_name_are_found_by_place():
    made = scene((0, 0, 10))
    lanes = [replace(lane, left=None, right=None) for lane in made.road.lanes]
    lanes.append(Lane("against", lanes[2].centre[::-1] + np.array([0.0, 3.2]), 3.2, 15.0))
    found = neighbours(RoadMap(tuple(lanes), (), made.road.drivable))
    assert {name: set(others) for name, others in found.items()} == {
        "lane0": {"lane1"}, "lane1": {"lane0", "lane2"}, "lane2": {"lane1"}, "against": set(),
    }  # fmt: skip


def test_pieces_know_side_and_place_and_leave_no_wedge_at_a_bend():
    bent = Lane("bent", np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]]), 3.0, 14.0)
    onward = Lane("onward", np.array([[10.0, 10.0], [10.0, 30.0]]), 3.0, 14.0)
    pieces = lane_pieces(RoadMap((bent, onward), (Connection("bent", "onward"),), shapely.box(-5, -5, 40, 40)))
    at = pieces.under(np.array([[4.0, 1.0], [10.6, -0.6], [9.0, 12.0], [-0.5, 0.0], [4.0, 1.6]]))
    assert at.point.tolist() == [0, 1, 2]
    assert at.lane.tolist() == [0, 0, 1]
    assert at.left[[0, 2]].tolist() == pytest.approx([1.0, 1.0])
    assert at.along[[0, 2]].tolist() == pytest.approx([4.0, 2.0])
    assert at.heading[[0, 2]].tolist() == pytest.approx([0.0, np.pi / 2])


@pytest.mark.parametrize("net", ["crossing", "grid", "merge", "multilane", "roundabout", "signals"])
def test_the_middle_of_every_lane_is_in_it_and_runs_its_way(net):
    lanes = road(net).lanes
    lines = [shapely.LineString(lane.centre) for lane in lanes]
    middle = np.array([line.interpolate(0.5, normalized=True).coords[0] for line in lines])
    ahead = np.array([line.interpolate(0.51, normalized=True).coords[0] for line in lines]) - middle
    at = lane_pieces(road(net)).under(middle)
    own = at.take(at.lane == at.point)
    assert own.point.tolist() == list(range(len(lanes)))
    assert np.abs(own.left).max() < 0.06
    assert np.abs(np.angle(np.exp(1j * (own.heading - np.arctan2(ahead[:, 1], ahead[:, 0]))))).max() < 0.3
