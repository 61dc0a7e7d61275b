"""Episodes one after the other in one process, as the guide has them: an adversary ends with its simulation."""

import json
import os
import subprocess
import sys

import pytest

from regents_cosim.cases.shipped import network

EPISODES = """
import gc, json, os, sys, weakref
config, by, how = sys.argv[1:]
if by == "libsumo":
    import libsumo as traci
else:
    import traci
from regents_cosim.live import Adversary

def fails(*_):
    raise SystemExit("of the user's") if how == "exits" else RuntimeError("of the user's")

binary = "sumo"
if not traci.isLibsumo():
    import sumo as installed
    binary = os.path.join(installed.SUMO_HOME, "bin", "sumo")
told, made, active, close = [], [], [], traci.close
for episode in range(4):
    command = [binary, "-c", config, "--collision.action", "warn", "--no-step-log"]
    if episode == 0 or how != "loads":
        traci.start(command)
    else:
        traci.load(command[1:])
    adversary = Adversary(
        traci, "passenger", "observed", attack_when=fails if how in ("fails", "exits") else 1e9,
        tell=fails if how == "fails" else told.append)
    made.append(weakref.ref(adversary))
    traci.addStepListener(adversary)
    for step in range(80):
        traci.simulationStep()
        states = [one().state for one in made if one() is not None]
        active.append(sum(state != "detached" for state in states))
    if how == "detached":
        adversary.detach()
    if how != "loads":
        traci.close()
        stays = adversary.step()
del adversary
if how == "loads":
    traci.close()
assert traci.close is close
gc.collect()
found = {"most": max(active), "last": active[-1], "alive": sum(one() is not None for one in made)}
print(json.dumps(found | {"told": told, "stays": how != "loads" and stays}))
"""


def run(by, how):
    env = dict(os.environ)
    env.pop("LIBSUMO_AS_TRACI", None)
    if by != "traci":
        env["LIBSUMO_AS_TRACI"] = "1" if by == "libsumo as traci" else "quiet"
    command = [sys.executable, "-c", EPISODES, str(network("crossing")), by, how]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200, env=env)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1]), done.stderr


SLOW = pytest.mark.slow
WAYS = [
    ("libsumo", "not detached"),
    ("libsumo as traci", "not detached"),
    pytest.param("libsumo", "detached", marks=SLOW),
    pytest.param("libsumo", "loads", marks=SLOW),
    pytest.param("traci", "not detached", marks=SLOW),
    pytest.param("traci", "loads", marks=SLOW),
]


@pytest.mark.slow
@pytest.mark.parametrize(("by", "how"), WAYS)
def test_one_adversary_is_active_and_the_others_are_gone(by, how):
    found, _ = run(by, how)
    assert (found["most"], found["last"]) == (1, 1)
    assert found["alive"] <= 1  # the last may wait for the step after it
    assert not found["stays"]
    assert [line for line in found["told"] if "compiling once" not in line] == []


@SLOW
@pytest.mark.parametrize("how", ["fails", "exits"])
def test_what_fails_is_said_and_ends_the_adversary_and_not_the_run(how):
    found, said = run("libsumo", how)
    assert found["last"] == 0
    told = [line for line in [*found["told"], *said.splitlines()] if "of the user's" in line]
    assert len(told) == 4
