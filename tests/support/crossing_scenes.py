"""Scenes made by hand on networks of SUMO's, most of them on a crossing."""

import dataclasses
import functools

import numpy as np
from places import NETS

from regents_cosim.geometry.frames import wrap
from regents_cosim.scenario.scenario import Agent, Provenance, Scenario, Tracks
from regents_cosim.simulators.sumo.net import read_road_map

DT = 0.1
STEPS = 21
TIME = DT * np.arange(STEPS)
LANE_Y = -1.7  # of the inner lane that leads east through the crossing, whose middle is (0, 0)


@functools.cache
def road(net="crossing"):
    return read_road_map(NETS / net / f"{net}.net.xml")


@dataclasses.dataclass(frozen=True)
class Car:
    id: str
    x: np.ndarray
    y: np.ndarray
    yaw: np.ndarray
    speed: np.ndarray
    valid: np.ndarray
    length: float = 4.6
    width: float = 1.8
    kind: str = "car"


def straight(name, x, y, yaw, speed, valid=None, **size):
    along = speed * TIME
    there = np.ones(STEPS, bool) if valid is None else np.array(valid, bool)
    return Car(name, x + along * np.cos(yaw), y + along * np.sin(yaw), yaw + 0 * TIME, speed + 0 * TIME, there, **size)


def braking(name, x, speed, decel):
    """Straight east on the inner lane, to a stop."""
    time = np.minimum(TIME, speed / decel)
    there = np.ones(STEPS, bool)
    return Car(name, x + speed * time - 0.5 * decel * time**2, LANE_Y + 0 * time, 0 * time, speed - decel * time, there)


def turning(name, x, y, yaw, speed, curvature, **size):
    turned = yaw + curvature * speed * TIME
    radius = 1 / curvature
    x = x + radius * (np.sin(turned) - np.sin(yaw))
    y = y - radius * (np.cos(turned) - np.cos(yaw))
    return Car(name, x, y, wrap(turned), speed + 0 * TIME, np.ones(STEPS, bool), **size)


EGO = straight("ego", -100.0, LANE_Y, 0.0, 10.0)


def scenario(*cars, net="crossing", **changes):
    """The first is the ego, the others in the order of their ids."""
    cars = (cars[0], *sorted(cars[1:], key=lambda car: car.id))
    valid = np.stack([car.valid for car in cars])
    columns = (np.where(valid, np.stack([getattr(car, n) for car in cars]), 0.0) for n in ("x", "y", "yaw", "speed"))
    values = {
        "id": "made",
        "dt": DT,
        "agents": tuple(
            Agent(c.id, c.kind, c.length, c.width, "background" if i else "ego") for i, c in enumerate(cars)
        ),
        "tracks": Tracks(*columns, valid=valid),
        "target": (140.0, LANE_Y),
        "road": road(net),
        "provenance": Provenance("test", "made by hand", "0" * 64, 0.0),
    }
    return Scenario(**(values | changes))
