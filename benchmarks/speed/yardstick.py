"""Prints the CPU seconds of one value of KING's cost in plain NumPy, the least of five."""

import sys
import time
from pathlib import Path

import jax

sys.path.append(str(Path(__file__).parents[2] / "tests/support"))

from plain_numpy import cost
from timing import dense_traffic

from regents_cosim.attacks.methods.presets import KING
from regents_cosim.mirror.world import to_world

AGENTS = 16  # the world is padded to more

world = jax.tree.map(jax.device_get, to_world(dense_traffic(AGENTS)))
took = []
for _ in range(5):
    begin = time.process_time()
    cost(world, AGENTS, KING.cost.pair_weight, KING.cost.road_weight, KING.cost.pair_reach_m)
    took.append(time.process_time() - begin)
print(min(took))
