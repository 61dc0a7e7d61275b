"""`evaluate`: measures how well a planner drives a suite, and whether it got worse than a baseline allows."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import msgspec

from regents_cosim.cases.manifest import suite_of
from regents_cosim.cases.shipped import located
from regents_cosim.cases.suite import CasesOnDisk, cases_in_turn, hashes_of, suite_cases
from regents_cosim.checks.names import require_distinct, require_id
from regents_cosim.checks.typed_values import from_values
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.drives.crash_verdict import CrashCounts
from regents_cosim.evaluation.drives.driving import DriveResult, DrivingRow, drive_each, driving_rows
from regents_cosim.evaluation.regression.baseline import (
    FILE,
    Baseline,
    DriveOutcome,
    load_baseline,
    require_place,
    update_baseline,
)
from regents_cosim.evaluation.regression.comparison import Limits, RegressionVerdict, changes, judge_drive, unused
from regents_cosim.evaluation.regression.drives_ahead import outcome_of_drive
from regents_cosim.evaluation.regression.thresholds import Forbidden, Threshold, parse_thresholds
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.replays.replay import Background, Simulator, check
from regents_cosim.runs.identity import identity
from regents_cosim.runs.ledger import DoneUnit, open_ledger
from regents_cosim.runs.planner_files import digest_of
from regents_cosim.runs.shards import WHOLE, Shard
from regents_cosim.runs.windows import planned, windows_of
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.short_repr import ShortRepr, html_table
from regents_cosim.system.data_frames import Tabular
from regents_cosim.system.progress import ShowProgress, progress_for

COMPARING = "limits of --fail-on, --strict and --markdown"
Cases = Path | str | Scenario | Sequence[Scenario]


@dataclass(frozen=True, repr=False)
class BaselineComparison(ShortRepr):
    """A planner's drives, compared with the accepted outcomes."""

    file: Path | None  # None: against no baseline, by what is forbidden alone
    verdicts: tuple[RegressionVerdict, ...]
    unused: tuple[str, ...]  # cases with entries in the baseline that the suite does not contain
    stranger: str  # a message where the baseline only knows other planners
    accepted: tuple[str, ...] | None = None  # accepted changes, a line each; None: no update was asked for

    def fails(self, strict: bool = False) -> bool:
        """Whether it makes the run fail; `strict` also requires improvements to be accepted."""
        return any(verdict.fails(strict, update=self.accepted is not None) for verdict in self.verdicts)


@dataclass(frozen=True, repr=False)
class Evaluation(ShortRepr, Tabular):
    """A planner's drives in some cases. `to_dict()` and `to_frame()` have a row per drive."""

    planner: str  # name of the planner
    where: Simulator
    drives: tuple[DriveResult, ...]  # in the order of the cases
    comparison: BaselineComparison | None = None  # with a baseline, if there is one

    @property
    def rows(self) -> list[DrivingRow]:
        """Scores by source of traffic, those of all cases last."""
        return driving_rows(self.drives)

    def to_dict(self) -> list[dict[str, object]]:
        """A row per drive."""
        return [{"planner": self.planner, "where": self.where, **drive.row()} for drive in self.drives]

    def _repr_html_(self) -> str:
        return html_table([{"planner": self.planner, **row.row()} for row in self.rows])

    @property
    def counts(self) -> CrashCounts:
        """The number of crashes, and what they say about the planner."""
        return CrashCounts.of(drive.end for drive in self.drives)

    @property
    def errors(self) -> list[DriveResult]:
        """Drives in which the planner or the simulator failed."""
        return [drive for drive in self.drives if drive.error]


