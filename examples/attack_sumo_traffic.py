"""Ordinary SUMO traffic in, crashes out, each one confirmed by SUMO.

Start it with `python attack_sumo_traffic.py`, or with a .sumocfg of yours behind that.
"""

import sys
from pathlib import Path

from regents_cosim import REGENTS_FOCUSED, attack, network_config, record, replay, save_case

traffic = Path(sys.argv[1]) if len(sys.argv) > 1 else network_config("crossing")
windows = record(traffic, count=4, seed=0)
print(f"{len(windows)} windows of 8 s of {traffic.name}")

for case in attack(windows, REGENTS_FOCUSED, planner="idm"):
    found = case.attack
    if found.outcome != "collision":
        print(f"{case.id}: {found.outcome}")
        continue
    confirmed = replay(case).verified
    folder = save_case(case, Path("crashes"))
    print(f"{folder}: {found.collision.collision_type} with {found.collision.agent} at {found.collision.time_s:.1f} s, "
          f"in SUMO {'the same' if confirmed else 'not the same'}")  # fmt: skip
