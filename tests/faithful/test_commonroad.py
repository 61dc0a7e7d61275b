"""CommonRoad's files as commonroad-io reads them: obstacles, shapes, signs, lines and problems."""

import math
import re
import warnings
from pathlib import Path

import log_files
import numpy as np
import pytest
import shapely
from params import slow
from places import DATA
from shapely import affinity

from regents_cosim.sources.logs.record import record_log, scenes_of
from regents_cosim.sources.logs.roads.lanelet2 import read_lanelet2
from regents_cosim.sources.logs.roads.road import may_cross, may_cross_way
from regents_cosim.sources.windows import Windows

INPUTS = Path(__file__).parent / "inputs"
SETS, SHAPES, SIGNS = (
    INPUTS / name
    for name in ("15-commonroad-sets/sets.xml", "17-commonroad-shapes/shapes.xml", "19-commonroad-signs/signs.xml")
)
PLACED_M, TURNED_RAD = 0.01, math.radians(0.1)
STATE = (
    "<initialState><position><point><x>{x}</x><y>{y}</y></point></position><orientation><exact>{yaw}</exact></orientation>"
    "<time><exact>0</exact></time></initialState>"
)
RECTANGLE = "<rectangle><length>4</length><width>2</width>{more}</rectangle>"


def scene_in(text, tmp_path):
    (tmp_path / "made.xml").write_text(text)
    ((_, _, found),) = scenes_of(tmp_path / "made.xml")
    return found


def with_obstacle(shape, tag="staticObstacle", x=10.0, y=20.0, yaw=0.0, more="", kind="car"):
    made = f"<{tag} id='70'><type>{kind}</type><shape>{shape}</shape>{STATE.format(x=x, y=y, yaw=yaw)}{more}</{tag}>"
    return log_files.commonroad().replace("<planningProblem", f"{made}<planningProblem", 1)


def boxes(scene, name="70"):
    """Where the parts of an obstacle are at first: x, y, yaw [degrees], length, width."""
    return {
        track.agent.id: (
            *(round(float(values[0]), 3) for values in (track.x, track.y)),
            round(math.degrees(track.yaw[0]), 3), round(track.agent.length, 3), round(track.agent.width, 3),
        )
        for track in scene.tracks
        if track.agent.id.partition(".")[0] == name
    }  # fmt: skip


def test_an_obstacle_known_by_sets_alone_is_not_parked(tmp_path):
    told = []
    (case,) = record_log(SETS, Windows(count=1), tell=told.append)
    assert {agent.id for agent in case.agents} == {"10", "11", "ego_200"}
    (ledger,) = (one for one in case.provenance.left_out if one.reason == "unsupported")
    assert (ledger.ids, ledger.detail) == (("13",), "known by sets alone")
    assert any("left out: obstacle 13 (known by sets alone)" in line for line in told)


@pytest.mark.parametrize(
    ("made", "detail"),
    [
        (with_obstacle(RECTANGLE.format(more=""), "dynamicObstacle"), "known at one instant alone"),
        (with_obstacle(RECTANGLE.format(more=""), "phantomObstacle"), "a phantom"),
        (
            with_obstacle(RECTANGLE.format(more=""), "environmentObstacle", kind="building"),
            "no road user, such as a building",
        ),
    ],
)
def test_what_has_no_way_of_its_own_is_said(made, detail, tmp_path):
    found = scene_in(made, tmp_path)
    assert boxes(found) == {}
    assert [(one.reason, one.ids, one.detail) for one in found.left_out] == [("unsupported", ("70",), detail)]
    assert f"left out: obstacle 70 ({detail})" in found.notes


def test_shapes_have_centres_orientations_and_corners_of_their_own():
    ((_, _, found),) = scenes_of(SHAPES)
    assert boxes(found, "14") == {"14": (100.0, -12.0, round(math.degrees(0.9), 3), 5.0, 2.0)}
    assert boxes(found, "15") == {"15": (116.0, -12.0, 0.0, 5.0, 2.0)}
    assert boxes(found, "16") == {"16": (91.0, 8.0, 0.0, 6.0, 3.0)}


