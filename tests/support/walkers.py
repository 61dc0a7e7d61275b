"""Scenes with a pedestrian or a cyclist."""

from dataclasses import replace

import numpy as np

from regents_cosim.scenario import Tracks

SIZES = {"pedestrian": (0.5, 0.6), "bicycle": (1.8, 0.65)}


def as_kind(made, agent, kind):
    """`made` with an agent of another kind and of its size."""
    length, width = SIZES[kind]
    agents = (replace(a, kind=kind, length=length, width=width) if i == agent else a for i, a in enumerate(made.agents))
    return replace(made, agents=tuple(agents))


def moved_through(tracks, agent, x, y, dt=0.1):
    """`tracks` with an agent that goes through these places, facing where it goes."""
    values = {name: np.array(getattr(tracks, name)) for name in ("x", "y", "yaw", "speed")}
    vx, vy = np.gradient(x) / dt, np.gradient(y) / dt
    for name, track in (("x", x), ("y", y), ("yaw", np.unwrap(np.arctan2(vy, vx))), ("speed", np.hypot(vx, vy))):
        values[name][agent] = track
    return Tracks(**values, valid=tracks.valid)


def walked(made, agent, x, y):
    """`made` with a pedestrian that walks through these places in place of an agent."""
    return replace(as_kind(made, agent, "pedestrian"), tracks=moved_through(made.tracks, agent, x, y))
