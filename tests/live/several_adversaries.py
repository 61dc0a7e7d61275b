"""A script with several adversaries in one run of SUMO, whose first plans are given: who holds what, as JSON."""

import os

os.environ["LIBSUMO_AS_TRACI"] = "quiet"
import libsumo as sumo
from answers import answer_lines
from given_plans import straight_on

from regents_cosim.live import Adversary


def adversary(ego, taken=None, **given):
    """One that looks for no plan of its own."""
    plan = None if taken is None else straight_on(sumo, taken)
    made = Adversary(
        sumo, ego, "observed", plan=plan, replan_s=60.0, radius_m=1000.0, tell=told.append,
        attack_when=None if plan else lambda _: False, **given,
    )  # fmt: skip
    sumo.addStepListener(made)
    return made


def steps(count, *watched):
    """So many steps; the vehicles that each of the adversaries held in any of them."""
    held = [set() for _ in watched]
    for _ in range(count):
        sumo.simulationStep()
        for one, names in zip(watched, held, strict=True):
            names.update(one.adversaries)
    return [sorted(names) for names in held]


def run(what):
    """One of the ways to have several."""
    while len(moving()) < 3:
        sumo.simulationStep()
    names = moving()[:3]
    return act(what, *names) | {"names": names}


def moving():
    """Those that are well under way, the latest first: they stay for long."""
    vehicle = sumo.vehicle
    return [v for v in reversed(vehicle.getIDList()) if vehicle.getSpeed(v) > 5.0 and vehicle.getDistance(v) < 100.0]


def act(what, ego, other, taken):
    """One of the ways to have several."""
    kind = sumo.vehicle.getTypeID(taken)
    if what == "one vehicle":
        both = adversary(ego, taken), adversary(other, taken)
        return {"held": steps(20, *both)}
    if what == "one after the other":
        first = adversary(ego, taken)
        before = steps(5, first)
        first.detach()
        return {"held": before + steps(5, adversary(other, taken))}
    if what == "ego of another":
        second = adversary(other)
        return {"held": steps(20, adversary(ego, other), second)}
    if what == "ego that comes later":
        first = adversary(ego, taken)
        before = steps(5, first)
        second = adversary(taken)
        steps(10)
        return {"held": before, "then": first.adversaries, "egos": second.egos}
    if what == "two egos":
        one = adversary([ego, other], other)
        return {"held": steps(20, one), "egos": one.egos}
    if what == "two of a type":
        one = adversary([kind, kind])
        steps(20)
        return {"egos": one.egos}
    spare = {"id": [taken], "type": kind, "flow": [taken.rpartition(".")[0]], "function": lambda name: name == taken}
    if what == "spared by another":
        second = adversary(other, spare=taken)
        return {"held": steps(20, adversary(ego, taken), second)}
    return {"held": steps(20, adversary(ego, taken, spare=spare[what]))}


told = []


def simulation(asked):
    """A run of a configuration, in one of the ways."""
    config, what = asked
    told.clear()
    sumo.start(["sumo", "-c", config, "--no-step-log", "--step-length", "0.1", "--collision.action", "warn"])
    found = run(what)
    listeners = list(sumo._stepManager._stepListeners.values())
    for one in listeners:
        one.detach()
    sumo.simulationStep()
    found["modes"] = [
        (sumo.vehicle.getSpeedMode(v), sumo.vehicle.getLaneChangeMode(v)) for v in sumo.vehicle.getIDList()
    ]
    found["left"] = len(sumo._stepManager._stepListeners)
    sumo.close()
    return found | {"told": [line for line in told if "compiling once" not in line]}


if __name__ == "__main__":
    answer_lines(simulation)
