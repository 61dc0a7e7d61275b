"""Cases in the formats of other tools: what is written is read back, by our readers and by theirs."""

import csv
import gzip
import importlib.util
import itertools
import subprocess
import sys
import tempfile
import tomllib
import warnings
import xml.etree.ElementTree as ET
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
import shapely
from command import regents
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from params import slow
from scenes import absent, moving, platoon, scene
from shipped_cases import QUICKSTART, crash_on, shipped_window
from walking_town import make_town

from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import find_cases
from regents_cosim.cases.shipped import ALL_NETWORKS, network_config, shipped
from regents_cosim.cases.suite import load_suite
from regents_cosim.errors import RegentsError
from regents_cosim.exports import openscenario
from regents_cosim.exports.export import export
from regents_cosim.exports.stays import stays
from regents_cosim.geometry.frames import SumoPose, from_sumo, wrap
from regents_cosim.maps.lanelets import pieces_between, ribbon, ribbons
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.planners.interface import Scene
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.sources.fcd import record_fcd
from regents_cosim.sources.highway import record_highway
from regents_cosim.sources.logs.record import scenes_of
from regents_cosim.sources.record import record
from regents_cosim.sources.sumo import record_sumo
from regents_cosim.sources.windows import Windows

NEAR_M = 1e-3


@pytest.fixture(scope="module")
def attacked():
    """In SUMO; a vehicle leaves early."""
    return load_case(crash_on("roundabout"))


@pytest.fixture(scope="module")
def recorded():
    """In SUMO, with lights."""
    return shipped_window("signals")


@pytest.fixture(scope="module")
def walking(tmp_path_factory):
    """In SUMO, with persons."""
    town = replace(make_town(tmp_path_factory.mktemp("town")), end_s=45.0)  # until then all ids are SUMO's own
    (found,) = record(town, count=1, prefer="none", tell=lambda _: None)
    assert any(agent.kind == "pedestrian" for agent in found.agents)
    return found


@pytest.fixture(scope="module")
def highway():
    return record_highway("merge-v1", windows=Windows(count=1, seed=0))[0]


def come_and_go(case, spans):
    """The scene with everyone but the ego there only from one step to another, both included."""
    steps = np.arange(case.tracks.steps)
    return absent(case, *((row, (steps < first) | (steps > last)) for row, (first, last) in enumerate(spans, start=1)))


def apart(case, seen):
    """Largest distance [m] and turn [rad] between the case and {(agent, step): (x, y, yaw)}, the same keys in both."""
    tracks = case.tracks
    assert set(seen) == {(case.agents[i].id, k) for i, k in np.argwhere(tracks.valid).tolist()}
    row = {agent.id: i for i, agent in enumerate(case.agents)}
    at = tuple(np.array([(row[name], k) for name, k in seen]).T)
    x, y, yaw = np.array(list(seen.values())).T
    away = np.hypot(x - tracks.x[at], y - tracks.y[at])
    return away.max(), np.abs(wrap(yaw - tracks.yaw[at])).max()


def read_log(path):
    """What our own reader of logs finds: {(id, step): pose}, and its agents."""
    (found,) = [scene for _, _, scene in scenes_of(path)]
    first = round(found.begin_s / found.dt)
    poses = {
        (track.agent.id, first + int(step)): pose
        for track in found.tracks
        for step, *pose in zip(track.step, track.x, track.y, track.yaw, strict=True)
    }
    return poses, {track.agent.id: track.agent for track in found.tracks}


def check_table(case, folder):
    poses, agents = read_log(folder / "tracks.csv")
    away, turn = apart(case, poses)
    assert away < NEAR_M
    assert turn < 1e-6
    for agent in case.agents:
        if agent.id in agents:
            found = agents[agent.id]
            assert (found.kind, found.length, found.width) == (agent.kind, agent.length, agent.width)


