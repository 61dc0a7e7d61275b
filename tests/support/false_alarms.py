"""How often the reference planners brake hard, in closed loop, in traffic that no one attacks.

python tests/support/false_alarms.py FOLDER ...    as `regents record` makes them, one line for each

Counted are windows in which the planner brakes with more than 4 m/s^2, of those in which IDM, which drives the same way
until a model sees a danger, neither does so nor collides.
"""

import sys
from pathlib import Path

import numpy as np

from regents_cosim.cases.suite import load_suite
from regents_cosim.collisions import first_contact
from regents_cosim.evaluation.statistics import percent_interval
from regents_cosim.replays.mirror import MirrorController
from regents_cosim.scenario import Scenario

DRIVERS = ("careful", "fuzzy", "rss")
HARD_M_S2 = 4.0


def calm(mirror_driver: MirrorController, window: Scenario) -> bool:
    """Whether the planner drives through a window without hard braking and without a collision."""
    tracks = mirror_driver.drive(window).tracks
    braking = -np.diff(tracks.speed[0]) / window.dt
    return bool((braking <= HARD_M_S2 + 1e-3).all()) and first_contact(window.agents, tracks) is None


def false_alarms(windows: list[Scenario]) -> tuple[int, dict[str, int]]:
    """Count the windows in which IDM drives calmly, and those of them in which a reference planner does not."""
    with MirrorController("idm") as mirror_driver:
        ordinary = [window for window in windows if calm(mirror_driver, window)]
    found = dict[str, int]()
    for driver in DRIVERS:
        with MirrorController(driver) as mirror_driver:
            found[driver] = sum(not calm(mirror_driver, window) for window in ordinary)
    return len(ordinary), found


if __name__ == "__main__":
    for folder in map(Path, sys.argv[1:]):
        windows = [case.before_attack() for case in load_suite(folder)]
        ordinary, found = false_alarms(windows)
        intervals = {name: "{:.0f} to {:.0f} %".format(*percent_interval(n, ordinary)) for name, n in found.items()}
        shares = ", ".join(f"{name} {count} ({intervals[name]})" for name, count in found.items())
        print(f"{folder.name}: {ordinary} of {len(windows)} windows; {shares}", flush=True)
