"""Programs of users with traci: what an adversary that does not attack leaves as it is, or reports, as JSON."""

import os

import sumo as installed
import traci
from answers import answer_lines
from given_plans import straight_on
from traci import constants as tc

from regents_cosim.live import Adversary
from regents_cosim.live.host.reading import SimulationReader

SUMO = [os.path.join(installed.SUMO_HOME, "bin", "sumo"), "--no-step-log", "--collision.action", "warn"]


def adversary(connection, told, **given):
    """One that watches the first vehicle of a type."""
    made = Adversary(connection, "passenger", "observed", attack_when=lambda _: False, tell=told.append, **given)
    traci.addStepListener(made)
    return made


def subscribes(config):
    """Subscribes to some of what is near the ego; which variables that tells in the end, and how far away."""
    told, near_m = [], 30.0
    traci.start([*SUMO, "-c", config])
    watching = adversary(traci, told)
    while not watching.ego:
        traci.simulationStep()
    ego = watching.ego
    traci.vehicle.subscribeContext(ego, tc.CMD_GET_VEHICLE_VARIABLE, near_m, [tc.VAR_SPEED, tc.VAR_ROAD_ID])
    items, farthest_m, most = set(), 0.0, 0
    for step in range(150):
        traci.simulationStep()
        found = traci.vehicle.getContextSubscriptionResults(ego)
        x, y = traci.vehicle.getPosition(ego)
        for name, values in found.items():
            other_x, other_y = traci.vehicle.getPosition(name)
            items |= set(values)
            farthest_m = max(farthest_m, ((x - other_x) ** 2 + (y - other_y) ** 2) ** 0.5)
        most = max(most, traci.vehicle.getIDCount())
        if step == 140:
            watching.detach()
    traci.close()
    own = sorted(items) == sorted([tc.VAR_SPEED, tc.VAR_ROAD_ID])
    return {"told": told, "own": own, "near": farthest_m <= near_m, "left": ego in found, "most": most}


def adds(config):
    """Subscribes to what is near the ego's lane; whether that still tells of the ego after it has left."""
    told = []
    traci.start([*SUMO, "-c", config])
    watching = adversary(traci, told)
    while not watching.ego or not traci.lane.getContextSubscriptionResults(traci.vehicle.getLaneID(watching.ego)):
        traci.simulationStep()
    lane = traci.vehicle.getLaneID(watching.ego)
    traci.lane.subscribeContext(lane, tc.CMD_GET_VEHICLE_VARIABLE, 30.0, [tc.VAR_ROAD_ID])
    while traci.vehicle.getLaneID(watching.ego) == lane:
        traci.simulationStep()
    for _ in range(5):
        traci.simulationStep()
    left = watching.ego in traci.lane.getContextSubscriptionResults(lane)
    traci.close()
    return {"told": told, "left": left}


def rows(frame):
    """Name and state of every vehicle of a frame."""
    return set(zip(frame.ids, frame.x, frame.y, frame.yaw, frame.speed, frame.z, strict=True))


def follows(config):
    """Follows each of the first vehicles for a while; how often what is seen around it was not what SUMO tells."""
    traci.start([*SUMO, "-c", config])
    reader, another, asked = (SimulationReader(traci, 60.0) for _ in range(3))
    asked._in_process = True  # it asks for each vehicle
    steps, wrong = 0, 0
    while steps < 400:
        traci.simulationStep()
        for ego in sorted(traci.vehicle.getIDList())[:1]:
            seen, shared, there = (one.frame(ego, 0.0) for one in (reader, another, asked))
            wrong += rows(seen) != rows(there) or seen.ids != shared.ids or seen.ids[0] != ego
            steps += 1
    traci.close()
    return {"wrong": wrong}


def changes(config):
    """Makes a vehicle longer and slower, and its edge, after they were seen; what is known at the next plan."""
    traci.start([*SUMO, "-c", config])
    reader = SimulationReader(traci, 60.0)
    while len(traci.vehicle.getIDList()) < 2:
        traci.simulationStep()
    ego = traci.vehicle.getIDList()[0]
    reader.traffic(reader.frame(ego, 0.0), 8, 5.0)
    traci.vehicle.setLength(ego, 9.0)
    traci.vehicle.setMaxSpeed(ego, 3.0)
    traci.edge.setMaxSpeed(traci.vehicle.getRoadID(ego), 4.0)
    known = reader.traffic(reader.frame(ego, 0.0), 8, 5.0).users[0]
    length_m = reader.frame(ego, 0.0).types[0].length
    traci.close()
    return {"length_m": length_m, "max_speed_m_s": known.following.max_speed_m_s, "limit_m_s": known.path.limit[0]}


def switches(config):
    """Drives two simulations, and calls that of the adversary by its own connection; whether it finds its ego."""
    told = []
    traci.start([*SUMO, "-c", config], label="attacked")
    watching = adversary(traci, told)
    traci.start([*SUMO, "-c", config], label="another")
    attacked = traci.getConnection("attacked")
    for _ in range(100):
        attacked.simulationStep()
    ego, there = watching.ego, attacked.vehicle.getIDList()
    for label in ("attacked", "another"):
        traci.getConnection(label).close()
    return {"told": told, "found": ego in there}


def leaps(config):
    """Lets SUMO make many steps at once."""
    told = []
    traci.start([*SUMO, "-c", config])
    watching = Adversary(traci, "passenger", "observed", tell=told.append)
    traci.addStepListener(watching)
    for second in range(2, 30):
        traci.simulationStep(float(second))
    modes = {traci.vehicle.getSpeedMode(name) for name in traci.vehicle.getIDList()}
    traci.close()
    return {"told": told, "state": watching.state, "modes": sorted(modes), "attacks": watching.tally.attacks}


