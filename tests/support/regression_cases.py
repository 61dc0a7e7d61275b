"""A suite made by hand on a straight road: what a planner does there is decided by its headway alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scenes import DT, crash, moved, scene

from regents_cosim.saving import SuiteWriter
from regents_cosim.scenario.collisions import relative_speed
from regents_cosim.scenario.scenario import Scenario


def follows() -> Scenario:
    """Recorded traffic: the ego behind another car."""
    return scene((0, 0, 10), (14.6, 0, 10), name="follows")


def cuts_in(name: str, behind_leader: float, begin_s: float) -> Scenario:
    """A car moves from the left into the ego's lane, its centre so far [m] behind the leader's, within 2 s."""
    log = scene((0, 0, 10), (14.6, 0, 10), (14.6 - behind_leader, 3.2, 10), name=f"{name}-log")
    part = np.clip((DT * np.arange(log.tracks.steps) - begin_s) / 2.0, 0.0, 1.0)
    y = 3.2 * (1.0 - part**2 * (3.0 - 2.0 * part))
    case = crash(log, moved(log, 2, y=y, yaw=np.append(np.arctan2(np.diff(y), 10.0 * DT), 0.0)))
    hit = case.collision
    hit = replace(hit, relative_speed=relative_speed(case.tracks, 2, hit.step))
    return replace(case, id=name, attack=replace(case.attack, method="hand", iterations=1, collision=hit))


def squeezes_in() -> Scenario:
    """Into the gap that a headway of 1 s leaves and one of 0.5 s does not."""
    return cuts_in("squeezes_in", behind_leader=10.5, begin_s=4.0)


def pushes() -> Scenario:
    """Into the ego's side: nobody gets away."""
    return cuts_in("pushes", behind_leader=13.0, begin_s=0.5)


def write(folder: Path) -> Path:
    """The suite of all three."""
    suite = SuiteWriter(folder, 0)
    for case in (follows(), squeezes_in(), pushes()):
        suite.add(case)
    return folder
