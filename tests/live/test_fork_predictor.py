"""The state run ahead in a second SUMO goes where the run itself goes."""

import json
import subprocess
import sys

import numpy as np
import pytest

from regents_cosim.cases.shipped import network_config

RUN = """
import json, os, sys
os.environ["LIBSUMO_AS_TRACI"] = "quiet"
import libsumo as sumo
import numpy as np
from regents_cosim.live.predict.fork import Fork
from regents_cosim.live.predict.traffic_ahead import CarFollowingPredictor
from regents_cosim.live.host.reading import SimulationReader

options = ["--step-length", "0.1", "--no-step-log", "--seed", "5", "--save-state.rng", "true"]
sumo.start(["sumo", "-c", sys.argv[1], *options])
while sumo.simulation.getTime() < 60.0:
    sumo.simulationStep()
reader = SimulationReader(sumo, 200.0)
ego = max(sumo.vehicle.getIDList(), key=sumo.vehicle.getSpeed)
now = lambda: float(sumo.simulation.getTime())
traffic = reader.traffic(reader.frame(ego, now()), 32, 5.0)
fork = Fork(sumo)
told = {"fork": fork.predict(traffic, 0.1, 51), "mirror": CarFollowingPredictor().predict(traffic, 0.1, 51)}
again = fork.predict(traffic, 0.1, 51)
fork.close()
missed = {name: [] for name in told}
for step in range(1, 51):
    sumo.simulationStep()
    frame = reader.frame(ego, now())
    for name, tracks in told.items():
        for row, user in enumerate(traffic.users):
            if frame is not None and user.agent.id in frame.number and tracks.valid[row, step]:
                at = frame.number[user.agent.id]
                apart = tracks.x[row, step] - frame.x[at], tracks.y[row, step] - frame.y[at]
                missed[name].append(float(np.hypot(*apart)))
print(json.dumps({"missed": missed, "same": bool(np.array_equal(told["fork"].x, again.x)),
                  "users": len(traffic.users)}))
"""


@pytest.mark.slow
def test_it_follows_the_unattacked_run():
    config = str(network_config("crossing"))
    done = subprocess.run([sys.executable, "-c", RUN, config], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["users"] > 3
    assert found["same"]
    fork, mirror = (np.array(found["missed"][name]) for name in ("fork", "mirror"))
    print({name: np.percentile(values, [50, 90, 100]).round(3) for name, values in found["missed"].items()})
    assert np.median(fork) < 0.05
    assert np.percentile(fork, 90) < 2.0
    assert np.median(fork) <= np.median(mirror)
