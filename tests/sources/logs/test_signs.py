"""What the maps of logs tell on giving way and on crossings, and that cases keep it."""

import json
import pickle
import xml.etree.ElementTree as ET
from collections import Counter
from dataclasses import replace

import log_files
import numpy as np
import pytest
from places import DATA
from scenes import straight_road

from regents_cosim.cases.map_files import load_map, map_files, save_map
from regents_cosim.checks.work import Work
from regents_cosim.errors import InputError
from regents_cosim.maps.walkways import Walkway
from regents_cosim.sources.logs.readers.commonroad import country_of
from regents_cosim.sources.logs.record import scenes_of
from regents_cosim.sources.logs.roads.argoverse2_map import read_map
from regents_cosim.sources.logs.roads.commonroad_signs import approaches_of
from regents_cosim.sources.logs.roads.lanelet2 import read_lanelet2
from regents_cosim.sources.logs.roads.road import build_road
from regents_cosim.sources.logs.scene import LoggedLane
from regents_cosim.sources.logs.waymo_codes import stopping


def told(lanes):
    return {lane.id: lane.approach for lane in lanes if lane.approach}


def lanelets(elements, refs):
    """Three lanelets 201 to 203 beside each other, with regulatory elements and what each lanelet refers to."""
    nodes = {(r, c): 10 * r + c + 1 for r in range(4) for c in range(2)}
    text = "".join(f'<node id="{n}" x="{50 * c}" y="{3.5 * r}"/>' for (r, c), n in nodes.items())
    for row in range(4):
        text += f'<way id="{100 + row}"><nd ref="{nodes[row, 0]}"/><nd ref="{nodes[row, 1]}"/></way>'
    for row in range(3):
        text += (
            f'<relation id="{201 + row}"><member type="way" ref="{101 + row}" role="left"/>'
            f'<member type="way" ref="{100 + row}" role="right"/><tag k="type" v="lanelet"/>'
            + "".join(f'<member type="relation" ref="{ref}" role="regulatory_element"/>' for ref in refs.get(row, ()))
            + "</relation>"
        )
    for name, (subtype, members) in elements.items():
        text += f'<relation id="{name}"><tag k="subtype" v="{subtype}"/>'
        text += "".join(f'<member type="relation" ref="{201 + row}" role="{role}"/>' for row, role in members.items())
        text += "</relation>"
    return f"<osm>{text}</osm>"


@pytest.mark.parametrize(
    ("elements", "refs", "expected"),
    [
        ({9: ("right_of_way", {0: "right_of_way", 1: "yield"})}, {}, {"201": "priority", "202": "yields"}),
        ({9: ("all_way_stop", {0: "yield", 1: "yield"})}, {}, {"201": "stops", "202": "stops"}),
        ({9: ("right_of_way", {0: "yield"}), 8: ("right_of_way", {0: "right_of_way"})}, {}, {}),
        ({9: ("right_of_way", {0: "yield"}), 8: ("traffic_light", {})}, {0: (8,)}, {}),
        ({9: ("speed_limit", {0: "yield"})}, {}, {}),
    ],
)
def test_regulatory_elements_of_lanelet2(elements, refs, expected, tmp_path):
    (tmp_path / "map.osm").write_text(lanelets(elements, refs))
    assert told(read_lanelet2(tmp_path / "map.osm").lanes) == expected


def intersection(signs, lights=(), country="DEU", elsewhere=""):
    """Two arms, lanelets 1 and 2 that lead to 11 and 12; `signs` by lanelet."""
    ids = {(lane, sign): f"{lane}{index}" for index, (lane, sign) in enumerate(signs)}
    text = "".join(
        f'<lanelet id="{lane}">'
        + "".join(f'<trafficSignRef ref="9{name}"/>' for (at, _), name in ids.items() if at == lane)
        + '<trafficLightRef ref="7"/>' * (lane in lights)
        + "</lanelet>"
        for lane in (1, 2, 11, 12)
    )
    made = [(f"9{name}", sign) for (_, sign), name in ids.items()] + [("99", elsewhere)] * bool(elsewhere)
    text += "".join(
        f'<trafficSign id="{name}"><trafficSignElement><trafficSignID>{sign}</trafficSignID></trafficSignElement>'
        "</trafficSign>"
        for name, sign in made
    )
    arms = "".join(f'<incoming><incomingLanelet ref="{n}"/><successorsStraight ref="1{n}"/></incoming>' for n in (1, 2))
    return ET.fromstring(f"<commonRoad>{text}<intersection>{arms}</intersection></commonRoad>"), country


