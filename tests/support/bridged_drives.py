"""Drives of planners behind a bridge among the tracks of a case, without the mirror."""

import numpy as np

from regents_cosim.planners.hosting.host_process import HostProcess, Snapshot
from regents_cosim.planners.interface import Placement, Scene
from regents_cosim.scenario.scenario import Scenario


def bridged_drive(process: HostProcess, case: Scenario) -> np.ndarray:
    """The ego's x, y, yaw and speed [4, time]."""
    tracks = case.tracks
    states = np.stack([tracks.x, tracks.y, tracks.yaw, tracks.speed])
    process.reset([Scene.of(case, 8.0, 0.3)])
    for step in range(tracks.steps - 1):
        (answer,) = process.act(step, [Snapshot(*states[..., step].copy(), tracks.valid[:, step])])
        placed = answer.decision
        assert isinstance(placed, Placement)
        states[:, 0, step + 1] = placed.x, placed.y, placed.yaw, placed.speed
    return states[:, 0]
