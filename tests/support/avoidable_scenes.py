"""Crashes that a driver could have avoided, or not: a lead that brakes, a car that stands or is pushed."""

from dataclasses import replace

import numpy as np
from scenes import DT, crash, platoon, scene, straight_road

from regents_cosim.collisions import first_contact

ONE_LANE, TWO_LANES = straight_road(1), straight_road(2)


def moved(made, agent, x=None, y=None, speed=None):
    """The tracks of `made` with some of one agent's replaced."""
    changed = {}
    for name, values in {"x": x, "y": y, "speed": speed}.items():
        if values is not None:
            changed[name] = np.array(getattr(made.tracks, name))
            changed[name][agent] = values
    return replace(made.tracks, **changed)


def braking_lead(gap, *others, road=ONE_LANE):
    """The ego at 15 m/s, `gap` m behind a car that brakes at 6 m/s^2 to a stop, which takes 18.75 m."""
    made = scene((0, 0, 15), (gap + 4.6, 0, 15), *others, road=road)
    time = np.minimum(DT * np.arange(81), 2.5)
    return crash(made, moved(made, 1, x=gap + 4.6 + 15 * time - 3 * time**2, speed=15 - 6 * time))


def standing_car(gap, road):
    """The ego at 20 m/s, `gap` m behind a car that stands."""
    made = scene((0, 0, 20), (gap + 4.6, 0, 20), road=road)
    return crash(made, moved(made, 1, x=gap + 4.6, speed=0.0))


def pushed(seed, drift, accel):
    """A platoon whose agents change lane and speed, each in its own way, until the ego is hit; None if it is not."""
    made, rng = platoon(seed=seed), np.random.default_rng(seed)
    time = DT * np.arange(81)
    amount = rng.uniform(-1, 1, (2, 9, 1)) * np.array([drift, accel])[:, None, None]
    speed = np.maximum(made.tracks.speed + amount[1] * time, 0.0)
    along = np.concatenate([np.zeros((9, 1)), np.cumsum(0.5 * (speed[:, 1:] + speed[:, :-1]) * DT, axis=1)], axis=1)
    side = amount[0] * (time / 8.0) ** 2
    yaw = np.arctan2(np.gradient(side, DT, axis=1), np.maximum(speed, 1.0))
    tracks = replace(made.tracks, x=made.tracks.x[:, :1] + along, y=made.tracks.y + side, yaw=yaw, speed=speed)
    return crash(made, tracks) if first_contact(made.agents, tracks) else None
