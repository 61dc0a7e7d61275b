"""Scripts of runs in SUMO, each in a process that does one run after the other and keeps what it has compiled.

Lines of JSON go in, and one comes out for each. A process has either libsumo or traci: it cannot load both.
"""

import json
import os
import select
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

from regents_cosim.cases.shipped import network

SUPPORT = Path(__file__).parent
LIVE = SUPPORT.parent / "live"
LONGEST_S = 300.0


class RunningScript:
    """A script of tests/live; what it and SUMO say goes into a file."""

    def __init__(self, script):
        self.said = tempfile.TemporaryFile("w+")  # noqa: SIM115  as long as the process
        path = os.pathsep.join([str(SUPPORT), os.environ.get("PYTHONPATH", "")])
        self.process = subprocess.Popen(
            [sys.executable, str(LIVE / script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.said,
            text=True, env=os.environ | {"PYTHONPATH": path},
        )  # fmt: skip

    def run(self, how):
        """The result of a run; a process that hangs or dies in it is no more used."""
        self.process.stdin.write(json.dumps(how) + "\n")
        self.process.stdin.flush()
        answers, _, _ = select.select([self.process.stdout], [], [], LONGEST_S)
        line = self.process.stdout.readline() if answers else ""
        if not line:
            running.cache_clear()
            self.process.kill()
            self.process.communicate()
            self.said.seek(0)
            raise AssertionError(self.said.read()[-2000:])
        return json.loads(line)


@cache
def running(script, by="libsumo"):
    """The process for a script and a kind of connection."""
    return RunningScript(script)


def run(by="libsumo", until_s=30.0, adversary=None, **how):
    """Run the crossing, or another configuration, and return the result."""
    how = {"by": by, "until_s": until_s, "config": str(network("crossing"))} | how
    if adversary is not None:
        how["adversary"] = {"ego": "west_in.east_out.0", **adversary}
    return running("attached_run.py", "libsumo" if by == "libsumo" else "traci").run(how)