def check_commonroad(case, folder):
    with (folder / "ids.csv").open() as file:
        names = {row["number"]: row["id"] for row in csv.DictReader(file) if row["what"] == "obstacle"}
    poses, agents = read_log(folder / "recorded.xml")
    away, turn = apart(case, {(names[number], step): pose for (number, step), pose in poses.items()})
    assert away < NEAR_M
    assert turn < 1e-6
    sizes = {agent.id: (agent.length, agent.width) for agent in case.agents}
    assert all((agent.length, agent.width) == sizes[names[number]] for number, agent in agents.items())


@pytest.mark.parametrize("name", ["attacked", "recorded", slow("highway"), slow("walking")])
def test_a_table_and_commonroad_come_back(name, request, tmp_path):
    case = request.getfixturevalue(name)
    export(case, "csv", tmp_path / "table", tell=str)
    check_table(case, tmp_path / "table")
    export(case, "commonroad", tmp_path / "commonroad")
    check_commonroad(case, tmp_path / "commonroad")


# CommonRoad's readers, ours too, take an obstacle with a single state for one that stands there all the time.
SPAN = st.tuples(st.integers(0, 9), st.integers(0, 9)).map(sorted).filter(lambda span: span[0] < span[1])


@given(seed=st.integers(0, 99), spans=st.lists(SPAN, min_size=3, max_size=3))
@settings(max_examples=8)
def test_whoever_comes_late_or_leaves_early_does_so_in_the_file(seed, spans):
    y = np.random.default_rng(seed).uniform(0, 6, 4)
    case = come_and_go(scene(*((20.0 * i, y[i], 3.0 * i) for i in range(4)), steps=10), spans)
    with tempfile.TemporaryDirectory() as folder:
        for to, check in (("csv", check_table), ("commonroad", check_commonroad)):
            export(case, to, Path(folder) / to)
            check(case, Path(folder) / to)


def test_one_who_comes_back_stays_twice():
    case = scene((0, 0, 5), (20, 0, 5), steps=10)
    found = list(stays(absent(case, (1, [0, 4, 5]))))
    assert [(stay.index, stay.first, stay.last) for stay in found] == [(0, 0, 9), (1, 1, 3), (1, 6, 9)]


def test_a_table_has_controls_where_they_are_known(attacked, tmp_path):
    export(attacked, "csv", tmp_path / "out")
    with (tmp_path / "out" / "tracks.csv").open() as file:
        rows = list(csv.DictReader(file))
    ego = [row for row in rows if row["role"] == "ego"]
    assert [float(row["accel_m_s2"]) for row in ego[:-1]] == attacked.tracks.accel[0].tolist()
    assert [float(row["curvature_1_m"]) for row in ego[:-1]] == attacked.tracks.curvature[0].tolist()
    assert ego[-1]["accel_m_s2"] == ""
    assert {row["lane"] for row in rows} <= set(attacked.road.lane)
    assert tomllib.loads((tmp_path / "out" / "tracks.toml").read_text())["ego"] == attacked.ego.id


# --- SUMO -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["attacked", "recorded", "highway", "walking"])
def test_our_own_reader_finds_the_case_in_the_fcd(name, request, tmp_path):
    case = request.getfixturevalue(name)
    export(case, "fcd", tmp_path / "out")
    log, net, types = (tmp_path / "out" / file for file in ("fcd.xml.gz", "case.net.xml.gz", "types.add.xml"))
    (found,) = record_fcd(log, net, Windows(count=1, radius_m=1e6), routes_or_types=(types,))
    look = {agent.id: (agent.kind, agent.length, agent.width) for agent in case.agents}
    assert {agent.id: (agent.kind, agent.length, agent.width) for agent in found.agents} == look
    tracks = found.tracks
    seen = {
        (found.agents[i].id, k): (tracks.x[i, k], tracks.y[i, k], tracks.yaw[i, k])
        for i, k in np.argwhere(tracks.valid).tolist()
    }
    away, turn = apart(case, seen)
    assert away < NEAR_M
    assert turn < 1e-6


