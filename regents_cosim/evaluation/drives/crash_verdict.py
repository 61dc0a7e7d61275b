"""What is known of one crash of one driver, and its urgency."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from regents_cosim.cases.header import Header
from regents_cosim.norms.grades import Prevention
from regents_cosim.scenario.attack_record import AttackRecord, Outcome
from regents_cosim.scenario.collisions import collision_of_drive, first_contact
from regents_cosim.scenario.judgement import Blamed, Flaw, Judgement
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.verdicts.judge import judge
from regents_cosim.verdicts.words import ANOTHER, adversary_words, verdict_words

_BLAME: dict[Blamed | None, int] = {"ego": 0, "both": 0, "nobody": 1, None: 1, "adversary": 2}


@dataclass(frozen=True)
class CrashVerdict:
    """What is known of one crash of one driver; fields are None where it is not judged."""

    at_fault: Blamed | None
    rule: str | None
    clean: bool
    prevention: Prevention = Prevention.UNKNOWN  # whether a careful driver in the driver's place prevents it
    telling: bool | None = None
    flawless: bool | None = None
    words: str = ""  # both grades in sentences, for people
    offences: tuple[str, ...] | None = None  # of the adversary
    ego_offences: tuple[str, ...] | None = None
    flaws: tuple[Flaw, ...] = ()  # what spoils it as a test

    @property
    def from_behind(self) -> bool:
        """Whether another road user drove into the ego's back, as one on a fixed track does when the ego brakes."""
        return not {Flaw.REAR_ENDS_EGO, Flaw.FROM_BEHIND}.isdisjoint(self.flaws)

    @property
    def blame(self) -> int:
        """0 where the planner is to blame, alone or with others; 1 where that is open; 2 where the adversary is."""
        return _BLAME[self.at_fault]


def verdict_of(judgement: Judgement | None, who: str = ANOTHER) -> CrashVerdict | None:
    """The verdict in a judgement of a crash, in which `who` is the adversary; None where it has not been judged."""
    if judgement is None:
        return None
    fault, law = judgement.fault, judgement.law
    return CrashVerdict(
        at_fault=fault.at_fault if fault else None,
        rule=fault.rule if fault else None,
        clean=judgement.clean,
        prevention=judgement.prevention,
        telling=judgement.telling,
        flawless=judgement.flawless,
        words=verdict_words(judgement, who),
        offences=tuple(offence.name for offence in law.adversary) if law else None,
        ego_offences=tuple(offence.name for offence in law.ego) if law else None,
        flaws=judgement.flaws,
    )


def verdict_of_drive(case: Scenario, driver: str, tracks: Tracks) -> CrashVerdict | None:
    """The verdict on the crash of `driver` in `case`, whose drive gave `tracks`; None where it has no crash."""
    hit = collision_of_drive(case, tracks)
    if hit is None:
        return None
    attack = AttackRecord(case.id, "drive", driver, "collision", 0, hit)
    log = case.recorded_tracks
    driven = judge(replace(case, tracks=tracks, attack=attack, log=log, judgement=None, evasion=None))
    return verdict_of(driven.judgement, adversary_words(driven.agents, attack))


def as_driven(replayed: Scenario, driver: str) -> Scenario:
    """An attacked case as the drive of `driver` in its tracks ended; an end other than the attack's is unjudged."""
    attack = replayed.attack
    if attack is None:
        return replayed
    hit, found = collision_of_drive(replayed, replayed.tracks), attack.collision
    if hit is not None and found is not None and (hit.agent, hit.step) == (found.agent, found.step):
        return replace(replayed, attack=replace(attack, planner=driver))
    outcome = "no_collision" if hit is None else "collision"
    ended = replace(attack, planner=driver, outcome=outcome, collision=hit, planner_error="")
    return replace(replayed, attack=ended, judgement=None, evasion=None)


_CHANGED: tuple[Outcome, ...] = ("collision", "no_collision")  # with others off their logs


@dataclass(frozen=True)
class CaseEnd:
    """How one driver's drive of one case ends."""

    crashed: bool
    ordinary: bool = False  # no attack: the traffic is as recorded, or harmless
    verdict: CrashVerdict | None = None  # on the crash; None where it is not judged
    failed: str = ""  # why the planner gave no answer; empty where it did


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
    preventable: int  # by a careful driver who only brakes
    failed: int  # cases in which the planner failed to answer
    why_failed: str  # in the first of them

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
            preventable=sum(verdict.prevention is Prevention.PREVENTABLE for verdict in verdicts),
            failed=sum(bool(end.failed) for end in every),
            why_failed=next((end.failed for end in every if end.failed), ""),
        )

    def __str__(self) -> str:
        """One line, in the same words everywhere."""
        said = f"{self.crashes} of {self.cases} crash"
        said += f" ({self.ordinary} of them without an attack)" if self.ordinary else ""
        if self.judged:
            unknown = f" (not known of {self.telling_unknown})" if self.telling_unknown else ""
            said += f", {self.telling} telling{unknown}, {self.flawless} flawless, {self.clean} clean"
        return f"{said}, in {self.failed} the planner failed ({self.why_failed})" if self.failed else said


def is_ordinary(case: Header | Scenario) -> bool:
    """Whether a case has no attack: it is recorded, unchanged, or the harmless neighbour of a crash."""
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
    failed = attack.outcome == "planner_error" and (attack.planner_error.partition("\n")[0] or "it is not known why")
    return CaseEnd(crashed, is_ordinary(case), verdict, failed or "")
