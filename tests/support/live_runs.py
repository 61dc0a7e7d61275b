"""Runs of SUMO with an adversary attached, each in a process of its own."""

import json
import subprocess
import sys
from pathlib import Path

from regents_cosim.cases.shipped import network

SCRIPT = Path(__file__).parents[1] / "live" / "attached_run.py"


def run(by="libsumo", until_s=30.0, adversary=None, **how):
    """Run the crossing, or another configuration, and return the result."""
    how = {"by": by, "until_s": until_s, "config": str(network("crossing"))} | how
    if adversary is not None:
        how["adversary"] = {"ego": "west_in.east_out.0", **adversary}
    done = subprocess.run([sys.executable, str(SCRIPT), json.dumps(how)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.strip().splitlines()[-1])
