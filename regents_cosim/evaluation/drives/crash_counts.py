"""Counts crashes by what they say about the planner, for all tables, sentences and pages.

`attack` counts what its cases hold; `evaluate`, `suite rank` and the report count drives. Each is a `CaseEnd`.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from regents_cosim.attack_record import Outcome
from regents_cosim.cases.header import Header
from regents_cosim.collisions import first_contact
from regents_cosim.evaluation.drives.crash_verdict import CrashVerdict
from regents_cosim.evaluation.drives.driven_crash import verdict_of
from regents_cosim.scenario import Scenario, Tracks
from regents_cosim.verdicts.words import adversary_words

_CHANGED: tuple[Outcome, ...] = ("collision", "no_collision")  # with others off their logs


@dataclass(frozen=True)
class CaseEnd:
    """How one driver's drive of one case ends."""

    crashed: bool
    ordinary: bool = False  # nobody attacks: the traffic is as recorded, or harmless
    verdict: CrashVerdict | None = None  # on the crash; None where it is not judged
    failed: bool = False  # the planner failed to answer


@dataclass(frozen=True)
class CrashCounts:
    """Counts of crashes of one driver in some cases."""

    cases: int
    crashes: int
    ordinary: int  # crashes without an attack
    judged: int  # judged crashes under attack
    telling: int
    flawless: int
    telling_unknown: int  # of the judged ones
    clean: int
    actionable: int  # clean and avoidable for the driver
    asked: int  # judged crashes for which it was checked whether a drive avoids them
    avoidable: int
    in_time: int  # avoidable by a reaction to what was visible
    failed: int  # cases in which the planner failed to answer

    @classmethod
    def of(cls, ends: Iterable[CaseEnd]) -> "CrashCounts":
        """The counts of these cases."""
        every = list(ends)
        crashes = [end for end in every if end.crashed]
        verdicts = [end.verdict for end in crashes if end.verdict and not end.ordinary]
        return cls(
            cases=len(every),
            crashes=len(crashes),
            ordinary=sum(end.ordinary for end in crashes),
            judged=len(verdicts),
            telling=sum(verdict.telling is True for verdict in verdicts),
            flawless=sum(verdict.flawless is True for verdict in verdicts),
            telling_unknown=sum(verdict.telling is None for verdict in verdicts),
            clean=sum(verdict.clean for verdict in verdicts),
            actionable=sum(verdict.actionable for verdict in verdicts),
            asked=sum(verdict.escape is not None for verdict in verdicts),
            avoidable=sum(verdict.avoidable is True for verdict in verdicts),
            in_time=sum(verdict.in_time is True for verdict in verdicts),
            failed=sum(end.failed for end in every),
        )

    def __str__(self) -> str:
        """One line, in the same words everywhere."""
        said = f"{self.crashes} of {self.cases} crash"
        said += f" ({self.ordinary} of them where nobody attacks)" if self.ordinary else ""
        if self.judged:
            unknown = f" (not known of {self.telling_unknown})" if self.telling_unknown else ""
            said += (
                f", {self.telling} telling{unknown}, {self.flawless} flawless, {self.actionable} clean and avoidable"
            )
        return f"{said}, in {self.failed} the planner failed" if self.failed else said


def is_ordinary(case: Header | Scenario) -> bool:
    """Whether nobody attacks in a case: it is recorded, unchanged, or the harmless neighbour of a crash."""
    attack = case.attack
    if attack is None or attack.careful_completion is not None or attack.outcome not in _CHANGED:
        return True
    return isinstance(case, Scenario) and case.log is not None and _same_traffic(case.tracks, case.log)


def _same_traffic(now: Tracks, before: Tracks) -> bool:
    """Whether all others drive exactly as before, as after a search without a result."""
    fields = ("x", "y", "yaw", "valid")
    return all(np.array_equal(getattr(now, name)[1:], getattr(before, name)[1:]) for name in fields)


def contact_of(case: Scenario) -> tuple[int, int] | None:
    """The road user that the ego of a case meets, and the step; None where it meets none.

    After an attack without a crash, the ego's track may be the log, whose contacts are not the planner's.
    """
    if case.attack is not None and case.attack.collision is None:
        return None
    return first_contact(case.agents, case.tracks)


def end_of_case(case: Header | Scenario) -> CaseEnd:
    """The end of the drive in a case: by the attacked planner, or by the recorded driver.

    A header without an attack gives no crash, since that would need the tracks.
    """
    attack = case.attack
    if attack is None:
        return CaseEnd(isinstance(case, Scenario) and contact_of(case) is not None, ordinary=True)
    crashed = attack.collision is not None
    verdict = verdict_of(case.judgement, adversary_words(case.agents, attack)) if crashed else None
    return CaseEnd(crashed, is_ordinary(case), verdict, failed=attack.outcome == "planner_error")