@pytest.mark.parametrize("name", ["attacked", "recorded", "highway", "walking"])
def test_plain_sumo_plays_the_case(name, request, tmp_path):
    check_played(request.getfixturevalue(name), tmp_path)


@pytest.mark.parametrize("name", ["town", *map(slow, (one for one in ALL_NETWORKS if one != "town"))])
def test_plain_sumo_plays_what_is_recorded_on_every_shipped_network(name, tmp_path):
    config = SumoInput(network_config(name), end_s=100.0)
    (case,) = record_sumo(config, Windows(count=1, seed=1, prefer="none"), tell=lambda _: None)
    check_played(case, tmp_path)


def check_played(case, tmp_path):
    sumo = pytest.importorskip("sumo", reason="needs eclipse-sumo")
    if tuple(map(int, version("eclipse-sumo").split(".")[:2])) < (1, 28):
        pytest.skip("needs eclipse-sumo 1.28, the first with device.fcd-replay.files")
    export(case, "fcd", tmp_path / "out")
    program = Path(sumo.SUMO_HOME) / "bin" / "sumo"
    config = tmp_path / "out" / "case.sumocfg"
    command = [program, "-c", config, "--fcd-output", tmp_path / "seen.xml", "--precision", "6"]
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, cwd="/")
    assert (done.returncode, done.stderr) == (0, "")
    tracks, row = case.tracks, {agent.id: i for i, agent in enumerate(case.agents)}
    first = tracks.valid & ~np.pad(tracks.valid, ((0, 0), (1, 0)))[:, :-1]
    seen = set()
    for step, instant in enumerate(ET.parse(tmp_path / "seen.xml").getroot()):
        for vehicle in instant:
            i = row[vehicle.get("id")]
            pose = SumoPose(*(float(vehicle.get(key)) for key in ("x", "y", "angle")))
            x, y, _ = from_sumo(pose, case.agents[i].length)
            seen.add((i, step))
            if tracks.valid[i, step] and not first[i, step]:  # SUMO begins with everyone in the middle of a lane
                assert np.hypot(x - tracks.x[i, step], y - tracks.y[i, step]) < NEAR_M
    assert seen >= set(map(tuple, np.argwhere(tracks.valid).tolist()))


def test_pedestrians_are_persons_in_the_fcd(walking, tmp_path):
    export(walking, "fcd", tmp_path / "out")
    with gzip.open(tmp_path / "out" / "fcd.xml.gz") as file:
        root = ET.parse(file).getroot()
    on_foot = {agent.id for agent in walking.agents if agent.kind == "pedestrian"}
    assert {one.get("id") for one in root.iter("person")} == on_foot
    assert {one.get("id") for one in root.iter("vehicle")} == {agent.id for agent in walking.agents} - on_foot


