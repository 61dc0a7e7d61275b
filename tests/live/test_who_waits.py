"""A vehicle that has just been put before a junction, standing, is foreseen to wait for those that it lets through."""

import pytest

from regents_cosim.cases.shipped import network_config
from regents_cosim.live.host.reading import SimulationReader
from regents_cosim.simulators.sumo.process import running_sumo
from regents_cosim.system.workers import local_processes, result_of, submit


def stops_of(config):
    """Whether the waiting vehicle has a line to stop at, after each of three steps; and whether SUMO says it may go."""
    found = []
    with running_sumo(["-c", str(config), "--step-length", "0.1", "--begin", "0"]) as sumo:
        for name, edge, onward, place, speed in (
            ("ego", "west_stop", "east_out", "5", "12"),
            ("waits", "south_stop", "north_out", "42", "0"),
        ):
            sumo.route.add(f"of_{name}", [edge, onward])
            sumo.vehicle.add(name, f"of_{name}", "passenger", departPos=place, departSpeed=speed)
        reader = None
        for _ in range(3):
            sumo.simulationStep()
            reader = reader or SimulationReader(sumo, 100.0)
            frame = reader.frame("ego", sumo.simulation.getTime())
            traffic = reader.traffic(frame, 8, 5.0)
            stops = traffic.users[traffic.index("waits")].path.stops
            found.append((bool(stops), bool(sumo.vehicle.getNextLinks("waits")[0][2])))
    return found


@pytest.mark.slow
def test_it_is_foreseen_to_wait_before_sumo_knows_that_it_does():
    with local_processes(1) as pool:
        (first, may_go), *later = result_of(submit(pool, stops_of, network_config("crossing")))
    assert may_go  # SUMO's answer in the step in which both departed
    assert first
    assert all(stops and not opened for stops, opened in later)
