import gzip
import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
import shapely
from params import slow
from places import NETS

from regents_cosim.errors import RegentsError, SumoError
from regents_cosim.simulators.sumo.net import read_road_map
from regents_cosim.verdicts.law.lane_pieces import neighbours

NAMES = [
    "merge",
    "crossing",
    "signals",
    "roundabout",
    "grid",
    "multilane",
    *map(slow, ["lane_drop", "exit_lane", "town", "street"]),
]


def net_file(name: str) -> Path:
    return NETS / name / f"{name}.net.xml"


def generate(folder: Path, *options: str) -> Path:
    sumo = pytest.importorskip("sumo", reason="netgenerate comes with eclipse-sumo (the dev extra)")
    program = os.path.join(sumo.SUMO_HOME, "bin", "netgenerate")
    path = folder / "made.net.xml"
    subprocess.run([program, *options, "-o", path], check=True, capture_output=True)
    return path


@pytest.mark.parametrize("name", NAMES)
def test_a_connection_starts_where_its_lane_ends(name):
    road = read_road_map(net_file(name))
    for link in road.connections:
        gap = road.lane[link.source].centre[-1] - road.lane[link.target].centre[0]
        assert np.hypot(*gap) < 0.1, link


@pytest.mark.parametrize("name", NAMES)
def test_every_way_through_a_junction_leads_back_to_a_road(name):
    road = read_road_map(net_file(name))
    inside = [lane for lane in road.lanes if lane.junction]
    assert inside
    entered = {link.target for link in road.connections}
    for lane in inside:
        assert lane.id in entered
        while lane.junction:
            (way_out,) = road.exits[lane.id]
            lane = road.lane[way_out.target]


def test_a_left_turn_is_a_chain_of_internal_lanes():
    road = read_road_map(net_file("crossing"))
    inner = [link for link in road.connections if road.lane[link.source].junction and road.lane[link.target].junction]
    assert inner


def test_lights_stand_in_front_of_the_junction():
    path = net_file("signals")
    controlled = set(re.findall(r'<connection [^>]*tl="([^"]+)" linkIndex="(\d+)"', path.read_text()))
    road = read_road_map(path)
    lights = [link for link in road.connections if link.signal is not None]
    assert {(link.signal, str(link.link)) for link in lights} == controlled
    assert not any(road.lane[link.source].junction for link in lights)


@pytest.mark.parametrize("side", [(), ("--lefthand",)])
def test_neighbours_lie_on_the_side_they_are_called_by(tmp_path, side):
    path = generate(tmp_path, "--grid", "--grid.number", "2", "--grid.length", "100", "-L", "3", *side)
    road = read_road_map(path)
    pairs = [(lane, lane.left, 1) for lane in road.lanes] + [(lane, lane.right, -1) for lane in road.lanes]
    pairs = [(lane, road.lane[name], sign) for lane, name, sign in pairs if name]
    assert pairs
    for lane, other, sign in pairs:
        ahead = lane.centre[-1] - lane.centre[0]
        aside = other.centre[0] - lane.centre[0]
        assert sign * (ahead[0] * aside[1] - ahead[1] * aside[0]) > 0


@pytest.mark.parametrize(
    ("classes", "allowed", "side"),
    [slow("bus passenger", True, ()), ("authority emergency", False, ()), ("emergency", False, ("--lefthand",))],
)
def test_cars_change_lanes_only_where_the_network_lets_them(tmp_path, classes, allowed, side):
    path = generate(tmp_path, "--grid", "--grid.number", "2", "--grid.length", "100", "-L", "2", *side)
    before = read_road_map(path)
    at_left = {lane.id for lane in before.lanes if lane.right}
    marked = re.sub(
        r'(<lane id="([^":]+)" )',
        lambda lane: f'{lane[1]}change{"Right" if lane[2] in at_left else "Left"}="{classes}" ',
        path.read_text(),
    )
    path.write_text(marked)
    after = read_road_map(path)
    assert any(before.lane[name].right for name in before.lane)
    for lane in after.lanes:
        named = before.lane[lane.id]
        assert (lane.left, lane.right) == ((named.left, named.right) if allowed else (None, None))
    assert any(neighbours(after).values()) == allowed


@pytest.mark.parametrize("name", ["crossing", slow("signals")])
def test_no_lane_is_changed_over_the_solid_lines_of_the_shipped_networks(name):
    road = read_road_map(net_file(name))
    stops = [lane for lane in road.lanes if "_stop_" in lane.id]
    assert stops
    assert not any(lane.left or lane.right for lane in stops)
    assert any(lane.left for lane in road.lanes)


def test_one_may_leave_a_lane_over_a_line_that_keeps_others_from_coming_in(tmp_path):
    path = generate(tmp_path, "--grid", "--grid.number", "2", "--grid.length", "100", "-L", "2")
    path.write_text(path.read_text().replace('<lane id="A0A1_0" ', '<lane id="A0A1_0" changeLeft="emergency" '))
    road = read_road_map(path)
    assert road.lane["A0A1_0"].left is None
    assert road.lane["A0A1_1"].right == "A0A1_0"


