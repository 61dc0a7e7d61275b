"""The evasion of a crash: the careful driver's drive, as a track of the ego."""

import numpy as np

from regents_cosim.judgement import ReferenceDrive
from regents_cosim.scenario import Scenario, Tracks
from regents_cosim.verdicts.careful.ego_path import EgoPositions

_LEAST_TRAVEL_M = 1e-6  # a standing vehicle has no curvature


def evasion_of(attacked: Scenario, careful: ReferenceDrive, way: EgoPositions) -> Tracks | None:
    """The ego's own track until the careful driver acts, then its `way`, with controls; None where it crashes too."""
    if not careful.avoids or careful.acts_s is None:
        return None
    own, acts = attacked.tracks, round(careful.acts_s / attacked.dt)
    driven = {
        name: np.append(getattr(own, name)[0, :acts], getattr(way, name)[acts : own.steps])[None]
        for name in ("x", "y", "yaw", "speed")
    }
    speed, yaw = driven["speed"], np.unwrap(driven["yaw"], axis=1)
    moved = 0.5 * (speed[:, :-1] + speed[:, 1:]) * attacked.dt
    turned = np.diff(yaw, axis=1)
    return Tracks(
        **driven,
        z=attacked.heights.of(0, driven["x"], driven["y"]),
        valid=own.valid[:1],
        accel=np.diff(speed, axis=1) / attacked.dt,
        curvature=np.divide(turned, moved, out=np.zeros_like(turned), where=moved > _LEAST_TRAVEL_M),
    )
