"""Who comes to a junction without priority is foreseen to slow down, to let others pass, and to go on, as in SUMO."""

import numpy as np
import pytest

from regents_cosim.cases.shipped import network_config
from regents_cosim.geometry.frames import Pose, to_sumo
from regents_cosim.live.host.reading import SimulationReader
from regents_cosim.live.predict.traffic_ahead import CarFollowingPredictor
from regents_cosim.simulators.sumo.process import running_sumo
from regents_cosim.system.workers import local_processes, result_of, submit

AHEAD_S = 6.0
COMES = "comes", "south_stop", "north_out", "2", "10"


def foreseen_and_driven(config, others):
    """Distance from its place and speed of the vehicle that comes [m, m/s, time], as foreseen and as SUMO drives it."""
    steps = round(AHEAD_S / 0.1)
    with running_sumo(["-c", str(config), "--step-length", "0.1", "--begin", "5000", "--end", "6000"]) as sumo:
        for name, edge, onward, place, speed in (("ego", "north_in", "south_out", "30", "0"), COMES, *others):
            sumo.route.add(f"of_{name}", [edge, onward] if edge != "north_in" else [edge, "north_stop", onward])
            sumo.vehicle.add(name, f"of_{name}", "passenger", departPos=place, departSpeed=speed, departLane="best")
        for _ in range(3):
            sumo.simulationStep()
        reader = SimulationReader(sumo, 300.0)
        now = sumo.simulation.getTime()
        traffic = reader.traffic(reader.frame("ego", now), 8, AHEAD_S)
        row = traffic.index("comes")
        tracks = CarFollowingPredictor().predict(traffic, 0.1, steps + 1)
        nose = to_sumo(Pose(tracks.x[row], tracks.y[row], tracks.yaw[row]), traffic.users[row].agent.length)
        places, speeds = [], []
        for _ in range(steps + 1):
            places.append(sumo.vehicle.getPosition("comes"))
            speeds.append(sumo.vehicle.getSpeed("comes"))
            sumo.simulationStep()
    x, y = np.array(places).T
    first = x[0], y[0]
    return [np.hypot(nose.x - first[0], nose.y - first[1]), tracks.speed[row]], [
        np.hypot(x - first[0], y - first[1]), np.array(speeds)
    ]  # fmt: skip


@pytest.fixture(scope="module")
def pool():
    with local_processes(1) as made:
        yield made


def driven(pool, *others):
    foreseen, found = result_of(submit(pool, foreseen_and_driven, network_config("crossing"), others))
    print(np.round([foreseen[0][::10], found[0][::10], foreseen[1][::10], found[1][::10]], 1))
    return foreseen, found


@pytest.mark.slow
def test_it_slows_down_where_it_cannot_see_yet_and_then_goes(pool):
    (place, speed), (there, _) = driven(pool)
    assert speed.min() < 7.5
    assert speed[-1] > speed.min() + 1.0
    assert np.abs(place - there)[:40].max() < 1.5
    assert np.abs(place - there).max() < 6.0  # SUMO's drivers take a second to speed up again


@pytest.mark.slow
def test_it_waits_for_one_with_priority(pool):
    crossing = "first", "west_stop", "east_out", "0", "9"
    (place, speed), (there, _) = driven(pool, crossing)
    assert speed.min() < 4.0
    assert np.abs(place - there).max() < 6.0
