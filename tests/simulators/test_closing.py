"""A simulation that is closed before a move is made must not bring down the next one of the process."""

import subprocess
import sys

import pytest

from regents_cosim.cases.shipped import network_config

# `moveToXY`, then `close` without a step between. The next run has the vehicle at its first step.
TWICE = """
import os, sys
os.environ["LIBSUMO_AS_TRACI"] = "quiet"
import libsumo
from traci.step import StepListener
from regents_cosim.live import Adversary
from regents_cosim.simulators.sumo.closing import tell_at_close

heard = []

class Listener(StepListener):
    def step(self, t=0):
        heard.append(libsumo.simulation.getTime())
        return True

for run in range(2):
    libsumo.start(["sumo", "-n", sys.argv[1], "-r", sys.argv[2], "--no-step-log", "true", "--step-length", "0.1"])
    if run == 0:
        libsumo.addStepListener(Listener())
        close = libsumo.close
        Adversary(libsumo, ego="ego") if sys.argv[3] == "adversary" else tell_at_close(libsumo)
        tell_at_close(libsumo)
        assert libsumo.close is close
    for step in range(60):
        libsumo.simulationStep()
    x, y = libsumo.vehicle.getPosition("v0")
    libsumo.vehicle.moveToXY("v0", "", -1, x, y, libsumo.vehicle.getAngle("v0"), 2)
    libsumo.close()
assert len(heard) == 120, heard
print("both ran")
"""
WAYS = [
    ("left0A0", "C0right0"), ("right1C1", "A1left1"), ("bottom0A0", "A2top0"), ("top2C2", "C0bottom2"),
    ("left2A2", "C2right2"), ("bottom1B0", "B2top1"), ("right2C2", "A2left2"), ("top0A2", "A0bottom0"),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("who", ["adversary", "no adversary"])
def test_the_next_simulation_of_a_process_survives_a_move_that_was_not_made(tmp_path, who):
    """What closes is the user's own code, and its listeners hear of no other simulation."""
    trips = [
        f'<trip id="v{i}" from="{WAYS[i % 8][0]}" to="{WAYS[i % 8][1]}" depart="{i // 4}"/>'
        for i in range(32)  # with fewer, a vehicle of the second run may lie where that of the first did
    ]
    routes = tmp_path / "trips.rou.xml"
    routes.write_text(f"<routes>{''.join(trips)}</routes>")
    net = network_config("grid").with_name("grid.net.xml")
    done = subprocess.run(
        [sys.executable, "-c", TWICE, str(net), str(routes), who], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-500:]
    assert "both ran" in done.stdout
