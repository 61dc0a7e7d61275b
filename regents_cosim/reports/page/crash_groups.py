"""Groups crashes by how much they say about the planner, each group with advice, to tell what to fix first."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

from regents_cosim.evaluation.drives.crash_verdict import CaseEnd, CrashCounts
from regents_cosim.norms.grades import Prevention
from regents_cosim.scenario.judgement import Blamed

FAULTS: dict[Blamed, str] = {"ego": "planner", "both": "both", "nobody": "unclear", "adversary": "adversary"}

Need = Literal["failed", "ordinary", "own_fault", "telling", "rest"]  # the most urgent first
NEEDS: tuple[Need, ...] = get_args(Need)
NO_NEED = len(NEEDS)

_TITLES: dict[Need, str] = {
    "failed": "The planner failed",
    "ordinary": "Crashes in ordinary traffic",
    "own_fault": "Telling crashes, the planner at fault",
    "telling": "Telling crashes, not the planner's fault",
    "rest": "Other crashes",
}
_TODO: dict[Need, str] = {
    "failed": "It raised, hung or answered wrongly. Mend that first: how it drives there is not known.",
    "ordinary": "Nobody attacks here, so any drive may end like this. Mend these before you look at attacks.",
    "own_fault": "The planner broke a rule of the road, and a careful driver would have avoided the crash: "
    "make it drive as that driver does.",
    "telling": "The planner is not at fault, but a careful driver would have seen the danger and avoided the crash: "
    "make it expect such road users.",
    "rest": "These say little: the other road user broke the law grossly or came from behind, or braking does not "
    "prevent the crash. Look at them last.",
}


@dataclass(frozen=True)
class ReportedCrash:
    """One crash, for the summary."""

    case: str
    how: str  # type of the collision in words, or that the planner failed
    end: CaseEnd
    broken: bool  # the driver that it is compared with did not crash here

    @property
    def need(self) -> Need:
        """The group of the crash."""
        found = need_of(self.end)
        assert found is not None
        return found

    @property
    def sort(self) -> tuple[bool, bool, bool, int]:
        """The sort key within a group: newly broken, preventable, clean, and whose fault."""
        verdict = self.end.verdict
        if verdict is None:
            return not self.broken, True, True, 1
        return not self.broken, verdict.prevention is not Prevention.PREVENTABLE, not verdict.clean, verdict.blame

    @property
    def alike(self) -> tuple[bool, str, str | None, str | None]:
        """The key that crashes with the same cause share, as far as the rules tell."""
        verdict = self.end.verdict
        fault, rule = (verdict.at_fault, verdict.rule) if verdict else (None, None)
        return self.broken, self.how, fault, rule


@dataclass(frozen=True)
class CrashGroup:
    """Crashes with the same cause."""

    how: str
    why: str  # whose fault, by which rule
    crashes: int
    broken: bool
    first: str  # the case to open first
    words: str  # what happens there and what prevents it; empty where it is not judged
    cases: tuple[str, ...]


@dataclass(frozen=True)
class NeededWork:
    """Crashes that need the same kind of work on the planner."""

    need: Need
    title: str
    todo: str  # advice, in a sentence
    crashes: int
    flawless: int  # of them
    groups: tuple[CrashGroup, ...]


def need_of(end: CaseEnd) -> Need | None:
    """The group of a drive's ending; None where there is nothing to do."""
    if end.failed:
        return "failed"
    if not end.crashed:
        return None
    verdict = end.verdict
    if end.ordinary and not (verdict and verdict.from_behind and verdict.blame):
        return "ordinary"
    if verdict is None or not verdict.telling:
        return "rest"
    return "own_fault" if verdict.blame == 0 else "telling"


def urgency(end: CaseEnd) -> int:
    """The rank of a drive's ending: 0 is the most urgent; `NO_NEED` where there is nothing to do."""
    need = need_of(end)
    return NO_NEED if need is None else NEEDS.index(need)


def needed_work(crashes: Sequence[ReportedCrash]) -> list[NeededWork]:
    """The groups of crashes to fix, the most urgent first; `crashes` in the order of the page."""
    found: list[NeededWork] = []
    for need in NEEDS:
        if some := [crash for crash in crashes if crash.need == need]:
            flawless = CrashCounts.of(crash.end for crash in some).flawless
            found.append(NeededWork(need, _TITLES[need], _TODO[need], len(some), flawless, _groups(some)))
    return found


def _groups(crashes: Sequence[ReportedCrash]) -> tuple[CrashGroup, ...]:
    """Crashes grouped by cause, larger groups first."""
    found: dict[Any, list[ReportedCrash]] = {}
    for crash in crashes:
        found.setdefault(crash.alike, []).append(crash)
    ordered = sorted(found.values(), key=lambda alike: (not alike[0].broken, -len(alike)))
    return tuple(map(_group, ordered))


def _group(alike: Sequence[ReportedCrash]) -> CrashGroup:
    first = min(alike, key=lambda crash: crash.sort)
    return CrashGroup(
        how=first.how,
        why=_why(first.end),
        crashes=len(alike),
        broken=first.broken,
        first=first.case,
        words=first.end.verdict.words if first.end.verdict else "",
        cases=tuple(crash.case for crash in alike),
    )


def _why(end: CaseEnd) -> str:
    verdict = end.verdict
    if end.failed:
        return "raised, hung or answered wrongly"
    if verdict is None or verdict.at_fault is None:
        return "not judged"
    by = f", by the rule {verdict.rule.replace('_', ' ')}" if verdict.rule and verdict.at_fault != "nobody" else ""
    words = {"ego": "planner at fault", "both": "both at fault", "adversary": "other road user at fault"}
    return words.get(verdict.at_fault, "fault unclear") + by