def polygon(*corners):
    return "<polygon>" + "".join(f"<point><x>{x}</x><y>{y}</y></point>" for x, y in corners) + "</polygon>"


@pytest.mark.parametrize(
    ("shape", "yaw", "expected"),
    [
        (RECTANGLE.format(more="<orientation>0.5</orientation><center><x>1</x><y>2</y></center>"), 0.25,
         [(11.0, 22.0, 42.972, 4.0, 2.0)]),
        (RECTANGLE.format(more="<originXShift>-1.5</originXShift>"), math.pi / 2, [(10.0, 21.5, 90.0, 4.0, 2.0)]),
        ("<circle><radius>1.5</radius><center><x>-3</x><y>0</y></center></circle>", 1.0,
         [(7.0, 20.0, 57.296, 3.0, 3.0)]),
        (polygon((0, 0), (6, 0), (6, 2), (0, 2)), 0.0, [(13.0, 21.0, 0.0, 6.0, 2.0)]),
        (polygon((0, 0), (6, 0), (6, 2), (0, 2)), math.pi / 2, [(13.0, 21.0, 90.0, 6.0, 2.0)]),
        (polygon((0, 0), (4, 2), (3, 4), (-1, 2)), 0.0, [(11.5, 22.0, 26.565, 4.472, 2.236)]),
        (RECTANGLE.format(more="") + RECTANGLE.format(more="<center><x>-7</x><y>0</y></center>"), 0.0,
         [(10.0, 20.0, 0.0, 4.0, 2.0), (3.0, 20.0, 0.0, 4.0, 2.0)]),
    ],
)  # fmt: skip
def test_a_shape_lies_where_its_obstacle_puts_it(shape, yaw, expected, tmp_path):
    found = boxes(scene_in(with_obstacle(shape, yaw=yaw), tmp_path))
    assert list(found.values()) == expected
    assert list(found) == (["70"] if len(expected) == 1 else ["70.1", "70.2"])


def test_a_shape_that_is_no_box_is_said(tmp_path):
    found = scene_in(with_obstacle(polygon((0, 0), (6, 0), (0, 6))), tmp_path)
    assert "1 obstacles are no boxes: the smallest box around each stands for it" in found.notes


def test_a_building_beside_the_road_refuses_no_file(tmp_path):
    wall = "<rectangle><length>195</length><width>0.5</width></rectangle>"
    found = scene_in(with_obstacle(wall, y=60.0, kind="building"), tmp_path)
    assert boxes(found) == {"70": (10.0, 60.0, 0.0, 195.0, 0.5)}


# --- the map -----------------------------------------------------------------------------------


def limit(tmp_path, country, sign, value="8.33"):
    text = SIGNS.read_text().replace('"ZAM_', f'"{country}_').replace("ARG_", f"{country}_")
    text = re.sub("(<trafficSignID>).*?(</trafficSignID><additionalValue>).*?<", rf"\g<1>{sign}\g<2>{value}<", text)
    return {lane.id: lane.speed_limit for lane in scene_in(text, tmp_path).road.lanes}["1"]


def test_the_sign_of_argentina():
    ((_, _, found),) = scenes_of(SIGNS)
    assert {lane.id: lane.speed_limit for lane in found.road.lanes}["1"] == 8.33


@pytest.mark.parametrize(
    ("country", "sign"),
    [
        ("ZAM", "274"), ("ZAM", "274.1"), ("DEU", "274"), ("DEU", "274.1"), ("USA", "R2-1"), ("PRI", "R2-1"),
        ("CHN", "274"), ("ITA", "274"), ("ESP", "r301"), ("RUS", "3.24"), ("ARG", "R15"), ("BEL", "C43"),
        ("FRA", "B14"), ("GRC", "\N{GREEK CAPITAL LETTER RHO}-32"), ("GRC", "P-32"),
        ("HRV", "B31"), ("C-HRV", "B31"), ("ESP", "274"),
        ("XYZ", "274.1"),
    ],
)  # fmt: skip
def test_each_country_has_its_sign(country, sign, tmp_path):
    assert limit(tmp_path, country, sign) == 8.33


