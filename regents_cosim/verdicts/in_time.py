"""Whether a crash could still be avoided once there was something to be seen.

A bank of manoeuvres that may begin at once knows what is to come; a planner does not.
"""

import numpy as np

from regents_cosim.scenario import Judgement, Scenario

_DEPARTED_M = 0.5
_REACTION_S = 0.75  # of an attentive driver (RSS: 0.5 to 1 s)


def avoidable_in_time(case: Scenario, judgement: Judgement | None) -> bool:
    """Whether the ego could still evade once the adversary had left its log and some time to react had passed."""
    found = judgement.avoidability if judgement else None
    agent = next((index for index, agent in enumerate(case.agents) if agent.role == "adversary"), None)
    if found is None or found.last_onset_step is None or case.original is None or agent is None:
        return False
    now, log = case.tracks, case.original
    away = np.hypot(now.x[agent] - log.x[agent], now.y[agent] - log.y[agent]) > _DEPARTED_M
    departed = int(np.argmax(away & now.valid[agent] & log.valid[agent])) if away.any() else 0
    return found.last_onset_step * case.dt >= departed * case.dt + _REACTION_S