def test_footpaths_and_crossings_are_left_out(tmp_path):
    grid = ("--grid", "--grid.number", "2", "--grid.length", "100", "--grid.attach-length", "50")
    walks = read_road_map(generate(tmp_path, *grid, "--sidewalks.guess", "--crossings.guess"))
    text = (tmp_path / "made.net.xml").read_text()
    assert 'function="crossing"' in text
    assert 'allow="pedestrian"' in text
    pedestrian = set(re.findall(r'<lane id="([^"]+)"[^>]* allow="pedestrian"', text))
    assert pedestrian.isdisjoint(lane.id for lane in walks.lanes)
    path = re.search(r'<lane id="[^:"]+" [^>]*allow="pedestrian"[^>]* shape="(\S+) (\S+)"', text)
    assert path
    middle = np.mean([[float(v) for v in point.split(",")] for point in path.groups()], axis=0)
    assert not walks.contains(middle[None]).any()


@pytest.mark.parametrize("name", NAMES)
def test_lanes_are_drivable_and_gaps_closed(name):
    road = read_road_map(net_file(name))
    for lane in road.lanes:
        inner = shapely.LineString(lane.centre).interpolate([0.01, 0.5, 0.99], normalized=True)
        assert road.contains(shapely.get_coordinates(inner)).all()
    for hole in getattr(road.drivable, "interiors", []):
        assert not shapely.Polygon(hole).buffer(-0.2).is_empty


def test_plain_and_packed_networks_give_the_same_map(tmp_path):
    packed = tmp_path / "merge.net.xml.gz"
    packed.write_bytes(gzip.compress(net_file("merge").read_bytes(), mtime=12345))
    plain, unpacked = read_road_map(net_file("merge")), read_road_map(packed)
    assert plain.sumo_net == unpacked.sumo_net
    assert gzip.decompress(plain.sumo_net) == net_file("merge").read_bytes()
    assert [lane.id for lane in plain.lanes] == [lane.id for lane in unpacked.lanes]
    assert plain.drivable.equals_exact(unpacked.drivable)


def test_a_network_without_internal_lanes_connects_directly(tmp_path):
    road = read_road_map(generate(tmp_path, "--grid", "--grid.number", "2", "--no-internal-links"))
    assert not any(lane.junction for lane in road.lanes)
    assert road.connections


def test_types_of_lanes_and_keys_of_maps_are_read(tmp_path):
    """What netconvert writes of a types file (-t), and of OpenStreetMap with --osm.all-attributes."""
    path = tmp_path / "x.net.xml"
    types = '<type id="t" numLanes="2"><laneType index="0" speed="10"/><restriction vClass="truck" speed="8"/></type>'
    keys = '<param key="railway:profile" value="a"/>'
    path.write_text(re.sub("(<location[^>]*/>)(.*?<lane [^/]*)/>", rf"\1{types}\2>{keys}</lane>",
                           net_file("merge").read_text(), count=1, flags=re.DOTALL))  # fmt: skip
    assert types in path.read_text()
    assert keys in path.read_text()
    assert read_road_map(path).connections == read_road_map(net_file("merge")).connections


def test_a_limit_for_cars_by_the_type_of_a_road_replaces_that_of_its_lanes(tmp_path):
    """As in SUMO: a car keeps to it, whether it is lower or higher."""
    path = generate(tmp_path, "--grid", "--grid.number", "2", "--default.speed", "20")
    limits = "".join(
        f'<type id="{name}"><restriction vClass="truck" speed="3"/>'
        f'<restriction vClass="passenger" speed="{limit}"/></type>'
        for name, limit in (("slow", 8), ("fast", 30))
    )
    named = re.sub("(<location[^>]*/>)", rf"\1{limits}", path.read_text())
    for edge, name in (("A0A1", "slow"), ("A1A0", "fast")):
        named = named.replace(f'<edge id="{edge}" ', f'<edge id="{edge}" type="{name}" ')
    path.write_text(named)
    lane = read_road_map(path).lane
    assert [lane[f"{edge}_0"].speed_limit for edge in ("A0A1", "A1A0", "B0B1")] == [8.0, 30.0, 20.0]


def test_a_network_without_lanes_for_cars_is_refused(tmp_path):
    path = tmp_path / "foot.net.xml"
    path.write_text(re.sub(r' (allow|disallow)="[^"]*"', "", net_file("merge").read_text()))
    path.write_text(path.read_text().replace("<lane ", '<lane allow="pedestrian" '))
    with pytest.raises(SumoError, match="no lane of this network allows passenger cars"):
        read_road_map(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "broken XML"),
        (b"hello", "broken XML"),
        (net_file("merge").read_bytes()[:2500], "broken XML"),
        (b"<routes/>", "not a SUMO network"),
        (b'<net version="1.20"><edge id="a" from="x" to="y"><lane id="a_0"/></edge></net>', "damaged SUMO network"),
        (gzip.compress(net_file("merge").read_bytes(), mtime=0)[:300], "gzip data is damaged or cut off"),
    ],
    ids=["empty", "no XML", "cut off", "routes", "no shape", "gzip cut off"],
)
def test_damaged_networks_give_one_clear_line(tmp_path, content, message):
    path = tmp_path / "x.net.xml"
    path.write_bytes(content)
    with pytest.raises(SumoError, match=message) as error:
        read_road_map(path)
    assert "\n" not in str(error.value)


def test_a_missing_network_is_named(tmp_path):
    with pytest.raises(RegentsError, match=r"none\.net\.xml"):
        read_road_map(tmp_path / "none.net.xml")