@pytest.mark.parametrize(("country", "sign"), [("DEU", "278"), ("DEU", "274.2"), ("DEU", "R15"), ("HRV", "B14")])
def test_other_signs_limit_nothing(country, sign, tmp_path):
    assert limit(tmp_path, country, sign) == 13.9


MARKINGS = {  # to the left, to the right
    **dict.fromkeys(["", "unknown", "no_marking", "dashed", "broad_dashed", "dashed_dashed"], (True, True)),
    **dict.fromkeys(["solid", "broad_solid", "solid_solid", "curb", "lowered_curb"], (False, False)),
    "solid_dashed": (True, False),
    "dashed_solid": (False, True),
}


@pytest.mark.parametrize("marking", MARKINGS)
def test_lines_bind_as_they_are_drawn(marking):
    assert (may_cross(marking, True), may_cross(marking, False)) == MARKINGS[marking]


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        ({"type": "line_thin", "subtype": "dashed"}, (True, True)),
        ({"type": "line_thick", "subtype": "solid"}, (False, False)),
        ({"type": "line_thin", "subtype": "solid_dashed"}, (True, False)),
        ({"type": "virtual"}, (True, True)),
        ({"type": "curbstone", "subtype": "low"}, (False, False)),
        ({"type": "guard_rail"}, (False, False)),
        ({"type": "line_thin", "subtype": "solid", "lane_change": "yes"}, (True, True)),
        ({"type": "line_thin", "subtype": "dashed", "lane_change:left": "no"}, (False, True)),
    ],
)
def test_ways_of_lanelet2_bind_by_their_tags(tags, expected):
    assert (may_cross_way(tags, True), may_cross_way(tags, False)) == expected


@pytest.mark.parametrize("marking", ["solid", "dashed", "solid_dashed"])
@pytest.mark.parametrize("side", ["left", "right"])
def test_a_solid_line_between_two_lanelets_keeps_apart_whichever_of_them_says_so(marking, side, tmp_path):
    text = log_files.commonroad()
    one, two = (
        m.start()
        for m in re.finditer(r"</(?:left|right)Bound>", text)
        if text[m.start() :].startswith(f"</{side}Bound>")
    )
    at = {"left": one, "right": two}[side]  # lanelet 1 lies to the right of lanelet 2
    found = scene_in(f"{text[:at]}<lineMarking>{marking}</lineMarking>{text[at:]}", tmp_path)
    lanes = {lane.id: lane for lane in found.road.lanes}
    left, right = MARKINGS[marking]
    assert (lanes["1"].left, lanes["2"].right) == ("2" if left else None, "1" if right else None)


def lanelet2(tags, backwards):
    """Two lanelets to the east; the line between them may be drawn to the west."""
    nodes = {(r, c): 10 * r + c + 1 for r in range(3) for c in range(2)}
    text = "".join(f'<node id="{n}" x="{50 * c}" y="{3.5 * r}"/>' for (r, c), n in nodes.items())
    for row in range(3):
        ends = (1, 0) if backwards and row == 1 else (0, 1)
        refs = "".join(f'<nd ref="{nodes[row, c]}"/>' for c in ends)
        said = "".join(f'<tag k="{k}" v="{v}"/>' for k, v in tags.items()) if row == 1 else ""
        text += f'<way id="{100 + row}">{refs}{said}</way>'
    for row in range(2):
        text += (
            f'<relation id="{200 + row}"><member type="way" ref="{101 + row}" role="left"/>'
            f'<member type="way" ref="{100 + row}" role="right"/><tag k="type" v="lanelet"/></relation>'
        )
    return f"<osm>{text}</osm>"


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("subtype", ["dashed", "solid", "solid_dashed"])
def test_the_line_between_two_lanelets_of_lanelet2_binds(subtype, backwards, tmp_path):
    (tmp_path / "map.osm").write_text(lanelet2({"type": "line_thin", "subtype": subtype}, backwards))
    lanes = {lane.id: lane for lane in read_lanelet2(tmp_path / "map.osm").lanes}
    left, right = MARKINGS[subtype]
    if subtype == "solid_dashed" and backwards:  # the dashed one is then on the left of who drives east
        left, right = right, left
    assert (lanes["200"].left, lanes["201"].right) == ("201" if left else None, "200" if right else None)