@pytest.mark.parametrize(
    ("signs", "changes", "expected"),
    [
        ([(1, "206"), (2, "301")], {}, {"1": "yields", "11": "yields", "2": "priority", "12": "priority"}),
        ([(11, "206"), (1, "206"), (11, "301")], {}, {"1": "yields", "11": "yields"}),  # another arm's beside them
        ([(1, "R1-1")], {"country": "USA"}, {"1": "stops", "11": "stops"}),
        ([(1, "206")], {"country": "USA"}, {}),
        ([], {"elsewhere": "206"}, dict.fromkeys(("1", "11", "2", "12"), "right_first")),
        ([], {"elsewhere": "R1-1", "country": "USA"}, {}),
        ([], {}, {}),  # a map without any sign may lack those that stand there
        ([(1, "206")], {"lights": (1, 11)}, {}),
        ([], {"elsewhere": "206", "lights": (2,)}, {}),
    ],
)
def test_signs_of_commonroad(signs, changes, expected):
    assert approaches_of(*intersection(signs, **changes)) == expected


def test_the_majority_of_thousands_of_signs_decides():
    root, country = intersection([(1, "206"), (1, "301")])
    assert approaches_of(root, country) == {}
    lane = root.find("lanelet")
    lane.extend([lane.find("trafficSignRef")] * 3000)
    assert approaches_of(root, country) == {"1": "yields", "11": "yields"}


def test_signs_to_stop_of_waymo_and_scenarionet(tmp_path):
    stop = log_files.nested(8, log_files.whole(1, 77) + log_files.nested(7, log_files.whole(1, 2)))
    path = tmp_path / "one.tfrecord"
    path.write_bytes(log_files.record(log_files.waymo_scenario() + stop))
    ((_, _, found),) = scenes_of(path)
    assert told(found.road.lanes) == {"2": "stops"}


def beginning(**begins):
    """Lanes by name, each 10 m long, by the place where it begins and its direction in degrees."""
    turned = {name: (at[:2], np.deg2rad(at[2])) for name, at in begins.items()}
    return [LoggedLane(n, np.array([a, np.add(a, (10 * np.cos(t), 10 * np.sin(t)))])) for n, (a, t) in turned.items()]


@pytest.mark.parametrize(
    ("begins", "held"),
    [
        ({"right": (0, 3, 0), "second": (0.5, 6.5, 0), "third": (0, 10, 5)}, {"right", "second", "third"}),
        ({"on": (0, 3, 0), "turns": (0, 3, 60), "further": (3, 3, 0), "before": (-3, 3, 0)}, {"on"}),
        ({"oncoming": (0, 3, 180), "far": (0, 7, 0), "under": (0, 0.5, 0)}, set()),
        ({"on": (0, 3, 0), "oncoming": (0, 6.5, 180), "crossing": (0, 6.5, 90)}, {"on"}),
    ],
)
@pytest.mark.parametrize("side", [(1, 0, 0), (0, 1, 90), (-1, 0, 180)])
def test_a_sign_without_lanes_holds_those_that_begin_to_its_left(begins, held, side):
    cos, sin, turn = side
    turned = {n: (x * cos - y * sin + 50, x * sin + y * cos, yaw + turn) for n, (x, y, yaw) in begins.items()}
    assert set(told(stopping(beginning(**turned), (), [np.array([50.0, 0.0])], Work(1000)))) == held


