"""Plans for a vehicle of a running simulation that need no search."""

import numpy as np

from regents_cosim.geometry.frames import SumoPose, from_sumo
from regents_cosim.live.search.plan import Plan


def straight_on(sumo, name):
    """A plan to go straight on at half its speed."""
    vehicle = sumo.vehicle
    length, speed = vehicle.getLength(name), 0.5 * vehicle.getSpeed(name)
    x, y, yaw = (float(one) for one in from_sumo(SumoPose(*vehicle.getPosition(name), vehicle.getAngle(name)), length))
    way, now = speed * np.arange(81) * 0.1, sumo.simulation.getTime()
    columns = x + way * np.cos(yaw), y + way * np.sin(yaw), np.full(81, yaw), np.full(81, speed)
    return Plan(name, now, *columns, meets_s=now + 6.0)
