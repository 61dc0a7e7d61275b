"""Measures an attached adversary: steps of one run without it, paused, watching and attacking, in one process.

Ratios to the bare run; replans are timed from the adversary's own calls. `pytest benchmarks/speed/test_live.py -s
--benchmark-only`.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
RUN = """
import json, os, sys, time
os.environ["LIBSUMO_AS_TRACI"] = "quiet"
import libsumo as sumo
import numpy as np
from regents_cosim.cases.shipped import network_config
from regents_cosim.live import Adversary
from regents_cosim.live.search.replanner import Replanner
from regents_cosim.mirror.programs.compile_cache import keep_compiled_programs
from regents_cosim.simulators.sumo.process import CRASHES_STAY

keep_compiled_programs()
replans = []


def timed(name):
    plain = getattr(Replanner, name)

    def call(self, *given, **more):
        idle = name == "sampled" and self._search._missed is None
        begin = time.perf_counter()
        try:
            return plain(self, *given, **more)
        finally:
            if not idle:
                replans.append(time.perf_counter() - begin)

    setattr(Replanner, name, call)


for name in ("fresh", "sampled", "renewed", "redrawn"):
    timed(name)


def run(how, net):
    options = [word for name, value in CRASHES_STAY.items() for word in (f"--{name}", value)]
    sumo.start(["sumo", "-c", str(network_config(net)), "--step-length", "0.1", "--seed", "7", *options])
    told = []
    adversary = Adversary(sumo, "passenger", judged=False, tell=told.append) if how != "bare" else None
    if how == "paused":
        adversary.pause()
    bare, ours = [], {}
    for _ in range(int(sys.argv[1])):
        begin = time.perf_counter()
        sumo.simulationStep()
        bare.append(time.perf_counter() - begin)
        if adversary is not None:
            known, state = len(replans), adversary.state
            begin = time.perf_counter()
            adversary.step()
            kind = "planning" if len(replans) > known else state
            ours.setdefault(kind, []).append(time.perf_counter() - begin)
    if adversary is not None:
        adversary.detach()
    sumo.close()
    assert not [line for line in told if "compiling once" not in line], told
    return 1e3 * float(np.mean(bare)), {kind: 1e3 * float(np.median(values)) for kind, values in ours.items()}


run("attacking", sys.argv[2])  # programs are compiled
replans.clear()
found = {how: run(how, sys.argv[2]) for how in ("bare", "paused", "attacking")}
took = 1e3 * np.array(replans)
percentiles = np.percentile(took, [50, 90, 99]).tolist() if len(took) else []
print(json.dumps({"runs": found, "replans": len(took), "replan_ms": percentiles}))
"""


def measured(steps: int, net: str) -> dict:
    """Milliseconds, of a process of its own."""
    done = subprocess.run([sys.executable, "-c", RUN, str(steps), net], capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.slow
@pytest.mark.parametrize("net", ["crossing", "grid"])
def test_live(benchmark, net):
    found = measured(600, net)
    benchmark.pedantic(measured, args=(20, net), rounds=1)
    bare, _ = found["runs"]["bare"]
    _, paused = found["runs"]["paused"]
    _, attacking = found["runs"]["attacking"]
    print(f"\n{net}: a bare step of SUMO {bare:.3f} ms; paused {paused['paused'] / bare:.2f} of it")
    for state in ("waiting", "watching", "attacking", "returning", "planning"):
        if state in attacking:
            took = attacking[state]
            print(f"  {state:10} {took:8.2f} ms a step in the median, {took / bare:8.1f} bare steps")
    if found["replan_ms"]:
        median, most, worst = found["replan_ms"]
        print(f"  {found['replans']} replans: median {median:.0f} ms, p90 {most:.0f} ms, p99 {worst:.0f} ms")
    assert paused["paused"] < 0.2
    benchmark.extra_info |= found
