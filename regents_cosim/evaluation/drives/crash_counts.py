"""How many crashes there are, and what they say: counted here for every table, sentence and page.

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

_CHANGED: tuple[Outcome, ...] = ("collision", "no_collision")  # ends of attacks that may leave others on new ways


@dataclass(frozen=True)
class CaseEnd:
    """How one driver ends in one case."""

    crashed: bool
    ordinary: bool = False  # the traffic is as it was recorded, or harmless: nobody attacks there
    verdict: CrashVerdict | None = None  # on the crash; None where it is not judged
    failed: bool = False  # the planner gave no answer


@dataclass(frozen=True)
class CrashCounts:
    """Of some cases with one driver."""

    cases: int
    crashes: int
    ordinary: int  # of the crashes, where nobody attacks
    judged: int  # of the crashes under attack
    telling: int
    telling_unknown: int  # of the judged
    clean: int
    actionable: int  # clean, and the driver could have avoided it
    asked: int  # of the judged, those of which it is known or was looked for whether a drive avoids them
    avoidable: int
    in_time: int  # of the avoidable, by an answer to what was to be seen
    failed: int  # cases in which the planner gave no answer

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
            telling_unknown=sum(verdict.telling is None for verdict in verdicts),
            clean=sum(verdict.clean for verdict in verdicts),
            actionable=sum(verdict.actionable for verdict in verdicts),
            asked=sum(verdict.escape is not None for verdict in verdicts),
            avoidable=sum(verdict.avoidable is True for verdict in verdicts),
            in_time=sum(verdict.in_time is True for verdict in verdicts),
            failed=sum(end.failed for end in every),
        )

    def __str__(self) -> str:
        """In one line, the same wherever it is said."""
        said = f"{self.crashes} of {self.cases} crash"
        said += f" ({self.ordinary} of them where nobody attacks)" if self.ordinary else ""
        if self.judged:
            unknown = f" (not known of {self.telling_unknown})" if self.telling_unknown else ""
            said += f", {self.telling} telling{unknown}, {self.actionable} clean and avoidable"
        return f"{said}, in {self.failed} the planner failed" if self.failed else said


def is_ordinary(case: Header | Scenario) -> bool:
    """Whether nobody attacks in a case: recorded, left as it was, or the harmless neighbour of a crash."""
    attack = case.attack
    if attack is None or attack.careful_completion is not None or attack.outcome not in _CHANGED:
        return True
    return isinstance(case, Scenario) and case.log is not None and _same_traffic(case.tracks, case.log)


def _same_traffic(now: Tracks, before: Tracks) -> bool:
    """Whether all but the ego drive to the bit as before: so a search leaves them that has nothing to show."""
    fields = ("x", "y", "yaw", "valid")
    return all(np.array_equal(getattr(now, name)[1:], getattr(before, name)[1:]) for name in fields)


def contact_of(case: Scenario) -> tuple[int, int] | None:
    """Who the ego of a case meets, and at which step; None where it meets nobody.

    Of an attack that ended without a crash the ego may be that of the log, whose contacts are no planner's.
    """
    if case.attack is not None and case.attack.collision is None:
        return None
    return first_contact(case.agents, case.tracks)


def end_of_case(case: Header | Scenario) -> CaseEnd:
    """How the drive that a case holds ends: that of the planner that was attacked, or of who was recorded.

    A header without an attack tells of no crash, for that is in the tracks.
    """
    attack = case.attack
    if attack is None:
        return CaseEnd(isinstance(case, Scenario) and contact_of(case) is not None, ordinary=True)
    crashed = attack.collision is not None
    verdict = verdict_of(case.judgement) if crashed else None
    return CaseEnd(crashed, is_ordinary(case), verdict, failed=attack.outcome == "planner_error")
