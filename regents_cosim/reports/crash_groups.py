"""What is to be fixed first: crashes that are the planner's fault, and that it could have avoided in time."""

from collections.abc import Sequence
from dataclasses import dataclass

from regents_cosim.evaluation.crashes.verdict import CrashVerdict
from regents_cosim.judgement import Blamed

FAULTS: dict[Blamed, str] = {"ego": "planner", "both": "both", "nobody": "unclear", "adversary": "adversary"}

NOT_JUDGED = (1, 1, 1, 1)  # the urgency of a crash without a verdict


@dataclass(frozen=True)
class ReportedCrash:
    """One crash, for the summary."""

    case: str
    kind: str  # of the collision, in words; or that the planner failed
    verdict: CrashVerdict | None
    broken: bool  # the driver that it is compared with had none here
    failed: bool  # the planner itself gave no answer

    @property
    def sort(self) -> tuple[bool, bool, tuple[int, int, int, int]]:
        """What got worse first, then planners that fail, then by their verdict."""
        return not self.broken, not self.failed, self.verdict.urgency if self.verdict else NOT_JUDGED

    @property
    def group(self) -> tuple[bool, str, str | None, str | None]:
        """Crashes of one group are alike: they have one cause, as far as the rules tell."""
        fault, rule = (self.verdict.at_fault, self.verdict.rule) if self.verdict else (None, None)
        return self.broken, self.kind, fault, rule


@dataclass(frozen=True)
class CrashGroup:
    """Crashes that are alike."""

    kind: str
    why: str  # whose fault, by which rule
    crashes: int
    telling: int | None  # of them telling; None where they have not been judged
    in_time: int | None  # of them avoidable in time; likewise
    broken: bool
    first: str  # the case to open first
    cases: tuple[str, ...]


def groups(crashes: Sequence[ReportedCrash]) -> list[CrashGroup]:
    """What to fix, the most urgent first, larger groups before smaller ones; `crashes` in the order of the page."""
    found: dict[tuple[bool, str, str | None, str | None], list[ReportedCrash]] = {}
    for crash in crashes:
        found.setdefault(crash.group, []).append(crash)
    ordered = sorted(
        found.values(),
        key=lambda alike: (*_first(alike).sort[:2], -_telling(alike), _blame(alike), -_in_time(alike), -len(alike)),
    )
    return [_group(alike) for alike in ordered]


def _group(alike: Sequence[ReportedCrash]) -> CrashGroup:
    first = _first(alike)
    judged = any(crash.verdict and crash.verdict.in_time is not None for crash in alike)
    return CrashGroup(
        kind=first.kind,
        why=_why(first),
        crashes=len(alike),
        telling=_telling(alike) if judged else None,
        in_time=_in_time(alike) if judged else None,
        broken=first.broken,
        first=first.case,
        cases=tuple(crash.case for crash in alike),
    )


def _first(alike: Sequence[ReportedCrash]) -> ReportedCrash:
    return min(alike, key=lambda crash: crash.sort)


def _blame(alike: Sequence[ReportedCrash]) -> int:
    return alike[0].verdict.blame if alike[0].verdict else 1


def _telling(alike: Sequence[ReportedCrash]) -> int:
    return sum(bool(crash.verdict and crash.verdict.telling) for crash in alike)


def _in_time(alike: Sequence[ReportedCrash]) -> int:
    return sum(bool(crash.verdict and crash.verdict.in_time) for crash in alike)


def _why(crash: ReportedCrash) -> str:
    verdict = crash.verdict
    if crash.failed:
        return "raised, hung or answered wrongly"
    if verdict is None or verdict.at_fault is None:
        return "not judged"
    by = f", by the rule {verdict.rule.replace('_', ' ')}" if verdict.rule and verdict.at_fault != "nobody" else ""
    words = {"ego": "planner at fault", "both": "both at fault", "adversary": "adversary at fault"}
    return words.get(verdict.at_fault, "fault unclear") + by
