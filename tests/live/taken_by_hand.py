"""Takes one vehicle after the other, drives it aside, and gives it back; what it finds as JSON."""

import itertools
import math
import os

from answers import answer_lines
from vehicle_state import differences, own, state

HELD_S, WATCHED = 1.5, 20


def free_vehicle(sumo, had):
    """One that drives on with room ahead; None where there is none."""
    vehicle = sumo.vehicle
    for name in vehicle.getIDList():
        lane, leader = vehicle.getLaneID(name), vehicle.getLeader(name, 100.0)
        if name in had or vehicle.getSpeed(name) < 5.0 or lane.startswith(":"):
            continue
        left_m = sumo.lane.getLength(lane) - vehicle.getLanePosition(name)
        if left_m > 60.0 and (not leader or leader[1] > 30.0) and vehicle.getVehicleClass(name) == "passenger":
            return name
    return None


def take_over(sumo, road, name, aside_m, step_s):
    """Swerve so far aside, give back there, and watch: what it lost, its decel, and how hard it braked."""
    from regents_cosim.geometry.frames import SumoPose, from_sumo
    from regents_cosim.live.host.vehicle_control import SumoVehicleControl

    vehicle = sumo.vehicle
    before, length, speed = own(state(sumo, name)), vehicle.getLength(name), vehicle.getSpeed(name)
    x, y, yaw = (float(one) for one in from_sumo(SumoPose(*vehicle.getPosition(name), vehicle.getAngle(name)), length))
    control = SumoVehicleControl(sumo, name, length, road)
    steps = max(round(HELD_S / step_s), 2)
    for step in range(1, steps + 1):
        along, aside = speed * step_s * step, aside_m * math.sin(0.5 * math.pi * step / steps)
        place = x + along * math.cos(yaw) - aside * math.sin(yaw), y + along * math.sin(yaw) + aside * math.cos(yaw)
        control.place(*place, yaw, speed)
        sumo.simulationStep()
        control.confirm()
    control.give_back()
    found = {"name": name, "lost": differences(before, own(state(sumo, name))), "decel": vehicle.getDecel(name)}
    speeds = [vehicle.getSpeed(name)]
    for _ in range(WATCHED):
        sumo.simulationStep()
        if name not in vehicle.getIDList():
            break
        speeds.append(vehicle.getSpeed(name))
    braked = [(a - b) / step_s for a, b in itertools.pairwise(speeds)]
    stays = name in sumo.simulation.getArrivedIDList() or len(speeds) == WATCHED + 1
    return found | {"braked": max(braked, default=0.0), "stays": stays}


def run(config, aside_m, count, step_s, after_s):
    """Take so many vehicles, one after the other."""
    os.environ["LIBSUMO_AS_TRACI"] = "quiet"
    import libsumo as sumo

    from regents_cosim.live.host.reading import SimulationReader

    options = ["--no-step-log", "--no-warnings", "--step-length", str(step_s), "--collision.action", "warn"]
    sumo.start(["sumo", "-c", config, *options])
    until, found, had = sumo.simulation.getTime() + after_s + 900.0, [], set()
    while sumo.simulation.getTime() < until - 900.0:
        sumo.simulationStep()
    road = SimulationReader(sumo, 100.0).road
    while len(found) < count and sumo.simulation.getTime() < until:
        sumo.simulationStep()
        name = free_vehicle(sumo, had)
        if name is not None:
            had.add(name)
            found.append(take_over(sumo, road, name, aside_m, step_s))
    sumo.close()
    return found


if __name__ == "__main__":
    answer_lines(lambda asked: run(*asked))
