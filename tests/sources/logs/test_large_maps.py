"""Maps of thousands of lanes: the neighbours that a look at every pair gives, in time that grows with the lanes."""

import large_maps
import numpy as np
import pytest
from log_files import osm
from params import slow

from regents_cosim.sources.logs.roads.argoverse2_map import read_map
from regents_cosim.sources.logs.roads.lanelet2 import read_lanelet2
from regents_cosim.sources.logs.roads.road import drivable_area
from regents_cosim.sources.logs.scene import LoggedMap


def read(format: str, content: bytes, folder) -> LoggedMap:
    if format == "argoverse2":
        (folder / "log_map_archive_x.json").write_bytes(content)
        return read_map(folder)
    (folder / "map.osm").write_bytes(content)
    return read_lanelet2(folder / "map.osm")


@pytest.mark.parametrize("lanes", [404, slow(8_000)])
@pytest.mark.parametrize("format", ["lanelet2", "argoverse2"])
def test_a_lane_leads_to_the_one_that_begins_where_it_ends(format, lanes, tmp_path):
    road = read(format, getattr(large_maps, format)(lanes), tmp_path)
    assert len(road.lanes) == lanes
    numbers = {lane.id: number for number, lane in enumerate(road.lanes)}
    starts, ends = (np.array([lane.centre[end] for lane in road.lanes]) for end in (0, -1))
    for number, lane in enumerate(road.lanes):
        right = number % 2 == 1
        assert numbers.get(lane.left) == (number - 1 if right else None)
        assert numbers.get(lane.right) == (None if right else number + 1)
        after = [numbers[name] for name in lane.exits]
        np.testing.assert_allclose(starts[after], ends[number][None].repeat(len(after), axis=0), atol=1e-3)
    assert sum(len(lane.exits) for lane in road.lanes) == lanes - 2 * -(-lanes // 200)  # a street has 200 lanes
    area = drivable_area(road, ()).area
    assert area == pytest.approx(lanes * 100.0 * 3.5, rel=0.05)


def test_lanelets_are_neighbours_where_they_share_a_bound_that_runs_their_way(tmp_path):
    """The map of the other tests, whose middle line runs backwards, beside the rule as a search over all pairs."""
    file = tmp_path / "map.osm"
    file.write_text(osm(lambda x, y: (x, y)).replace("lat=", "x=").replace("lon=", "y="))
    lanes = {lane.id: lane for lane in read_lanelet2(file).lanes}
    assert (lanes["1"].left, lanes["1"].right, lanes["1"].exits) == ("2", None, ())
    assert (lanes["2"].left, lanes["2"].right, lanes["2"].exits) == (None, "1", ())
