"""A vehicle that comes to a junction with an adversary in it is foreseen to brake, also with priority, as in SUMO."""

import numpy as np
import pytest

from regents_cosim.cases.shipped import network_config
from regents_cosim.live.attacked_ego import SumoHost
from regents_cosim.live.host.coordination import Coordination
from regents_cosim.live.predict.traffic_ahead import CarFollowingPredictor
from regents_cosim.simulators.sumo.process import running_sumo
from regents_cosim.system.workers import local_processes, result_of, submit

AHEAD_S = 4.0
STEPS = round(AHEAD_S / 0.1)
EGO = "ego", "west_in", "east_out", 0.0, 0.0
CROSSES = "crosses", "south_stop", "north_out", 42.0, 0.0


def off_ahead(config, place_m, speed_m_s, tells):
    """How far [m] one with priority is from where it is foreseen, at each step, and how fast [m/s] it is in SUMO.

    It comes from the west, so far from the begin of its lane, while another one crosses from the south without minding
    it. `tells`: whether that drive is known.
    """
    comes = "comes", "west_stop", "east_out", place_m, speed_m_s
    with running_sumo(["-c", str(config), "--step-length", "0.1", "--begin", "5000", "--end", "6000"]) as sumo:
        for name, edge, onward, place, speed in (EGO, CROSSES, comes):
            sumo.route.add(f"of_{name}", [edge, "west_stop", onward] if name == "ego" else [edge, onward])
            sumo.vehicle.add(name, f"of_{name}", "passenger", departPos=str(place), departSpeed=str(speed))
        sumo.simulationStep()
        host = SumoHost(sumo, 300.0, None, Coordination(), print)
        now = sumo.simulation.getTime()
        traffic = host.traffic(host.frame("ego", now), 8, AHEAD_S)
        rows = {user.agent.id: row for row, user in enumerate(traffic.users)}
        mover = traffic.users[rows["crosses"]]
        since = np.arange(STEPS + 1) * 0.1
        speed = np.minimum(2.5 * since, 6.0)
        way = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * 0.1)])
        yaw = np.full(STEPS + 1, mover.yaw)
        drive = np.stack([mover.x + way * np.cos(yaw), mover.y + way * np.sin(yaw), yaw, speed])
        foreseen = CarFollowingPredictor().predict(traffic.driving({"crosses": drive} if tells else {}), 0.1, STEPS + 1)
        control = host.take("crosses", mover.agent.length)
        off, driven = [], []
        for step in range(STEPS + 1):
            frame = host.frame("ego", sumo.simulation.getTime())
            k, row = frame.number["comes"], rows["comes"]
            off.append(float(np.hypot(frame.x[k] - foreseen.x[row, step], frame.y[k] - foreseen.y[row, step])))
            driven.append(float(frame.speed[k]))
            if step < STEPS:
                control.place(*drive[:, step + 1].tolist())
                sumo.simulationStep()
    return np.array(off), np.array(driven)


@pytest.fixture(scope="module")
def pool():
    with local_processes(1) as made:
        yield made


def found(pool, place_m, speed_m_s, tells=True):
    off, driven = result_of(submit(pool, off_ahead, network_config("crossing"), place_m, speed_m_s, tells))
    print(np.round([off[::5], driven[::5]], 1))
    return off, driven


@pytest.mark.slow
def test_it_is_foreseen_to_brake_for_one_that_is_in_the_junction_before_it(pool):
    off, driven = found(pool, 10.0, 11.0)
    assert driven.min() < 7.0
    assert off.max() < 3.0


@pytest.mark.slow
def test_nothing_is_foreseen_of_a_drive_that_is_not_known(pool):
    off, _ = found(pool, 10.0, 11.0, tells=False)
    assert off.max() > 6.0


@pytest.mark.slow
def test_it_is_foreseen_to_go_on_where_it_is_there_first(pool):
    off, driven = found(pool, 44.0, 11.0)
    assert driven.min() > 9.0
    assert off.max() < 1.5