def test_one_who_comes_back_on_another_lane_can_be_played(tmp_path):
    sumo = pytest.importorskip("sumo", reason="needs eclipse-sumo")
    if tuple(map(int, version("eclipse-sumo").split(".")[:2])) < (1, 28):
        pytest.skip("needs eclipse-sumo 1.28, the first with device.fcd-replay.files")
    case = come_and_go(scene((0, 0, 5), (20, 0, 5), (40, 3.2, 5), steps=10), [(0, 9), (0, 9)])
    changed = moving(case, 1, y=np.where(np.arange(10) > 5, 3.2, case.tracks.y[1]))
    export(absent(changed, (1, [4, 5])), "fcd", tmp_path / "out")
    command = [Path(sumo.SUMO_HOME) / "bin" / "sumo", "-c", tmp_path / "out" / "case.sumocfg"]
    done = subprocess.run([*map(str, command)], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def test_ids_that_sumo_does_not_take_are_changed_in_its_files_only(tmp_path):
    case = platoon()
    names = ["car_1", "car 1", "car|1", *(f"dar{k}" for k in range(3, len(case.agents)))]
    odd = replace(case, agents=tuple(replace(a, id=n) for a, n in zip(case.agents, names, strict=True)))
    export(odd, "fcd", tmp_path / "out")
    with gzip.open(tmp_path / "out" / "fcd.xml.gz") as file:
        found = {vehicle.get("id") for vehicle in ET.parse(file).getroot().iter("vehicle")}
    assert found == {"car_1", "car_1#2", "car_1#3", *names[3:]}


# --- OpenSCENARIO -----------------------------------------------------------------------------


def schema():
    """The official schema of OpenSCENARIO 1.2, which the checker of ASAM ships."""
    found = importlib.util.find_spec("qc_openscenario")
    if found is None or found.origin is None:
        pytest.skip("needs asam-qc-openscenarioxml for the schema")
    etree = pytest.importorskip("lxml.etree")
    return etree.XMLSchema(etree.parse(str(Path(found.origin).parent / "schema" / "1.2.0" / "OpenSCENARIO.xsd")))


@pytest.fixture(scope="module")
def xosc(attacked, tmp_path_factory):
    """Of a case with everybody's kind, whose second agent comes late."""
    pytest.importorskip("scenariogeneration")
    folder = tmp_path_factory.mktemp("xosc") / "out"
    kinds = ("car", "car", "truck", "pedestrian", "bicycle", "motorcycle", "bus", "other")
    agents = [replace(agent, kind=kind) for agent, kind in zip(attacked.agents, kinds, strict=False)]
    late = absent(attacked, (1, slice(7)))
    case = replace(late, agents=(*agents, *attacked.agents[len(agents) :]))
    export(case, "openscenario", folder)
    return case, folder


def test_openscenario_follows_the_schema(xosc):
    from lxml import etree

    found = schema()
    document = etree.parse(str(xosc[1] / "case.xosc"))
    assert found.validate(document), found.error_log
    document.getroot().remove(document.find("Storyboard"))
    assert not found.validate(document)


def test_openscenario_has_everyone_at_their_place_and_time(xosc):
    case, folder = xosc
    root = ET.parse(folder / "case.xosc").getroot()
    ahead = {e.get("name"): float(e.find(".//BoundingBox/Center").get("x")) for e in root.iter("ScenarioObject")}
    seen = {}
    for group in root.iter("ManeuverGroup"):
        who = group.find("Actors/EntityRef").get("entityRef")
        for vertex in group.iter("Vertex"):
            place = vertex.find("Position/WorldPosition")
            x, y, h = (float(place.get(key)) for key in ("x", "y", "h"))
            centre = (x + ahead[who] * np.cos(h), y + ahead[who] * np.sin(h), h)
            seen[who, round(float(vertex.get("time")) / case.dt)] = centre
    away, turn = apart(case, seen)
    assert away < NEAR_M
    assert turn < 1e-6
    here = {e.get("entityRef") for e in root.find("Storyboard/Init").iter("Private")}
    assert here == {a.id for a, valid in zip(case.agents, case.tracks.valid[:, 0], strict=True) if valid}
    assert sum(1 for _ in root.iter("AddEntityAction")) == sum(1 for stay in stays(case) if stay.first > 0) > 0
    gone = sum(1 for _ in root.iter("DeleteEntityAction"))
    assert gone == sum(1 for stay in stays(case) if stay.last + 1 < case.tracks.steps) > 0


def test_a_map_from_elsewhere_has_its_lanes_for_a_road(highway, tmp_path):
    pytest.importorskip("scenariogeneration")
    export(highway, "openscenario", tmp_path / "out")
    root = ET.parse(tmp_path / "out" / "case.xodr").getroot()
    roads = [road for road in root.iter("road") if road.get("junction") == "-1"]
    assert len(roads) == len(highway.road.lanes)
    lengths = sorted(float(road.get("length")) for road in roads)
    assert lengths == pytest.approx(sorted(lane.length for lane in highway.road.lanes), abs=0.1)


def test_a_map_without_lanes_goes_into_a_table_and_not_to_sumo_s_replayer(tmp_path):
    bare = replace(platoon(), road=RoadMap((), (), platoon().road.drivable))
    with (export(bare, "csv", tmp_path / "table")[0]).open() as file:
        assert {row["lane"] for row in csv.DictReader(file)} == {""}
    with pytest.raises(RegentsError, match="its map has no lanes"):
        export(bare, "fcd", tmp_path / "fcd")
    assert not (tmp_path / "fcd").exists()


def test_the_opendrive_road_lies_where_the_tracks_are(xosc):
    case, folder = xosc
    root = ET.parse(folder / "case.xodr").getroot()
    begins = np.array([[float(g.get("x")), float(g.get("y"))] for g in root.iter("geometry")])
    assert len(begins) > 10
    assert shapely.distance(case.road.drivable, shapely.points(begins)).max() < 0.5
    box = case.road.drivable.bounds
    assert np.allclose([begins[:, 0].min(), begins[:, 1].min()], box[:2], atol=5.0)
    assert str(folder.parent) not in (folder / "case.xodr").read_text()


def test_a_missing_package_is_named(attacked, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "scenariogeneration.xosc", None)
    with pytest.raises(RegentsError, match=r"\.\[openscenario\]"):
        export(attacked, "openscenario", tmp_path / "out")
    assert list(tmp_path.iterdir()) == []
    assert openscenario.rear_axle(attacked.ego) > 0


# --- CommonRoad -------------------------------------------------------------------------------


def test_a_lanelet_is_as_wide_as_its_lane():
    left, right = ribbon(np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 0.0], [10.0, 10.0]]), 3.0)
    np.testing.assert_allclose(left, [[0, 1.5], [8.5, 1.5], [8.5, 10]])
    np.testing.assert_allclose(right, [[0, -1.5], [11.5, -1.5], [11.5, 10]])


