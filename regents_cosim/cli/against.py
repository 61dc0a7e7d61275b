"""`regents evaluate --against`: the verdicts of the pytest plugin without pytest."""

import dataclasses
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from regents_cosim.cases.files import content_hash
from regents_cosim.cases.shipped import require_own
from regents_cosim.cli.options import Against
from regents_cosim.cli.terminal import Terminal
from regents_cosim.errors import NEGATIVE_VERDICT, PLANNER_FAILED, RegentsError
from regents_cosim.evaluation.drives.driving import Drive
from regents_cosim.evaluation.reduction.margin import with_margin
from regents_cosim.evaluation.regression.baseline import FILE, Baseline, Driven, load_baseline, update_baseline
from regents_cosim.evaluation.regression.comparison import (
    Verdict,
    changes,
    judge_drive,
    markdown,
    reproduce,
    short,
    tally,
    thresholds_measurable,
    unused,
)
from regents_cosim.evaluation.regression.drives_ahead import driven
from regents_cosim.evaluation.regression.thresholds import Threshold, parse_thresholds
from regents_cosim.evaluation.suites.cards import suite_cases
from regents_cosim.replays.mirror import Wheel
from regents_cosim.reports.tables import COMPARED
from regents_cosim.scenario import Scenario

_STDOUT = Path("-")


@dataclass(frozen=True)
class Comparison:
    """A planner's drives held against a baseline."""

    options: Against
    cases: Path
    planner: str
    where: str
    file: Path
    baseline: Baseline
    thresholds: tuple[Threshold, ...]

    @classmethod
    def asked(cls, options: Against, cases: Path, planner: str, where: str) -> "Comparison | None":
        """None where no baseline is asked for. Raises RegentsError before anything is driven."""
        if options.against is None and not options.update:
            if options.fail or options.strict or options.margin or options.markdown:
                raise RegentsError("--fail, --strict, --margin and --markdown compare with a baseline: add --against")
            return None
        file = options.against or _suite_of(cases) / FILE
        if not file.exists() and not options.update:
            raise RegentsError(f"baseline not found: {file} (make it with --update)")
        if options.update:
            require_own(file, "--against")
        if options.margin and where != "mirror":
            raise RegentsError(f"the margin is measured in the mirror, not in {where}: leave one of the two out")
        thresholds = parse_thresholds(options.fail)
        thresholds_measurable(thresholds, options.margin)
        return cls(options, cases, planner, where, file, load_baseline(file), thresholds)

    def report(self, scenarios: Sequence[Scenario], drives: Sequence[Drive], terminal: Terminal) -> int:
        """Judge, show, accept where that is asked for; the exit code."""
        before = self.baseline.of(self.planner, self.where)
        now = self._driven(scenarios, drives)
        verdicts = [judge_drive(case, one, before.get(case), self.thresholds) for case, one in now.items()]
        left = unused(before, self._listed())
        self._show(verdicts, left, terminal)
        if renamed := self.baseline.stranger(self.planner, self.where):
            terminal.say(renamed)
        if self.options.update:
            self._accept(verdicts, terminal)
            return PLANNER_FAILED if any(v.now.outcome == "planner_error" for v in verdicts) else 0
        return NEGATIVE_VERDICT if any(v.fails(self.options.strict) for v in verdicts) else 0

    def _driven(self, scenarios: Sequence[Scenario], drives: Sequence[Drive]) -> dict[str, Driven]:
        more: list[dict[str, float | None]] = [{} for _ in scenarios]
        if self.options.margin:
            drives, margins = self._margins(scenarios, drives)
            more = [{"margin": margin} for margin in margins]
        each = zip(scenarios, drives, more, strict=True)
        return {scenario.id: driven(drive, content_hash(scenario), scenario.dt, its) for scenario, drive, its in each}

    def _margins(
        self, scenarios: Sequence[Scenario], drives: Sequence[Drive]
    ) -> tuple[list[Drive], list[float | None]]:
        with Wheel(self.planner) as wheel, ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            found = list(pool.map(partial(with_margin, wheel=wheel), scenarios, drives))
        return [drive for drive, _ in found], [margin for _, margin in found]

    def _show(self, verdicts: Sequence[Verdict], left: Sequence[str], terminal: Terminal) -> None:
        suite = _suite_of(self.cases)
        summary = markdown(verdicts, suite, self.planner, self.where, left)
        if self.options.markdown == _STDOUT:
            terminal.write(summary)
        else:
            if self.options.markdown is not None:
                _write(self.options.markdown, summary)
            rows = [dataclasses.asdict(v) if terminal.json else _row(v) for v in verdicts]
            terminal.show(f"{self.planner} in {self.where} against {self.file}", rows, essential=COMPARED)
        terminal.say(tally(verdicts))
        for verdict in verdicts:
            if verdict.fails(self.options.strict) and not self.options.update:
                terminal.say(f"{verdict.case}: {'; '.join(verdict.reasons)}")
                terminal.say(f"  see it: {reproduce(suite / verdict.case, self.planner, self.where)}")
        for case in left:
            terminal.say(f"{'removed' if self.options.update else 'unused'} baseline entry: {case}")

    def _accept(self, verdicts: Sequence[Verdict], terminal: Terminal) -> None:
        accepted = [v for v in verdicts if v.now.outcome != "planner_error"]
        new = {v.case: v.now for v in accepted}
        update_baseline(self.file, lambda now: now.accepting(self.planner, self.where, new, self._listed()))
        lines = list(filter(None, map(changes, accepted)))
        terminal.say(f"accepted {len(lines)} changes in {self.file}")
        for line in lines:
            terminal.say(f"  {line}")

    def _listed(self) -> list[str]:
        """All cases that the baseline may hold entries of."""
        return list(suite_cases(_suite_of(self.cases)))


def _suite_of(cases: Path) -> Path:
    """The suite that `cases` is, or that it is a case of."""
    return cases.absolute().parent if (cases / "scenario.json").is_file() else cases


def _row(verdict: Verdict) -> dict[str, Any]:
    return {
        "case": verdict.case,
        "verdict": verdict.status,
        "baseline": short(verdict.before),
        "now": short(verdict.now),
        "why": "; ".join(verdict.reasons) or None,
    }


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text)
    except OSError as error:
        raise RegentsError(f"cannot write {path}: {error.strerror} (choose another file for --markdown)") from error
