"""So many scenarios with a search each, all held on the device: 25 iterations of KING, 32 agents, one thread per core.

python benchmarks/speed/at_once.py 128
"""

import os
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "tests/support"))

from timing import STILL, attack, dense_traffic, in_threads, job

from regents_cosim.mirror.programs.compile_cache import keep_compiled_programs

keep_compiled_programs()
few = STILL.but(iterations=25)
jobs = [job(dense_traffic(32, seed=seed), "log_replay") for seed in range(int(sys.argv[1]))]
in_threads(os.cpu_count() or 1, lambda one: attack(*one, few), jobs)
