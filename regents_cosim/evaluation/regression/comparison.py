"""Compares a planner's drives with the accepted outcomes, to detect regressions.

- A collision where the baseline has none, a failure, or a metric that is worse than a threshold allows: regression.
- An event that is forbidden, whatever the baseline says: forbidden, which fails too.
- No baseline, or one of another content of the case: missing, which fails too; where events are forbidden: passed.
- No collision where the baseline has one: improved.
- A collision as in the baseline: known failure, which passes and is listed.
"""

import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from regents_cosim.evaluation.drives.metrics import COMPARED
from regents_cosim.evaluation.regression.baseline import DriveOutcome
from regents_cosim.evaluation.regression.thresholds import Forbidden, Threshold, format_value
from regents_cosim.plain_text import counted, printable
from regents_cosim.short_repr import ShortRepr

Status = Literal["same", "known_failure", "improved", "passed", "missing", "forbidden", "regression"]
Limits = Sequence[Threshold | Forbidden]

_MARKS = re.compile(r"[\\`*|<>\[\]~@#]")
_GRADES = ("telling", "flawless")
_KNOWN = {None: "not known", True: "yes", False: "no"}
_SAID: dict[Status, str] = {
    "regression": "regressed",
    "forbidden": "forbidden",
    "missing": "no baseline",
    "passed": "passed without a baseline",
    "improved": "improved",
    "known_failure": "known to fail",
    "same": "as before",
}


@dataclass(frozen=True, repr=False)
class RegressionVerdict(ShortRepr):
    """The verdict on one case."""

    case: str
    status: Status
    reasons: tuple[str, ...]
    before: DriveOutcome | None
    now: DriveOutcome
    words: str = ""  # what happens in its crash and what prevents it

    def fails(self, strict: bool = False, update: bool = False) -> bool:
        """Whether it makes the run fail; `strict` also requires improvements to be accepted.

        An `update` accepts everything but a failing planner.
        """
        if update:
            return self.now.outcome == "planner_error"
        return self.status in ("regression", "forbidden", "missing") or (strict and self.status == "improved")


def judge_drive(
    case: str, now: DriveOutcome, before: DriveOutcome | None, limits: Limits = (), words: str = ""
) -> RegressionVerdict:
    """Compare a planner's outcome with the accepted one, and with what is forbidden in any case."""
    forbidden = [limit for limit in limits if isinstance(limit, Forbidden)]

    def verdict(status: Status, *reasons: str) -> RegressionVerdict:
        return RegressionVerdict(case, status, reasons, before, now, words)

    if now.outcome == "planner_error":
        return verdict("regression", f"failed: {now.failure}")
    if happened := tuple(filter(None, (one.violated(now) for one in forbidden))):
        return verdict("forbidden", *happened)
    if before is None or before.hash != now.hash:
        why = "never accepted" if before is None else "the case has changed since its baseline was accepted"
        return verdict("passed" if forbidden else "missing", why)
    if now.outcome == "collision" and before.outcome != "collision":
        return verdict("regression", "collides where the baseline did not")
    if before.outcome == "collision" != now.outcome:
        return verdict("improved", "no collision any more")
    thresholds = (limit for limit in limits if isinstance(limit, Threshold))
    worse = tuple(filter(None, (threshold.violated(before.metrics, now.metrics) for threshold in thresholds)))
    if worse:
        return verdict("regression", *worse)
    return verdict("known_failure" if now.outcome == "collision" else "same")


def how_to_accept(verdicts: Iterable[RegressionVerdict], options: str) -> str:
    """A line where cases have no baseline, with the options that accept them; else empty."""
    number = sum(verdict.status in ("passed", "missing") for verdict in verdicts)
    return f"{counted(number, 'case')} without a baseline: accept what it does now with {options}" if number else ""


def describe(driven: DriveOutcome | None) -> str:
    """The outcome on one line."""
    told = {name: driven.metrics.get(name) for name in COMPARED if name != "collision"} if driven else {}
    metrics = ", ".join(f"{name} {format_value(value)}" for name, value in told.items() if value is not None)
    return f"{short(driven)}; {metrics}" if metrics else short(driven)


def short(driven: DriveOutcome | None) -> str:
    """The outcome without the metrics."""
    if driven is None or driven.outcome != "collision":
        return _happened(driven)
    return ", ".join([_happened(driven), *(f"{grade}: {_KNOWN[getattr(driven, grade)]}" for grade in _GRADES)])


def _happened(driven: DriveOutcome | None) -> str:
    if driven is None:
        return "none"
    if driven.outcome == "planner_error":
        return f"failed: {driven.failure}"
    if driven.agent is None:
        return "no collision"
    how = "rear-ended by" if driven.outcome == "rear_ended" else f"{driven.collision_type} collision with"
    return f"{how} {driven.agent} at {driven.time_s:g} s (step {driven.step})"