def test_many_signs_beside_many_lanes_are_refused():
    with pytest.raises(InputError, match="lanes x signs to stop: 3,000 x 2,000"):
        stopping(beginning(on=(0, 3, 0)) * 3000, (), [np.zeros(2)] * 2000, Work(1000))
    with pytest.raises(InputError, match="lanes x lanes with a sign to stop: 3,000 x 3,000"):
        stopping(beginning(on=(0, 3, 0)) * 3000, (), [np.zeros(2)], Work(1000))


def test_places_of_signs_in_the_formats_of_waymo(tmp_path):
    begin = log_files.WEST + 1.0, -5.0  # to the right of lane 1; lane 2 lies to the left of that
    content = log_files.gpudrive(3)
    lanes = [road | {"id": 7 + k} for k, road in enumerate(one for one in content["roads"] if one["type"] == "lane")]
    content["roads"] = [*lanes, {"geometry": [{"x": begin[0], "y": begin[1]}], "type": "stop_sign"}]
    (tmp_path / "scene.json").write_text(json.dumps(content))
    sign = log_files.nested(
        8, log_files.whole(1, 77) + log_files.nested(7, log_files.nested(2, log_files.point(*begin)))
    )
    (tmp_path / "one.tfrecord").write_bytes(log_files.record(log_files.waymo_scenario() + sign))
    example = log_files.write_waymo_example(tmp_path, [begin])
    for path, expected in (("scene.json", {"7", "8"}), ("one.tfrecord", {"1", "2"}), (example.name, {"1", "2"})):
        ((_, _, found),) = scenes_of(tmp_path / path)
        assert set(told(found.road.lanes)) == expected, path


def test_a_case_keeps_what_signs_tell(tmp_path):
    plain = straight_road()
    signed = replace(plain, lanes=(replace(plain.lanes[0], approach="yields"), *plain.lanes[1:]))
    loaded = load_map(save_map(signed, tmp_path / "maps"), tmp_path / "case")
    assert told(loaded.lanes) == {"lane0": "yields"}
    assert map_files(plain) != map_files(signed)


def test_recorded_intersections():
    osm = DATA / "interaction/DR_USA_Intersection_EP0/DR_USA_Intersection_EP0.osm"
    xml = DATA / "commonroad/DEU_AachenBendplatz-1_90_T-300.xml"
    if not osm.exists() or not xml.exists():
        pytest.skip(f"no {osm} (REGENTS_DATA names the folder of recordings and cities)")
    assert Counter(told(read_lanelet2(osm).lanes).values()) == {"stops": 4, "priority": 3, "yields": 2}
    root = ET.parse(xml).getroot()
    found = approaches_of(root, country_of(root.get("benchmarkID", "")))
    assert {found.get(lane) for lane in ("14", "0", "4", "8")} == {"yields"}  # the arm with the sign to stop
    assert {found[lane] for lane in ("17", "1", "9", "12", "7", "13", "3", "11")} == {"priority"}
    assert "23" not in found
    assert np.isin(list(found.values()), ["yields", "priority"]).all()


ZEBRA = [(10.0, -3.0), (10.0, 5.0), (13.0, 5.0), (13.0, -3.0)]


def written_with_a_zebra(folder):
    """Small files of every format of which we read crossings, all with the same crossing."""
    content = log_files.gpudrive(3)
    content["roads"].append({"geometry": [{"x": x, "y": y} for x, y in ZEBRA], "type": "crosswalk"})
    (folder / "scene.json").write_text(json.dumps(content))
    ring = b"".join(log_files.nested(1, log_files.point(*p)) for p in ZEBRA)
    proto = log_files.waymo_scenario() + log_files.nested(8, log_files.whole(1, 77) + log_files.nested(8, ring))
    (folder / "one.tfrecord").write_bytes(log_files.record(proto))
    scene = log_files.scenarionet()
    scene["map_features"]["z"] = {"type": "CROSSWALK", "polygon": np.array(ZEBRA)}
    (folder / "sd_scene.pkl").write_bytes(pickle.dumps(scene, protocol=4))
    example = log_files.write_waymo_example(folder, crosswalk=ZEBRA)
    return folder / "scene.json", folder / "one.tfrecord", folder / "sd_scene.pkl", example