def pauses(config):
    """Pauses and resumes time and again."""
    told = []
    traci.start([*SUMO, "-c", config])
    watching = adversary(traci, told)
    for step in range(100):
        traci.simulationStep()
        (watching.resume if step % 5 == 4 else watching.pause)()
    state = watching.state
    traci.close()
    return {"told": told, "state": state}


def departs(config):
    """Pauses while the ego departs, and once more; who is the ego, and the lanes that are subscribed to in the end."""
    told = []
    traci.start([*SUMO, "-c", config])
    watching = adversary(traci, told)
    traci.simulationStep()
    watching.pause()
    while not traci.vehicle.getIDList():
        traci.simulationStep()
    first = traci.vehicle.getIDList()
    for step in range(15):
        (watching.pause if step == 5 else watching.resume)()
        traci.simulationStep()
    ego = watching.ego
    watching.detach()
    traci.simulationStep()
    left = [lane for lane in traci.lane.getIDList() if traci.lane.getContextSubscriptionResults(lane)]
    traci.close()
    return {"told": told, "first": ego in first, "left": left}


def ends(config, how):
    """Pauses or detaches the adversary in one of the functions that it was given, just before it attacks."""
    told, vehicle = [], traci.vehicle
    way, where = how.split()
    traci.start([*SUMO, "-c", config])
    for _ in range(100):
        traci.simulationStep()
    ego, taken = sorted(vehicle.getIDList(), key=vehicle.getDistance)[:2]
    found = [vehicle.getSpeedMode(taken), vehicle.getLaneChangeMode(taken), *vehicle.getColor(taken)]
    vehicle.setSpeed(taken, 0.5 * vehicle.getSpeed(taken))
    for _ in range(20):
        traci.simulationStep()

    def end(line=None):
        if (line is None) == (where == "attack_when"):
            getattr(attacking, way)()
        told.extend([] if line is None else [line])
        return True

    attacking = Adversary(
        traci, ego, "observed", plan=straight_on(traci, taken), replan_s=60.0, radius_m=1000.0,
        attack_when=lambda _: end() if where == "attack_when" else True, tell=end,
    )  # fmt: skip
    traci.addStepListener(attacking)
    for _ in range(5):
        traci.simulationStep()
    left = [vehicle.getSpeedMode(taken), vehicle.getLaneChangeMode(taken), *vehicle.getColor(taken)]
    state = attacking.state
    traci.close()
    return {"told": len(told), "state": state, "same": left == found}


def commands(config):
    """Sets the speed of a vehicle that attacks, and changes it during the attack; how it is given back."""
    told, vehicle = [], traci.vehicle
    traci.start([*SUMO, "-c", config])
    for _ in range(100):
        traci.simulationStep()
    ego, taken = sorted(vehicle.getIDList(), key=vehicle.getDistance)[:2]
    vehicle.setSpeed(taken, 0.5 * vehicle.getSpeed(taken))
    for _ in range(20):
        traci.simulationStep()
    plan = straight_on(traci, taken)
    attacking = Adversary(traci, ego, "observed", plan=plan, replan_s=60.0, radius_m=1000.0, tell=told.append)
    traci.addStepListener(attacking)
    traci.simulationStep()
    held = attacking.adversary == taken
    vehicle.setSpeedMode(taken, 7)
    vehicle.setColor(taken, (1, 2, 3, 255))
    traci.simulationStep()
    attacking.pause()
    found = [vehicle.getSpeedMode(taken), vehicle.getLaneChangeMode(taken), *vehicle.getColor(taken)]
    traci.close()
    return {"told": told, "held": held, "found": found}


def looks(config):
    """Starts SUMO twice, as environments do: first for a look at its roads, then for some steps without an ego."""
    told = []
    for steps in (0, 3):
        traci.start([*SUMO, "-c", config])
        traci.addStepListener(Adversary(traci, lambda _: None, "observed", tell=told.append))
        for _ in range(steps):
            traci.simulationStep()
        traci.close()
    return {"told": told}


def restores(config, state):
    """Goes back to a state that it has saved, with an attack that is paused before."""
    told, vehicle = [], traci.vehicle
    traci.start([*SUMO, "-c", config])
    for _ in range(100):
        traci.simulationStep()
    ego, taken = sorted(vehicle.getIDList(), key=vehicle.getDistance)[:2]
    traci.simulation.saveState(state)
    plan = straight_on(traci, taken)
    attacking = Adversary(traci, ego, "observed", plan=plan, replan_s=60.0, radius_m=1000.0, tell=told.append)
    traci.addStepListener(attacking)
    for _ in range(10):
        traci.simulationStep()
    held = attacking.adversary == taken
    attacking.pause()
    traci.simulationStep()
    traci.simulation.loadState(state)
    for _ in range(10):
        traci.simulationStep()
    modes = [vehicle.getSpeedMode(taken), vehicle.getLaneChangeMode(taken)]
    traci.close()
    return {"told": told, "held": held, "modes": modes}


PROGRAMS = {
    one.__name__: one
    for one in (subscribes, adds, follows, changes, switches, leaps, pauses, departs, ends, commands, looks, restores)
}


if __name__ == "__main__":
    answer_lines(lambda asked: PROGRAMS[asked[0]](*asked[1:]))