def reproduce(case: Path, planner: str, where: str) -> str:
    """The command that shows the drive as a picture."""
    words = ["regents", "replay", str(case), "--in", where, "--planner", planner, "--record", f"{case.name}.gif"]
    return shlex.join(words)


def explain(verdict: RegressionVerdict, case: Path, planner: str, where: str, adversary: str = "") -> str:
    """The full message for a failing case."""
    reasons = "; ".join(verdict.reasons)
    lines = [
        f"{'regression' if verdict.status == 'regression' else _SAID[verdict.status]}: {reasons}",
        f"  case       {verdict.case}",
        f"  planner    {planner} in {where}",
        *([f"  adversary  {adversary}"] if adversary else []),
        f"  baseline   {describe(verdict.before)}",
        f"  now        {describe(verdict.now)}",
        *([f"  in words   {verdict.words}"] if verdict.words else []),
        f"  see it     {reproduce(case, planner, where)}",
    ]
    return "\n".join([*lines, *(["", verdict.now.trace] if verdict.now.trace else [])])


def unused(before: Mapping[str, DriveOutcome], cases: Iterable[str]) -> list[str]:
    """Cases with entries in a baseline that the suite does not contain."""
    return sorted(set(before) - set(cases))


def changes(verdict: RegressionVerdict) -> str:
    """The change that accepting a drive makes, on one line; empty where there is none."""
    before, now = verdict.before, verdict.now
    if before is None:
        return f"{verdict.case}: new: {describe(now)}"
    if before == now:
        return ""
    parts = [
        f"{name} {format_value(before.metrics.get(name))} -> {format_value(value)}"
        for name, value in now.metrics.items()
        if before.metrics.get(name) != value or name not in before.metrics
    ]
    if before.outcome == now.outcome:
        was, is_ = ({grade: _KNOWN[getattr(one, grade)] for grade in _GRADES} for one in (before, now))
        parts = [*(f"{one} {was[one]} -> {is_[one]}" for one in _GRADES if was[one] != is_[one]), *parts]
    if _happened(before) != _happened(now):
        parts.insert(0, f"{_happened(before)} -> {_happened(now)}")
    if before.hash != now.hash:
        parts.insert(0, f"case {before.hash[:8]} -> {now.hash[:8]}")
    return f"{verdict.case}: {', '.join(parts)}" if parts else ""


def tally(verdicts: Sequence[RegressionVerdict]) -> str:
    """The number of cases per verdict, on one line, the worst first."""
    counts = ((said, sum(v.status == status for v in verdicts)) for status, said in _SAID.items())
    return f"{counted(len(verdicts), 'case')}: " + ", ".join(f"{number} {said}" for said, number in counts if number)


def markdown(
    verdicts: Sequence[RegressionVerdict],
    suite: Path,
    planner: str,
    where: str,
    left: Sequence[str] = (),
    strict: bool = False,
    update: bool = False,
) -> str:
    """A summary for a pull request: the verdict as `fails` has it, then a table of all cases of interest."""
    failed = [verdict for verdict in verdicts if verdict.fails(strict, update)]
    order = list(_SAID)
    lines = [f"### regents: {planner} in {where}: {_heading(failed, update)}", "", tally(verdicts), ""]
    told = sorted((v for v in verdicts if v.status != "same"), key=lambda v: (order.index(v.status), v.case))
    if told:
        lines += ["| case | verdict | baseline | now |", "|---|---|---|---|"]
        for v in told:
            why = f"{v.status.replace('_', ' ')}{': ' if v.reasons else ''}{'; '.join(v.reasons)}"
            now = f"{short(v.now)}. {v.words}" if v.words else short(v.now)
            lines.append(f"| {_cell(v.case)} | {_cell(why)} | {_cell(short(v.before))} | {_cell(now)} |")
        lines.append("")
    if left:
        lines += [f"Baseline entries without a case: {', '.join(map(_cell, left))}", ""]
    worst = next((v for v in told if v in failed), None)
    if worst:
        lines += ["See the first one:", "", "```", reproduce(suite / worst.case, planner, where), "```", ""]
    return "\n".join(lines)


def _heading(failed: Sequence[RegressionVerdict], update: bool) -> str:
    if not failed:
        return "accepted" if update else "passed"
    if any(verdict.status == "regression" and verdict.before for verdict in failed):
        return "regression"
    found = {verdict.status for verdict in failed}
    return "improvement to accept" if found == {"improved"} else "no baseline" if found == {"missing"} else "failed"


def _cell(text: str) -> str:
    """Text from outside, such as a name in a stranger's suite, as it is: not as marks of Markdown or as HTML."""
    return _MARKS.sub(r"\\\g<0>", printable(" ".join(text.split()), None))