def test_crossings_in_the_formats_of_waymo_and_scenarionet(tmp_path):
    for path in written_with_a_zebra(tmp_path):
        ((_, _, found),) = scenes_of(path)
        (one,) = build_road(found).crossings
        assert sorted(one.shape.round(6).tolist()) == [[11.5, -3.0], [11.5, 5.0]], path.name
        assert one.width == pytest.approx(3.0)


def test_crosswalks_of_lanelets(tmp_path):
    """They are no lanes; a map without any may leave them out."""
    tags = '<tag k="subtype" v="{}"/><tag k="participant:vehicle" v="no"/>'
    for kind in ("crosswalk", "walkway"):
        text = lanelets({}, {}).replace('<relation id="203">', f'<relation id="203">{tags.format(kind)}')
        (tmp_path / f"{kind}.osm").write_text(text)
    plain = read_lanelet2(tmp_path / "walkway.osm")
    found = read_lanelet2(tmp_path / "crosswalk.osm")
    assert {lane.id for lane in found.lanes} == {lane.id for lane in plain.lanes} == {"201", "202"}
    assert plain.crossings is None
    assert [one.area for one in found.crossings] == [pytest.approx(50.0 * 3.5)]
    path = tmp_path / "a.xml"
    text = log_files.commonroad()
    path.write_text(text.replace("</lanelet>", "<laneletType>crosswalk</laneletType></lanelet>", 1))
    ((_, _, scene),) = scenes_of(path)
    assert ([lane.id for lane in scene.road.lanes], len(scene.road.crossings)) == (["2"], 1)
    path.write_text(text)
    ((_, _, scene),) = scenes_of(path)
    assert scene.road.crossings is None


@pytest.mark.parametrize(("said", "m_s"), [("50kmh", 50 / 3.6), ("25 mph", 11.176), ("13.5", 13.5), ("36 km/h", 10.0)])
def test_speed_limits_with_a_unit(said, m_s, tmp_path):
    sign = (
        '<trafficSign id="90"><trafficSignElement><trafficSignID>274</trafficSignID>'
        f"<additionalValue>{said}</additionalValue></trafficSignElement></trafficSign></commonRoad>"
    )
    text = log_files.commonroad().replace("</lanelet>", '<trafficSignRef ref="90"/></lanelet>', 1)
    (tmp_path / "a.xml").write_text(text.replace("</commonRoad>", sign))
    ((_, _, scene),) = scenes_of(tmp_path / "a.xml")
    assert [lane.speed_limit for lane in scene.road.lanes] == pytest.approx([m_s, 13.9])


def test_crossings_of_argoverse(tmp_path):
    log_files.argoverse2_map(tmp_path)
    (path,) = tmp_path.glob("*.json")
    content = json.loads(path.read_text())
    sides = [[{"x": x, "y": y, "z": 0.0} for y in (-3.0, 5.0)] for x in (10.0, 13.0)]
    for told, expected in ({"1": {"id": 1, "edge1": sides[0], "edge2": sides[1][::-1]}}, 24.0), ({}, 0.0):
        path.write_text(json.dumps(content | {"pedestrian_crossings": told}))
        found = read_map(tmp_path).crossings
        assert sum(one.area for one in found) == pytest.approx(expected)
    path.write_text(json.dumps({name: one for name, one in content.items() if name != "pedestrian_crossings"}))
    assert read_map(tmp_path).crossings is None


def test_a_case_keeps_crossings_and_that_there_are_none(tmp_path):
    plain = straight_road()
    zebra = Walkway("crossing0", "crossing", np.array([[1.0, -3.0], [1.0, 5.0]]), 3.0)
    names = set()
    for told in (None, (), (zebra,)):
        files = save_map(replace(plain, crossings=told), tmp_path / "maps")
        names.add(files.road)
        loaded = load_map(files, tmp_path / "case").crossings
        assert (loaded and loaded[0].shape.tolist()) == (told and zebra.shape.tolist())
        assert (loaded is None) == (told is None)
    assert len(names) == 3
    assert map_files(plain).road in names