def test_lanelets_leave_no_hole_in_the_road_of_any_shipped_place():
    seen = set()
    for name in ("standard", "on_foot"):
        for case in find_cases(shipped("scenarios") / name):
            road = load_case(case).road
            if road.drivable.wkb not in seen:
                seen.add(road.drivable.wkb)
                pieces = pieces_between(road)
                covered = shapely.union_all([sides.area for sides in (*ribbons(road).values(), *pieces)])
                assert road.drivable.difference(covered).area < 1e-6, case
                for piece in pieces:
                    assert len(piece.left) == len(piece.right) >= 2
                    assert shapely.Polygon(np.concatenate([piece.left, piece.right[::-1]])).is_valid
    assert len(seen) >= 10


def most_beyond(scenario):
    """How far [m] a corner of the recorded ego is at most outside the lanelets."""
    covered = shapely.union_all(
        [one.area for one in (*ribbons(scenario.road).values(), *pieces_between(scenario.road))]
    )
    tracks, half = scenario.recorded_tracks, 0.5 * np.array([scenario.ego.length, scenario.ego.width])
    cos, sin = np.cos(tracks.yaw[0]), np.sin(tracks.yaw[0])
    corners = [
        shapely.points(tracks.x[0] + cos * ahead - sin * left, tracks.y[0] + sin * ahead + cos * left)
        for ahead, left in itertools.product(*([-value, value] for value in half))
    ]
    return float(shapely.distance(covered, corners).max())


def test_each_recorded_ego_of_a_shipped_place_lies_within_the_lanelets():
    cases = {
        (case.road.drivable.wkb, case.ego.id): case
        for name in ("standard", "on_foot")
        for case in load_suite(f"shipped:{name}")
    }
    assert all(most_beyond(case) < 1e-3 for case in cases.values() if case.road.sumo_net is not None)


@pytest.mark.slow
@pytest.mark.parametrize("environment", ["roundabout-v1", "intersection-v2", "merge-v1", "racetrack-v1"])
def test_each_recorded_ego_of_highway_env_lies_within_the_lanelets(environment):
    """Save for a hand's breadth: highway-env itself keeps no more than the centre of a car on the road."""
    for window in record(f"highway:{environment}", count=6, seed=7, tell=lambda _: None):
        assert most_beyond(window) < 0.2, window.id


