"""A user's own script: SUMO by libsumo or traci, with an adversary or without one, once for each line of the input.

What is asked for and what became of it are lines of JSON.
"""

import os

from answers import answer_lines

LOOKED_AT_S = 10.0  # after what a user did to an attack


def disturb(sumo, ego, change):
    """Do what a user may do to their own ego during an attack."""
    if change == "park":
        sumo.vehicle.setSpeed(ego, 0.0)
    else:
        sumo.vehicle.moveTo(ego, sumo.vehicle.getRoute(ego)[-1] + "_0", 50.0)


def run(how):
    """Run the crossing as told; what there is to say afterwards."""
    if how["by"] == "libsumo":
        os.environ["LIBSUMO_AS_TRACI"] = "quiet"
        import libsumo as sumo

        binary = "sumo"
    else:
        os.environ.pop("LIBSUMO_AS_TRACI", None)  # of a test before that loaded libsumo
        import sumo as installed
        import traci as sumo

        binary = os.path.join(installed.SUMO_HOME, "bin", "sumo")
    command = [binary, "-c", how["config"], "--no-step-log", "--seed", str(how.get("seed", 1)), *how.get("options", [])]
    if how["by"] == "labelled":
        sumo.start(command, label="mine")
        sumo = sumo.getConnection("mine")
    else:
        sumo.start(command)
    told, adversary = [], None
    if "adversary" in how:
        from regents_cosim.live import Adversary
        from regents_cosim.live.settings import live_config
        from regents_cosim.mirror.programs.compile_cache import keep_compiled_programs

        keep_compiled_programs()
        given = dict(how["adversary"])
        if given.pop("never", False):
            given["attack_when"] = lambda _: False
        if not given.pop("samples", True):
            given["method"] = live_config("focused-live", samples=False)
        adversary = Adversary(sumo, tell=told.append, **given)
        for _ in range(how.get("added", 1)):
            sumo.addStepListener(adversary)
        if how.get("paused"):
            adversary.pause()
    states, removed, raised, wheel = [], None, None, None
    if how.get("driven"):  # by a planner, as a user would
        from regents_cosim.live.episodes import PlannerController
        from regents_cosim.planners.controllers import PlannerControllers

        wheel = PlannerController(sumo, PlannerControllers(how["driven"]).lend().__enter__())
    try:
        while sumo.simulation.getTime() < how["until_s"]:
            sumo.simulationStep()
            if wheel is not None and adversary.ego:
                wheel.go(adversary.ego)
            if adversary is not None and adversary.state not in states[-1:]:
                states.append(adversary.state)
            if how.get("until_crash") and adversary.tally.given_back:
                break
            if adversary is not None and adversary.adversary and how.get("change"):
                disturb(sumo, adversary.ego, how.pop("change"))
                how["until_s"] = min(how["until_s"], sumo.simulation.getTime() + LOOKED_AT_S)
            if how.get("remove") and adversary.adversary and removed is None:
                removed = adversary.adversary
                sumo.vehicle.remove(removed)
                how["until_s"] = min(how["until_s"], sumo.simulation.getTime() + LOOKED_AT_S)
    except Exception as error:
        raised = repr(error)
    there = sumo.vehicle.getIDList()
    modes = {name: (sumo.vehicle.getSpeedMode(name), sumo.vehicle.getLaneChangeMode(name)) for name in there}
    sumo.close()
    if how.get("after_close"):  # the listener was kept
        adversary.step()
        adversary.step()
        sumo.start(command)
        for _ in range(30):
            sumo.simulationStep()
            adversary.step()
        sumo.close()
    told = [line for line in told if "compiling once" not in line]  # where programs are not kept yet
    found = {"told": told, "states": states, "removed": removed, "raised": raised, "modes": modes}
    if adversary is not None:
        found |= {
            "attacks": adversary.tally.attacks,
            "crashes": adversary.tally.crashes,
            "given_back": adversary.tally.given_back,
            "cases": adversary.tally.cases,
            "state": adversary.state,
        }
    return found


if __name__ == "__main__":
    answer_lines(run)
