"""Why an attack has not found what it looked for in a window."""

from collections import Counter
from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np

from regents_cosim.mirror.bicycle import ACCEL_LIMIT
from regents_cosim.scenario import Scenario

Reason = Literal["no_candidate", "out_of_reach", "spoilt_only", "unavoidable_only", "stuck"]


def failure_reason(results: Sequence[Scenario]) -> Reason | None:
    """Why none of the results of one window is actionable; None where one is. They are judged already.

    - no_candidate: the rules of the method leave nobody who may attack.
    - out_of_reach: no candidate could meet the ego within its limits (`may_reach`).
    - spoilt_only: the search came across collisions, each spoilt by a flaw (`verdicts.clean`).
    - unavoidable_only: what it found is clean, and nothing the ego could do avoids it.
    - stuck: somebody could reach the ego, but the search did not find out how.
    """
    if any(case.judgement and case.judgement.actionable for case in results):
        return None
    records = [case.attack for case in results if case.attack]
    if any(record.outcome == "no_candidate" for record in records):
        return "no_candidate"
    crashes = [case for case in results if case.judgement]
    if any(case.judgement.clean for case in crashes if case.judgement):
        return "unavoidable_only"
    if crashes or any(record.spoilt for record in records):
        return "spoilt_only"
    if not may_reach(results[0]):
        return "out_of_reach"
    return "stuck"


def count_reasons(windows: Sequence[Sequence[Scenario]]) -> dict[Reason, int]:
    """How often each reason applies, over windows without a collision before the attack."""
    found = Counter(map(failure_reason, windows))
    return {reason: found[reason] for reason in get_args(Reason)}


def may_reach(attacked: Scenario) -> bool:
    """Whether some candidate could touch the ego's original track within the limits of acceleration.

    A bound that errs on the side of yes: whoever accelerates as hard as the mirror lets it is within a circle around
    where it entered, whichever way it turns; curvature, the road and other vehicles only take away from that. No
    means that no search could have found a collision with the ego where it would have driven.
    """
    tracks = attacked.tracks if attacked.original is None else attacked.original
    candidates = set(attacked.attack.candidates) if attacked.attack else set()
    ego = attacked.ego
    for index, agent in enumerate(attacked.agents):
        if agent.id not in candidates:
            continue
        there = np.flatnonzero(tracks.valid[index])
        since = attacked.dt * (there - there[0])
        reach = tracks.speed[index, there[0]] * since + 0.5 * ACCEL_LIMIT * since**2
        away = np.hypot(tracks.x[0, there] - tracks.x[index, there[0]], tracks.y[0, there] - tracks.y[index, there[0]])
        touch = 0.5 * (np.hypot(ego.length, ego.width) + np.hypot(agent.length, agent.width))
        if (away <= reach + touch).any():
            return True
    return False