@given(st.lists(st.tuples(st.floats(-40, 40), st.floats(-40, 40)), min_size=3, max_size=12), st.data())
def test_pieces_cover_any_road_with_holes(corners, data):
    area = shapely.MultiPoint(corners).convex_hull.buffer(3.0)
    for _ in range(data.draw(st.integers(0, 3))):
        x, y = data.draw(st.tuples(st.floats(-30, 30), st.floats(-30, 30)))
        area = area.difference(shapely.Point(x, y).buffer(2.0, quad_segs=3))
    assume(not area.is_empty)
    road = RoadMap((Lane("only", np.array([[-30.0, 0.0], [30.0, 1.0]]), 3.2, 13.9),), (), area)
    covered = shapely.union_all([sides.area for sides in (*ribbons(road).values(), *pieces_between(road))])
    assert area.difference(covered).area < 1e-6


def test_a_road_whose_edges_cross_falls_into_pieces():
    bow = shapely.Polygon([(0, 0), (10, 10), (10, 0), (0, 10)])
    road = RoadMap((Lane("only", np.array([[0.0, 5.0], [10.0, 5.0]]), 0.2, 13.9),), (), bow)
    covered = shapely.union_all([sides.area for sides in (*ribbons(road).values(), *pieces_between(road))])
    assert shapely.make_valid(bow).difference(covered).area < 1e-6


@pytest.mark.slow
def test_a_road_with_a_thousand_holes_in_a_row_falls_into_pieces():
    holes = [shapely.box(4 * k + 1, 1, 4 * k + 2, 2).exterior for k in range(1100)]
    road = RoadMap(
        (Lane("only", np.array([[0.0, 0.2], [4400.0, 0.2]]), 0.2, 13.9),),
        (),
        shapely.Polygon(shapely.box(0, 0, 4400, 3).exterior, holes),
    )
    covered = sum(sides.area.area for sides in (*ribbons(road).values(), *pieces_between(road)))
    assert covered == pytest.approx(road.drivable.area, rel=0.02)


def test_commonroad_has_limits_and_stop_lines(recorded, tmp_path):
    export(recorded, "commonroad", tmp_path / "out")
    root = ET.parse(tmp_path / "out" / "planning.xml").getroot()
    signs = {one.get("id"): float(one.findtext(".//additionalValue")) for one in root.findall("trafficSign")}
    assert sorted(signs.values()) == pytest.approx(sorted({lane.speed_limit for lane in recorded.road.lanes}))
    (read,) = [scene for _, _, scene in scenes_of(tmp_path / "out" / "planning.xml")]
    with (tmp_path / "out" / "ids.csv").open() as file:
        names = {row["number"]: row["id"] for row in csv.DictReader(file) if row["what"] == "lanelet"}
    limits = {names[lane.id]: lane.speed_limit for lane in read.road.lanes}
    assert limits == pytest.approx({lane.id: lane.speed_limit for lane in recorded.road.lanes})
    lit = [one for one in root.findall("lanelet") if one.find("trafficLightRef") is not None]
    assert all(one.find("stopLine/trafficLightRef") is not None for one in lit)


def test_commonroad_has_pedestrians_sidewalks_and_crosswalks(walking, tmp_path):
    export(walking, "commonroad", tmp_path / "out")
    root = ET.parse(tmp_path / "out" / "recorded.xml").getroot()
    kinds = [one.findtext("type") for one in root.iter("dynamicObstacle")]
    assert kinds.count("pedestrian") == sum(agent.kind == "pedestrian" for agent in walking.agents)
    found = [one.findtext("laneletType") for one in root.iter("lanelet")]
    for ours, theirs in (("sidewalk", "sidewalk"), ("crossing", "crosswalk")):
        assert found.count(theirs) == sum(one.kind == ours for one in walking.road.walkways) > 0
    (read,) = [scene for _, _, scene in scenes_of(tmp_path / "out" / "recorded.xml")]
    assert len(read.road.lanes) == len(walking.road.lanes)  # one drives on neither


