"""A vehicle that is driven out of a junction another way than its route goes."""

import json
import subprocess
import sys

import pytest

from regents_cosim.cases.shipped import network_config

RUN = """
import json, os, sys
os.environ["LIBSUMO_AS_TRACI"] = "quiet"
import libsumo as sumo
import numpy as np
import shapely
from regents_cosim.geometry.frames import SumoPose, from_sumo
from regents_cosim.live.predict.paths import BEHIND_M, LaneChains, path_along
from regents_cosim.live.search.plan import Plan
from regents_cosim.live.host.reading import SimulationReader
from regents_cosim.live.host.vehicle_control import SumoVehicleControl

NAME, SPEED, WAY_M = "west_in.east_out.5", 6.0, 22.0
vehicle = sumo.vehicle

def to_line():
    return sumo.lane.getLength(vehicle.getLaneID(NAME)) - vehicle.getLanePosition(NAME)

def nose():
    place = vehicle.getPosition(NAME)
    return place, float(from_sumo(SumoPose(*place, vehicle.getAngle(NAME)), 5.0).yaw)

sumo.start(["sumo", "-c", sys.argv[1], "--step-length", "0.1", "--no-step-log", "--collision.action", "warn"])
while NAME not in vehicle.getIDList() or vehicle.getRoadID(NAME) != "west_stop" or to_line() > 3.0:
    sumo.simulationStep()
reader = SimulationReader(sumo, 100.0)
road, length = reader.road, vehicle.getLength(NAME)
ways = [(link.target, *LaneChains(road).out_of_junction(link.target)) for link in road.exits[vehicle.getLaneID(NAME)]]
turn = [road.lane[name] for name in next(way for way in ways if way[-1].startswith("north_out"))]
lanes = [road.lane[vehicle.getLaneID(NAME)], *turn]
points = path_along(lanes, vehicle.getLanePosition(NAME), *nose(), SPEED, 60.0).points[BEHIND_M - int(length / 2):]
along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
x, y = (np.interp(np.arange(0.0, WAY_M, SPEED * 0.1), along, values) for values in points.T)
yaw, now = np.unwrap(np.arctan2(np.gradient(y), np.gradient(x))), sumo.simulation.getTime()
plan = Plan(NAME, now, x, y, yaw, np.full(len(x), SPEED), now + 2.0)
control = SumoVehicleControl(sumo, NAME, length, road)
if sys.argv[2] == "route too":
    control.follow_route_of(plan)
route, lost = list(vehicle.getRoute(NAME)), False
for _ in x[1:]:
    control.place(*plan.at(sumo.simulation.getTime() + 0.1))
    sumo.simulationStep()
    control.confirm()
    lost |= not vehicle.getLaneID(NAME)
ahead = shapely.Point(reader.routes.path(NAME, *nose(), SPEED, 5.0).points[BEHIND_M + 15])
off_m = shapely.LineString(turn[-1].centre).distance(ahead)
control.give_back()
arrived = False
while not arrived and sumo.simulation.getTime() < now + 120.0:
    sumo.simulationStep()
    arrived = NAME in sumo.simulation.getArrivedIDList()
print(json.dumps({"route": route, "lost": lost, "off_m": off_m, "arrived": arrived}))
"""


def run(how):
    done = subprocess.run(
        [sys.executable, "-c", RUN, str(network_config("crossing")), how], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.slow
def test_its_route_goes_there_too_though_its_plan_ends_in_the_junction():
    found = run("route too")
    assert found["route"][-1] == "north_out"
    assert not found["lost"]
    assert found["arrived"]


@pytest.mark.slow
def test_where_sumo_has_it_on_no_lane_it_is_led_along_that_which_runs_under_it():
    found = run("place alone")
    assert found["lost"]
    assert found["off_m"] < 0.5
    assert found["arrived"]
