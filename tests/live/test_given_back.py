"""A vehicle that is given back drives on as its own driver would, with all that it had."""

import json
import os
import subprocess
import sys

import pytest
from live_runs import running
from places import DATA, SUPPORT, own_copy

from regents_cosim.cases.shipped import network

CITIES = {"resco_cologne3/cologne3.sumocfg": 0.0, "wildau/wildau.sumocfg": 60.0, "bologna_acosta/run.sumocfg": 120.0}
ROUNDED = 0.05


def taken(config, aside_m, count=10, step_s=0.1, after_s=0.0):
    return running("taken_by_hand.py").run([str(config), aside_m, count, step_s, after_s])


def check(found, count):
    """None has lost anything, brakes by more than its `decel`, or is gone before it arrives."""
    assert len(found) == count
    assert {one["name"]: one["lost"] for one in found if one["lost"]} == {}
    assert [one for one in found if one["braked"] > one["decel"] + ROUNDED] == []
    assert all(one["stays"] for one in found)


@pytest.mark.slow
@pytest.mark.parametrize("aside_m", [0.0, 1.0, 3.5])
def test_a_vehicle_given_back_brakes_no_harder_than_its_driver_likes(aside_m):
    check(taken(network("crossing"), aside_m), 10)


@pytest.mark.slow
def test_so_it_is_wherever_on_its_way_it_is_given_back_at_ease():
    """EIDM, the model of these vehicles, may stop within a step after it was controlled, with no vehicle ahead."""
    found = running("taken_along.py").run([str(network("grid")), 100, 1])
    assert len(found) == 100
    assert max(found) < ROUNDED


@pytest.mark.slow
@pytest.mark.parametrize("net", ["signals", "merge", "grid", "multilane", "roundabout"])
def test_so_it_is_on_every_shipped_network(net):
    check(taken(network(net), 1.0, count=5), 5)


@pytest.mark.slow
@pytest.mark.parametrize("step_s", [0.05, 0.5, 1.0])
def test_so_it_is_with_other_steps(step_s):
    check(taken(network("crossing"), 1.0, step_s=step_s), 10)


@pytest.mark.slow
@pytest.mark.parametrize("city", CITIES)
def test_so_it_is_in_cities(city, tmp_path):
    config = DATA / "sumo" / city
    if not config.exists():
        pytest.skip("no cities (set REGENTS_DATA to the folder of recordings)")
    check(taken(own_copy(config, tmp_path), 1.0, after_s=CITIES[city]), 10)


WITH_STOPS = """
import json, os, sys
if sys.argv[2] == "libsumo":
    os.environ["LIBSUMO_AS_TRACI"] = "quiet"
    import libsumo as sumo
    binary = "sumo"
else:
    os.environ.pop("LIBSUMO_AS_TRACI", None)
    import sumo as installed
    import traci as sumo
    binary = os.path.join(installed.SUMO_HOME, "bin", "sumo")
import numpy as np
from vehicle_state import differences, own, state
from regents_cosim.live.search.plan import Plan
from regents_cosim.live.host.reading import SimulationReader
from regents_cosim.live.host.vehicle_control import SumoVehicleControl

ROUTE, NAME = ("A1A0", "A0B0", "B0B1", "B1C1", "C1C0", "C0B0", "B0A0"), "bus"
STOPS = ("A0B0", 60.0, 10.0, 0), ("B1C1", 50.0, 5.0, 1), ("C0B0", 50.0, 5.0, 0)
TOLD = (0, "tripId", "T1"), (1, "line", "L7"), (1, "actType", "x y"), (1, "join", "j"), (2, "speed", "3")
sumo.start([binary, "-n", sys.argv[1], "--no-step-log", "--no-warnings", "--step-length", "0.1"])
vehicle = sumo.vehicle
sumo.route.add("line", ROUTE)
vehicle.add(NAME, "line", depart="now")
vehicle.setVia(NAME, ["B1C1"])
for edge, end_m, lasts_s, flags in STOPS:
    vehicle.setStop(NAME, edge, end_m, 0, lasts_s, flags, startPos=20.0)
for index, key, value in TOLD:
    vehicle.setStopParameter(NAME, index, key, value)
vehicle.setParameter(NAME, "known to the user", "x")
vehicle.setColor(NAME, (1, 2, 3, 4))
for _ in range(30):
    sumo.simulationStep()
found, road = state(sumo, NAME), SimulationReader(sumo, 100.0).road
control = SumoVehicleControl(sumo, NAME, vehicle.getLength(NAME), road)
here, onward = road.lane["A1A0_0"].centre, road.lane["A0left0_0"].centre
x, y = np.linspace(here[0], here[-1], 9).T if sys.argv[3] == "its way" else np.concatenate(
    [np.linspace(here[0], here[-1], 9), np.linspace(onward[0], onward[-1], 9)]).T
plan = Plan(NAME, 3.0, x, y, np.zeros(len(x)), np.ones(len(x)), 8.0)
control.follow_route_of(plan)
meanwhile = list(vehicle.getRoute(NAME))
control.give_back()
after = state(sumo, NAME)
lost = differences(own(found), own(after))
print(json.dumps({"meanwhile": meanwhile, "lost": lost, "stops": len(after["getStops"])}))
sumo.close()
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("by", "way"), [("libsumo", "its way"), ("libsumo", "another turn"), ("traci", "another turn")]
)
def test_stops_route_and_all_else_are_given_back_after_another_turn(by, way):
    net = network("grid").with_name("grid.net.xml")
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(SUPPORT), os.environ.get("PYTHONPATH", "")])}
    command = [sys.executable, "-c", WITH_STOPS, str(net), by, way]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, env=env)
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout.splitlines()[-1])
    assert ("A0left0" in found["meanwhile"]) == (way == "another turn")
    assert found["lost"] == {}
    assert found["stops"] == 3
