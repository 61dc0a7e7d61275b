"""The SUMO networks that come with the project: complete, portable, alive and reproducible."""

import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import shapely
import sumolib
from params import slow
from places import NETS

from regents_cosim.cases.shipped import network_config
from regents_cosim.simulators.sumo.net import read_road_map
from regents_cosim.sources.record import record

VEHICLES_ONLY = ["merge", "crossing", "signals", "roundabout", "grid", "multilane", "lane_drop", "exit_lane"]
WITH_PERSONS = ["town", "street"]
NAMES = VEHICLES_ONLY + WITH_PERSONS
MADE = [".net.xml", ".rou.xml", ".sumocfg"]  # what build.py writes

# libsumo holds one simulation per process, so each run gets its own.
RUN = """
import json, os, sys
os.environ["LIBSUMO_AS_TRACI"] = "quiet"
import libsumo
libsumo.start(["sumo", "-c", sys.argv[1], "--no-step-log", *sys.argv[2:]])
lights = set()
for _ in range(600):
    libsumo.simulationStep()
    lights |= {libsumo.trafficlight.getRedYellowGreenState(i) for i in libsumo.trafficlight.getIDList()}
moving = sum(libsumo.vehicle.getSpeed(v) > 1 for v in libsumo.vehicle.getIDList())
walking = sum(libsumo.person.getSpeed(p) > 0.5 for p in libsumo.person.getIDList())
seen = {"time": libsumo.simulation.getTime(), "moving": moving, "walking": walking, "lights": len(lights)}
print(json.dumps(seen))
libsumo.close()
"""


def run_a_minute(name: str, *options: str) -> dict[str, float]:
    """How the network looks after its first 60 s."""
    command = [sys.executable, "-c", RUN, NETS / name / f"{name}.sumocfg", *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("name", NAMES)
def test_configuration_names_files_beside_it(name):
    root = ElementTree.parse(NETS / name / f"{name}.sumocfg").getroot()
    value = {element.tag: element.get("value") for element in root.iter() if element.get("value")}
    assert (NETS / name / value["net-file"]).is_file()
    assert (NETS / name / value["route-files"]).is_file()
    assert {k: float(value[k]) for k in ("begin", "end", "step-length", "time-to-teleport")} == {
        "begin": 0,
        "end": 600,
        "step-length": 0.1,
        "time-to-teleport": -1,
    }
    assert not [tag for tag in value if "output" in tag]


@pytest.mark.parametrize("name", VEHICLES_ONLY)
def test_network_has_passenger_and_internal_lanes(name):
    net = sumolib.net.readNet(str(NETS / name / f"{name}.net.xml"), withInternal=True)
    edges = net.getEdges(withInternal=True)
    assert any(edge.getFunction() == "internal" for edge in edges)
    lanes = [lane for edge in edges for lane in edge.getLanes()]
    assert all(lane.allows("passenger") for lane in lanes)
    assert all(3.2 <= lane.getWidth() <= 3.5 for lane in lanes)


@pytest.mark.parametrize("name", [WITH_PERSONS[0], slow(WITH_PERSONS[1])])
def test_network_has_places_for_all_who_walk_and_ride(name):
    road = read_road_map(NETS / name / f"{name}.net.xml")
    crossings = [one for one in road.walkways if one.kind == "crossing"]
    assert sum(one.signal is None for one in crossings) >= 2
    assert sum(one.signal is not None for one in crossings) == (4 if name == "town" else 0)
    net = sumolib.net.readNet(str(NETS / name / f"{name}.net.xml"))
    for edge in net.getEdges():
        lanes = edge.getLanes()  # from the kerb inwards
        may = [[kind for kind in ("pedestrian", "bicycle", "passenger") if lane.allows(kind)] for lane in lanes]
        assert may == [["pedestrian"], ["bicycle"], ["passenger"]]
        middles = [np.mean(lane.getShape(), axis=0)[None] for lane in lanes]
        assert [bool(road.contains(middle)[0]) for middle in middles] == [False, True, True]


@pytest.mark.parametrize("name", NAMES)
def test_files_tell_nothing_of_the_machine_that_made_them(name):
    for file in (NETS / name).iterdir():
        text = file.read_text()
        assert "generated on" not in text, file
        assert not re.search(r"\d{4}-\d\d-\d\d|\d\d:\d\d:\d\d", text), file
        assert not re.search(r"""(^|["'\s=])(/[A-Za-z]\w*/|[A-Za-z]:\\|~/)""", text), file


@pytest.mark.parametrize("name", NAMES)
def test_folder_is_small(name):
    assert sum(file.stat().st_size for file in (NETS / name).iterdir()) < 250_000


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("options", [(), ("--lanechange.duration", "3")], ids=["plain", "gradual-lane-changes"])
def test_traffic_is_lively_after_a_minute(name, options):
    seen = run_a_minute(name, *options)
    assert seen["time"] == pytest.approx(60)
    assert seen["moving"] >= 6
    assert name not in ("signals", "town") or seen["lights"] >= 3
    assert name not in WITH_PERSONS or seen["walking"] >= 4


@pytest.mark.slow
@pytest.mark.parametrize("name", WITH_PERSONS)
def test_windows_hold_persons_who_cross_and_cyclists(name):
    made = record(network_config(name), count=3)
    crossings = shapely.union_all([one.area for one in made[0].road.walkways if one.kind == "crossing"])
    for case in made:
        kinds = {agent.kind for agent in case.agents}
        assert {"car", "pedestrian", "bicycle"} <= kinds
        assert case.ego.kind not in ("pedestrian", "bicycle")
    crossed = [
        shapely.contains_xy(crossings, case.tracks.x[row], case.tracks.y[row]).any()
        for case in made
        for row, agent in enumerate(case.agents)
        if agent.kind == "pedestrian"
    ]
    assert sum(crossed) >= 3


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_build_gives_the_same_bytes(name, tmp_path):
    pytest.importorskip("sumo", reason="netconvert is in the eclipse-sumo wheel")
    subprocess.run([sys.executable, NETS / "build.py", name, "--out", tmp_path], check=True, timeout=120)
    for suffix in MADE:
        file = Path(name) / f"{name}{suffix}"
        assert (tmp_path / file).read_bytes() == (NETS / file).read_bytes(), f"python sumo_nets/build.py {name}"
