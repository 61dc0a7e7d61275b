"""Measure from the tracks how the adversary comes to its crash; saved with the case, so that maps need no tracks."""

from regents_cosim.cases.header import Behaviour
from regents_cosim.scenario import Scenario
from regents_cosim.verdicts.careful.perception import departs_step
from regents_cosim.verdicts.deviation import deviation

_DECIMALS = 3  # millimetres and milliseconds: rounding makes the values the same on all processors


def behaviour_of(scenario: Scenario) -> Behaviour | None:
    """How the adversary comes to its crash; None for a case without a crash or without the tracks before the attack."""
    found = deviation(scenario)
    hit = scenario.attack.collision if scenario.attack else None
    if found is None or hit is None:
        return None
    agent = next(i for i, one in enumerate(scenario.agents) if one.id == hit.agent)
    departs = departs_step(scenario, agent)
    seconds = None if departs is None else round((hit.step - departs) * scenario.dt, _DECIMALS)
    return Behaviour(seconds, round(found.mean_m, _DECIMALS))