def test_the_problem_of_commonroad_is_the_ego_s(recorded, tmp_path):
    export(recorded, "commonroad", tmp_path / "out")
    poses, _ = read_log(tmp_path / "out" / "planning.xml")
    names = {number for number, _ in poses}
    (ego,) = [name for name in names if name.startswith("ego_")]
    assert len(names) == len(recorded.agents)
    assert poses[ego, 0][:2] == pytest.approx([recorded.tracks.x[0, 0], recorded.tracks.y[0, 0]], abs=NEAR_M)
    root = ET.parse(tmp_path / "out" / "planning.xml").getroot()
    target = [float(root.find(f"planningProblem/goalState//center/{axis}").text) for axis in ("x", "y")]
    assert target == pytest.approx(recorded.target)
    kinds = [one.findtext("laneletType") for one in root.findall("lanelet")]
    assert len(kinds) == len(recorded.road.lanes) + kinds.count("border")


@pytest.fixture
def their_reader():
    """Of commonroad-io, whose import is full of warnings."""
    pytest.importorskip("commonroad", reason="commonroad-io is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from commonroad.common.file_reader import CommonRoadFileReader

        yield CommonRoadFileReader


def test_commonroad_io_reads_it(attacked, their_reader, tmp_path):
    export(attacked, "commonroad", tmp_path / "out")
    with (tmp_path / "out" / "ids.csv").open() as file:
        names = {int(row["number"]): row["id"] for row in csv.DictReader(file) if row["what"] == "obstacle"}
    for name, problems in (("recorded", 0), ("planning", 1)):
        read, problem = their_reader(str(tmp_path / "out" / f"{name}.xml")).open()
        assert len(read.lanelet_network.lanelets) == len(attacked.road.lanes) + len(pieces_between(attacked.road))
        assert len(problem.planning_problem_dict) == problems
    recorded = their_reader(str(tmp_path / "out" / "recorded.xml")).open()[0]
    poses = {
        (names[one.obstacle_id], k): (*one.state_at_time(k).position, one.state_at_time(k).orientation)
        for one in recorded.dynamic_obstacles
        for k in range(one.initial_state.time_step, (one.prediction.final_time_step if one.prediction else 0) + 1)
    }
    assert apart(attacked, poses)[0] < NEAR_M


def test_a_scene_has_its_map_for_planners_of_commonroad(recorded, their_reader):
    scene = Scene.of(recorded, 8.0, 0.2)
    network, areas = scene.commonroad(), scene.shapely()
    for number, lane in enumerate(scene.road.lanes, start=1):
        found = network.find_lanelet_by_id(number)
        assert found.center_vertices[-1] == pytest.approx(lane.centre[-1], abs=1e-6)
        assert found.polygon.shapely_object.symmetric_difference(areas[lane.id]).area < 1e-6
        links = scene.road.exits[lane.id]
        assert [scene.road.lanes[after - 1].id for after in found.successor] == [link.target for link in links]
        assert bool(found.traffic_lights) == any(link.signal for link in links)
    assert len(network.traffic_lights) > 0
    assert len(network.traffic_signs) > 0


# --- bad input --------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_command_writes_once_and_complains_on_one_line(tmp_path):
    case = crash_on("merge")
    done = regents("export", case, "--to", "csv", "-o", tmp_path / "out", code=0)
    assert {file.name for file in (tmp_path / "out").iterdir()} == {"tracks.csv", "tracks.toml"}
    for words, reason in (
        ([case, "--to", "csv", "-o", tmp_path / "out"], "is not empty"),
        ([QUICKSTART, "--to", "csv", "-o", tmp_path / "b"], "export takes one"),
        ([case, "--to", "gif", "-o", tmp_path / "b"], "--to"),
    ):
        done = regents("export", *words, code=2)
        assert reason in done.stderr
        assert len(done.stderr.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
