"""A script that drives vehicles along their own ways, gives each back at ease, and prints how hard they brake then."""

import math
import os
import random

from answers import answer_lines

HELD, STEP_S, WATCHED = 4, 0.1, 20  # vehicles at a time, and steps


class Driven:
    """A vehicle that is held for a while at a pace of its own, on the lanes that lie ahead of it."""

    def __init__(self, sumo, road, name, rng):
        from regents_cosim.live.host.vehicle_control import SumoVehicleControl

        self.sumo, self.name, self.length = sumo, name, sumo.vehicle.getLength(name)
        self.way, self.along = way(sumo, name), sumo.vehicle.getLanePosition(name)
        self.speed, self.accel = sumo.vehicle.getSpeed(name), rng.choice([0.0, 0.0, 1.0, -1.0, 2.0])
        self.control, self.left_s, self.speeds = (
            SumoVehicleControl(sumo, name, self.length, road),
            rng.uniform(1, 4),
            [],
        )

    def drive(self):
        """Place it for the next step; False at the end of its way."""
        self.speed = min(max(self.speed + self.accel * STEP_S, 0.0), 14.0)
        self.along, self.left_s = self.along + self.speed * STEP_S, self.left_s - STEP_S
        left = self.along
        for (x, y), (to_x, to_y) in zip(self.way, self.way[1:], strict=False):
            length = math.hypot(to_x - x, to_y - y)
            if left <= length and length > 0.0:
                c, s = (to_x - x) / length, (to_y - y) / length
                back = left - 0.5 * self.length
                self.control.place(x + back * c, y + back * s, math.atan2(s, c), self.speed)
                return True
            left -= length
        return False

    def is_ready(self):
        self.control.confirm()
        return self.left_s < 0.0 and self.control.is_at_ease()


def way(sumo, name):
    """The points of its lane and of those that follow."""
    lane, route = sumo.vehicle.getLaneID(name), list(sumo.vehicle.getRoute(name)[sumo.vehicle.getRouteIndex(name) :])
    points = list(sumo.lane.getShape(lane))
    for _ in range(3):
        ways = [one for one in sumo.lane.getLinks(lane) if one[0].rpartition("_")[0] in route[:2]]
        if not ways:
            break
        lane = ways[0][4] or ways[0][0]
        if not lane.startswith(":"):
            route = route[1:]
        points += sumo.lane.getShape(lane)
    return points


def free(sumo, held):
    """Vehicles that move on a lane before a junction, with room ahead."""
    vehicle = sumo.vehicle
    for name in sorted(set(vehicle.getIDList()) - held):
        lane, speed = vehicle.getLaneID(name), vehicle.getSpeed(name)
        leader, gap_m = vehicle.getLeader(name, 100.0) or ("", 100.0)
        closing = max(0.0, speed - vehicle.getSpeed(leader)) if leader else 0.0
        left_m = sumo.lane.getLength(lane) - vehicle.getLanePosition(name)
        if speed > 3.0 and gap_m > 8.0 + 3.0 * closing and left_m < 60.0 and not lane.startswith(":"):
            yield name


def run(config, count, seed):
    """How hard [m/s^2] each of `count` brakes after it was given back, beyond its decel."""
    os.environ["LIBSUMO_AS_TRACI"] = "quiet"
    import libsumo as sumo

    from regents_cosim.live.host.reading import SimulationReader

    options = ["--no-step-log", "--no-warnings", "--step-length", str(STEP_S), "--collision.action", "warn"]
    sumo.start(["sumo", "-c", config, "--seed", str(seed), *options])
    rng, held, since, beyond, had = random.Random(seed), {}, {}, [], set()
    for _ in range(300):
        sumo.simulationStep()
    road = SimulationReader(sumo, 100.0).road
    while len(beyond) < count and sumo.simulation.getMinExpectedNumber():
        sumo.simulationStep()
        there = set(sumo.vehicle.getIDList())
        for name in [*held, *since]:
            if name not in there:
                held.pop(name, None), since.pop(name, None)
        for name, one in list(since.items()):
            one.speeds.append(sumo.vehicle.getSpeed(name))
            if len(one.speeds) > WATCHED:
                rates = [(a - b) / STEP_S for a, b in zip(one.speeds, one.speeds[1:], strict=False)]
                beyond.append(max(rates) - sumo.vehicle.getDecel(name))
                del since[name]
        for name, one in list(held.items()):
            ready = one.is_ready()
            if ready or not one.drive():
                one.control.give_back()
                one.speeds = [sumo.vehicle.getSpeed(name)]
                since |= {name: one} if ready else {}
                del held[name]
        names = [name for name in free(sumo, had) if len(held) + len(since) < HELD]
        if names:
            name = rng.choice(names)
            had.add(name)
            held[name] = Driven(sumo, road, name, rng)
    sumo.close()
    return beyond


if __name__ == "__main__":
    answer_lines(lambda asked: run(*asked))