# --- problems ----------------------------------------------------------------------------------


def test_several_planning_problems_are_named(tmp_path):
    text = log_files.commonroad()
    one = re.search("<planningProblem.*</planningProblem>", text).group()
    found = scene_in(text.replace(one, one + one.replace('id="99"', 'id="98"')), tmp_path)
    assert found.ego == "ego_99"
    assert "2 planning problems: the ego is that of 99; left out: 98" in found.notes


# --- both readers ------------------------------------------------------------------------------


def logs():
    made = [SETS, SHAPES, SIGNS]
    others = [
        pytest.param(path, id=path.stem, marks=slow("").marks) for path in sorted((DATA / "commonroad").glob("*.xml"))
    ]
    return [*(pytest.param(path, id=path.stem) for path in made), *others]


@pytest.mark.parametrize("log", logs())
def test_both_readers_see_the_same(log):
    """Within 1 cm and 0.1 degree, and of the same size; who is missing stands in the ledger."""
    compared = compare(log)
    assert compared > 100


def compare(log):
    pytest.importorskip("commonroad", reason="commonroad-io is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from commonroad.common.file_reader import CommonRoadFileReader

        theirs, _ = CommonRoadFileReader(str(log)).open()
    ((_, _, ours),) = scenes_of(log)
    tracks = {track.agent.id: track for track in ours.tracks}
    ledger = {name for one in ours.left_out for name in one.ids}
    compared = 0
    for obstacle in theirs.obstacles:
        name = str(obstacle.obstacle_id)
        assert (name in tracks) != (name in ledger), name
        if name in tracks:
            compared += compare_obstacle(obstacle, tracks[name])
    limits = speed_limits(theirs)
    for lane in ours.road.lanes:
        assert lane.speed_limit == limits.get(lane.id, 13.9)
    return compared


def compare_obstacle(obstacle, track):
    states = {0: obstacle.initial_state}
    if obstacle.obstacle_role.value == "dynamic":
        states = {
            state.time_step: state for state in (obstacle.initial_state, *obstacle.prediction.trajectory.state_list)
        }
        assert set(track.step.tolist()) == set(states)
    for step in states:
        at = track.step.tolist().index(step)
        area = obstacle.occupancy_at_time(step).shape
        vague = states[step].is_uncertain_position or states[step].is_uncertain_orientation  # its box is all of where
        circle = hasattr(area, "radius")
        box = shapely.envelope(area.shapely_object) if circle else shapely.oriented_envelope(area.shapely_object)
        own = box_of(track, at)
        assert own.centroid.distance(box.centroid) < PLACED_M
        assert vague or circle or shapely.hausdorff_distance(own, box) < 2.0 * PLACED_M
        if hasattr(area, "orientation"):
            assert abs(math.remainder(track.yaw[at] - area.orientation, 2.0 * math.pi)) < TURNED_RAD
    return len(states)


def box_of(track, at):
    half = 0.5 * np.array([track.agent.length, track.agent.width])
    ring = [(x, y) for x, y in half * [(1, 1), (-1, 1), (-1, -1), (1, -1)]]
    turned = affinity.rotate(shapely.Polygon(ring), track.yaw[at], origin=(0, 0), use_radians=True)
    return affinity.translate(turned, track.x[at], track.y[at])


def speed_limits(theirs):
    """By the library's own table of signs (its interpreter knows fewer countries)."""
    signs = {
        sign.traffic_sign_id: [
            float(part.additional_values[0])
            for part in sign.traffic_sign_elements
            if part.traffic_sign_element_id.name in ("MAX_SPEED", "MAX_SPEED_ZONE_START")
        ]
        for sign in theirs.lanelet_network.traffic_signs
    }
    limits = {
        str(lane.lanelet_id): [limit for number in lane.traffic_signs for limit in signs[number]]
        for lane in theirs.lanelet_network.lanelets
    }
    return {name: min(values) for name, values in limits.items() if values}