def evaluate(
    cases: Cases,
    planner: AnyPlanner,
    *,
    where: Simulator = "mirror",
    background: Background = "log",
    baseline: Path | str | None = None,
    update: bool = False,
    fail_on: str = "",
    known_as: str | None = None,
    act_timeout_s: float = ACT_TIMEOUT_S,
    executor: Executor | None = None,
    progress: ShowProgress = True,
    keep: Path | str | None = None,
    retry: bool = False,
    shard: Shard = WHOLE,
) -> Evaluation:
    """Let `planner` drive every case: a case or a suite on disk, or one or several in memory.

    The others follow their tracks; in SUMO with `background` reactive, SUMO drives all but the adversary.

    `baseline` is a file of accepted outcomes (baseline.json) that each drive is compared with, by the name `known_as`
    (default: the planner's). `fail_on` also compares metrics ("min_ttc_s:-5% collision:+0"), and names events that fail
    the planner with and without a baseline ("telling", "flawless", "collision"). `update` accepts the planner's current
    outcomes, by default in the suite's own file.

    With `keep` every drive is saved in that folder, and the same call continues from there; `retry` repeats drives that
    failed. With a `shard` only that share of the cases is driven. A progress bar is shown on terminals and in notebooks
    unless `progress` is False.

    A planner that takes longer than `act_timeout_s` for a decision has failed in that case. SUMO runs in separate
    processes, or those of `executor`. Raises PlannerError for a planner that cannot be found, and RegentsError, before
    anything is driven, for what cannot be read or measured.
    """
    cases = [cases] if isinstance(cases, Scenario) else cases
    folder = located(Path(cases)) if isinstance(cases, Path | str) else None
    if known_as is not None:
        require_id(known_as, "the name in the baseline (--as)")
    asked = _asked(folder, baseline, update, fail_on)
    if asked is not None and background != "log":
        raise RegentsError("a baseline needs all others on their tracks: leave out --background or --baseline")
    given = PlannerUnderTest.of(planner)
    scenarios = cases_in_turn(cases, shard.every)
    if not scenarios and shard == WHOLE:
        raise RegentsError("no cases to drive in, expected at least one (read them with load_suite)")
    if not scenarios:
        raise RegentsError(f"shard {shard} holds no case: the suite has fewer cases than there are shards")
    if (asked is not None or keep is not None) and not isinstance(scenarios, CasesOnDisk):
        require_distinct(scenario.id for scenario in scenarios)
    check(where, background=background, act_timeout_s=act_timeout_s)
    if background == "reactive":
        _require_networks(scenarios)
    drive = partial(
        drive_each, planner=given, act_timeout_s=act_timeout_s, where=where, executor=executor, background=background
    )
    settings: dict[str, str | float] = {"in": where, "act_timeout": act_timeout_s}
    settings |= {} if background == "log" else {"background": background}
    settings |= {} if shard == WHOLE else {"shard": str(shard)}
    drives = drive(scenarios) if keep is None else drive_once(Path(keep), scenarios, given, settings, drive, retry)
    found = tuple(progress_for(progress).each(drives, f"driving {given.name}", len(scenarios), drive_row))
    evaluation = Evaluation(given.name, where, found)
    return evaluation if asked is None else asked.held(evaluation, scenarios, known_as)


def _require_networks(scenarios: Sequence[Scenario]) -> None:
    """Raise RegentsError for cases without a SUMO network, if SUMO is to drive the others."""
    without = [case.id for case in scenarios if case.road.sumo_net is None]
    if without:
        raise RegentsError(
            f"{len(without)} of {len(scenarios)} cases have no SUMO network for SUMO to drive in (the first is "
            f"{without[0]}); expected cases that were recorded in SUMO, or --background log"
        )


def drive_row(drive: DriveResult) -> str:
    """The outcome of a drive in a line."""
    return f"{drive.case}: {drive.ending}"


