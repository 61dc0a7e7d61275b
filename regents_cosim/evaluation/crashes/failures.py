"""Reasons why an attack found no telling crash in a window."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal, get_args

import numpy as np

from regents_cosim.norms.grades import GROSS_OFFENCES
from regents_cosim.norms.limits import ACCEL_LIMIT
from regents_cosim.scenario.judgement import Shortcoming
from regents_cosim.scenario.scenario import Scenario

Reason = Literal["no_candidate", "out_of_reach", "stuck", Shortcoming]
_WORDS_OF_NONE: dict[str, str] = {
    "no_candidate": "no candidate: the rules of the method leave no road user that may attack",
    "out_of_reach": "out of reach: no candidate could meet the ego within its limits",
    "stuck": "stuck: a candidate could reach the ego, and the search did not find out how",
    "spoilt_only": "spoilt: the collisions that were found are none that a person could be asked to prevent",
}


def failure_reason(results: Sequence[Scenario]) -> Reason | None:
    """The reason why none of the judged results of a window is telling; None where one is.

    Of several crashes the one nearest to telling decides.

    - no_candidate: the rules of the method allow no road user to attack.
    - out_of_reach: no candidate could meet the ego within its limits (`may_reach`).
    - stuck: a candidate could reach the ego, but the search did not find out how.
    - spoilt_only: the search found only collisions that a flaw spoils (`verdicts.clean`).
    - gross_offence_only: the crash is clean, but the adversary broke the law grossly (`failing_offences` lists how).
    - not_known: the crash is clean, but the law, or what a careful driver does, could not be decided.
    - careful_driver_crashes_too: the crash is clean, and not by a gross offence, but a careful driver crashes too.
    - swerve_only: a careful driver avoids the crash with a swerve, and not by braking alone.
    """
    shortcomings = [case.judgement.shortcoming for case in results if case.judgement]
    if None in shortcomings:
        return None
    records = [case.attack for case in results if case.attack]
    if any(record.outcome == "no_candidate" for record in records):
        return "no_candidate"
    if shortcomings:
        return max(filter(None, shortcomings), key=get_args(Shortcoming).index)
    if any(record.spoilt for record in records):
        return "spoilt_only"
    return "stuck" if may_reach(results[0]) else "out_of_reach"


def reasons_without_crash(attacked: Iterable[Scenario]) -> dict[str, Reason]:
    """The reasons why searched windows hold no crash, by the ids of their cases."""
    searched = (case for case in attacked if case.attack and case.attack.outcome in ("no_collision", "no_candidate"))
    return {case.id: reason for case in searched if (reason := failure_reason([case]))}


def reasons_in_words(reasons: Mapping[str, Reason]) -> list[str]:
    """A line for each reason in `reasons` (see `reasons_without_crash`), with its number of cases."""
    return [f"{_WORDS_OF_NONE[reason]} ({count})" for reason, count in Counter(reasons.values()).items()]


def failing_offences(results: Sequence[Scenario]) -> set[str]:
    """The adversary's offences in the crash nearest to telling, if they are all that is wrong with it."""
    if failure_reason(results) != "gross_offence_only":
        return set()
    laws = [c.judgement.law for c in results if c.judgement and c.judgement.clean and c.judgement.law]
    broken = [{offence.name for offence in law.adversary} & GROSS_OFFENCES for law in laws]
    return min(filter(None, broken), key=len)


def count_reasons(windows: Sequence[Sequence[Scenario]]) -> dict[Reason, int]:
    """The number of windows per reason, over windows without a collision before the attack."""
    found = Counter(map(failure_reason, windows))
    return {reason: found[reason] for reason in get_args(Reason)}


def may_reach(attacked: Scenario) -> bool:
    """Whether some candidate could touch the ego's logged track within the limits of acceleration.

    This is an upper bound: a vehicle that accelerates as hard as the mirror allows stays within a circle around the
    point where it entered, whatever its steering; curvature, the road and other vehicles only shrink that. So no search
    could have found a collision with the logged ego where the result is False.
    """
    tracks = attacked.recorded_tracks
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