@dataclass(frozen=True)
class _RegressionTest:
    suite: Path | None  # None: the cases are in memory
    file: Path | None  # None: there is no baseline
    baseline: Baseline
    limits: Limits
    update: bool

    def held(self, found: Evaluation, scenarios: Sequence[Scenario], known_as: str | None) -> Evaluation:
        """Judge every drive, and accept the outcomes if asked for."""
        name = known_as or found.planner
        before = self.baseline.of(name, found.where)
        verdicts = tuple(
            judge_drive(
                case.id, outcome_of_drive(drive, digest, case.dt), before.get(case.id), self.limits, drive.words
            )
            for case, digest, drive in zip(scenarios, hashes_of(scenarios), found.drives, strict=True)
        )
        listed = suite_cases(self.suite) if self.suite is not None else (*before, *(v.case for v in verdicts))
        said = BaselineComparison(
            self.file,
            verdicts,
            unused=tuple(unused(before, listed)),
            stranger=self.baseline.stranger(name, found.where),
            accepted=self._accepted(verdicts, name, found.where, listed) if self.update else None,
        )
        return replace(found, comparison=said)

    def _accepted(
        self, verdicts: Iterable[RegressionVerdict], name: str, where: Simulator, listed: Sequence[str]
    ) -> tuple[str, ...]:
        """Accept all outcomes but those of planners that failed, and return the changes."""
        accepted = [verdict for verdict in verdicts if not verdict.fails(update=True)]
        new: dict[str, DriveOutcome] = {verdict.case: verdict.now for verdict in accepted}
        assert self.file is not None
        update_baseline(self.file, lambda now: now.accepting(name, where, new, listed))
        return tuple(filter(None, map(changes, accepted)))


def _asked(folder: Path | None, baseline: Path | str | None, update: bool, fail_on: str) -> _RegressionTest | None:
    """The comparison to make; None where none is asked for. Raises RegentsError."""
    limits = parse_thresholds(fail_on)
    by_events = any(isinstance(limit, Forbidden) for limit in limits)
    suite = suite_of(folder) if folder is not None else None
    if baseline is None and not update:
        if any(isinstance(limit, Threshold) for limit in limits):
            raise RegentsError(f"{COMPARING} compare with a baseline: add --baseline")
        return _RegressionTest(suite, None, Baseline(), limits, update) if by_events else None
    if baseline is None and suite is None:
        raise RegentsError("cases in memory have no baseline of their own: name a file with `baseline`")
    file = Path(baseline) if baseline is not None else suite / FILE  # type: ignore[operator]
    if not file.exists() and not update and not by_events:
        raise RegentsError(f"baseline not found: {file} (make it with --update)")
    if update:
        require_place(file, "--baseline")
    return _RegressionTest(suite, file, load_baseline(file), limits, update)


def drive_once(
    folder: Path,
    scenarios: Sequence[Scenario],
    planner: PlannerUnderTest,
    settings: dict[str, str | float],
    drive: Callable[[Iterable[Scenario]], Iterator[DriveResult]],
    retry: bool = False,
) -> Iterator[DriveResult]:
    """The drives of all scenarios, in order; those that are missing in `folder` are made by `drive`.

    A saved drive has no `debug`. It is valid for a case, a planner's files, this version and these `settings`. With
    `retry` failed ones are repeated. Raises CaseError for a folder of other settings, RegentsError for a planner
    without a name.
    """
    if planner.source != planner.name:
        raise RegentsError("only drives of planners given by name can be kept: a change of an object cannot be seen")
    mine = identity("evaluate", {"planner": planner.name, **settings}, {planner.name: digest_of(planner)})
    with open_ledger(folder, mine) as ledger:
        windows = windows_of(scenarios)
        planned(ledger, windows)
        left = {unit.name: unit for unit in ledger.left(retry)}
        new = drive(map(windows.fetch, left))
        for name in windows.hashes:
            if name in left:
                made = replace(next(new), debug=())  # large, and drawn from a new drive where it is wanted
                why = made.error.partition("\n")[0]
                ledger.note(DoneUnit(left[name], said=msgspec.to_builtins(made), error=why))
            yield from_values(ledger.record.done[name].said, DriveResult)
        ledger.finish()
