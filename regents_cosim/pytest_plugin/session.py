"""A pytest session with suites: collects and judges their cases, reports, and saves what is accepted."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from regents_cosim.pytest_plugin.items import CaseItem, SuiteFile
from regents_cosim.pytest_plugin.settings import (
    MANIFEST,
    baseline_file,
    drives_ahead,
    is_worker,
    option,
    planner_name,
    suites,
    usage_errors,
    where,
)
from regents_cosim.pytest_plugin.strangers import named_paths, suites_alone

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable

    from regents_cosim.evaluation.regression.baseline import Baseline, DriveOutcome
    from regents_cosim.evaluation.regression.comparison import RegressionVerdict
    from regents_cosim.evaluation.regression.drives_ahead import DrivesAhead

_VERDICT = "regents_verdict"  # name of the attribute on a report
_IN_ALL = "regents_in_all"  # another: an error that all cases would have


class SuiteSession:
    """A pytest session with suites: collects their cases, judges the planner's drives, reports."""

    def __init__(self, config: pytest.Config) -> None:
        self.config = config
        self.planner = planner_name(config)
        self.known_as: str = self._known_as()
        self.update, self.strict = config.option.regents_update, config.option.regents_strict
        self._drives: DrivesAhead | None = None
        self.verdicts: dict[tuple[Path, str], RegressionVerdict] = {}
        if pytest.version_tuple < (9,):  # older versions skip the other tests of the folder that contains a suite
            raise pytest.UsageError(f"--regents-suite needs pytest 9 or newer, this is {pytest.__version__}")
        if not self.planner:
            raise pytest.UsageError("--regents-suite needs the planner that is tested: --regents-planner NAME")
        self.where = where(config)
        with usage_errors():
            self._read()
        self.chosen: dict[Path, list[str]] = {}  # cases by suite, where some are named

    def _read(self) -> None:
        from regents_cosim.cases.suite import suite_cases
        from regents_cosim.evaluation.regression.baseline import load_baseline, require_one_home, require_place
        from regents_cosim.evaluation.regression.thresholds import parse_thresholds

        self.cases = {suite.resolve(): suite_cases(suite) for suite in suites(self.config)}
        self.baseline_files = self._baseline_files()
        if self.update:
            for file in self.baseline_files.values():
                require_place(file, "--regents-baseline")
        require_one_home(self.cases, self.baseline_files)
        self.baselines: dict[Path, Baseline] = {f: load_baseline(f) for f in set(self.baseline_files.values())}
        self.limits = parse_thresholds(option(self.config, "fail_on"))

    def _known_as(self) -> str:
        """The name in the baseline. Raises UsageError for one that is empty."""
        from regents_cosim.checks.names import require_id

        named = self.config.option.regents_as
        with usage_errors():
            return option(self.config, "planner") if named is None else require_id(named, "--regents-as")

    def _baseline_files(self) -> dict[Path, Path]:
        from regents_cosim.evaluation.regression.baseline import FILE

        named = baseline_file(self.config)
        return {suite: named or suite / FILE for suite in self.cases}

    @property
    def drives(self) -> DrivesAhead:
        """The drives, prepared (and JAX imported) when they are first needed."""
        if self._drives is None:
            self._drives = drives_ahead(self.config, self.planner)
        return self._drives

    # --- collection and order ------------------------------------------------------------------

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection(self) -> None:
        """Remove named cases of suites from pytest's arguments, since it would walk through the folders above them."""
        if suites_alone(self.config):
            self.config.args.clear()
        rest: list[str] = []
        for argument, path in zip(self.config.args, named_paths(self.config, self.config.args), strict=True):
            suite = next((one for one in self.cases if path in (one, one / MANIFEST)), None)
            if suite is None or (self._is_here(suite) and path == suite):
                rest.append(argument)
            elif case := argument.partition("::")[2]:
                self._choose(suite, case, argument)
        self.config.args[:] = rest

    def _choose(self, suite: Path, case: str, argument: str) -> None:
        if case not in self.cases[suite]:
            raise pytest.UsageError(f"not found: {argument} (the suite lists no case of that name)")
        self.chosen.setdefault(suite, []).append(case)

    def pytest_ignore_collect(self, collection_path: Path) -> bool | None:
        """Ignore files in a suite, unless the session's own folder is the suite."""
        suite = collection_path.resolve()
        return True if suite in self.cases and not self._is_here(suite) else None

    def _is_here(self, suite: Path) -> bool:
        return self.config.invocation_params.dir.resolve().is_relative_to(suite)

    @pytest.hookimpl(wrapper=True)
    def pytest_make_collect_report(
        self, collector: pytest.Collector
    ) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
        """Put the suites directly below the session."""
        report = yield
        if isinstance(collector, pytest.Session) and report.passed:
            report.result += [SuiteFile.from_parent(collector, path=suite / MANIFEST, run=self) for suite in self.cases]
        return report

    def near(self, suite: Path) -> Path:
        """The folder whose `conftest.py` files apply to a suite: the nearest one with any."""
        known = self.config.pluginmanager._getconftestmodules  # there is no public function
        return next((folder for folder in (suite, *suite.parents) if known(folder)), suite)

    def pytest_runtestloop(self, session: pytest.Session) -> None:
        """Report a planner that does not exist once, as wrong usage, and not in every case."""
        if not is_worker(self.config) and self._drives_are_wanted and self._mine(session.items):
            with usage_errors():
                self.drives.begin(self._mine(session.items))

    def pytest_runtest_protocol(self, item: pytest.Item, nextitem: pytest.Item | None) -> None:
        """Note the next item: a worker of xdist knows only one ahead."""
        from regents_cosim.errors import RegentsError

        if is_worker(self.config) and self._drives_are_wanted and isinstance(item, CaseItem):
            with suppress(RegentsError, pytest.UsageError):  # running the case reports the error
                self.drives.begin(self._mine(filter(None, (item, nextitem))))

    @property
    def _drives_are_wanted(self) -> bool:
        """Whether tests are run, and not only collected or set up."""
        return not (self.config.option.collectonly or self.config.option.setuponly)  # of --setup-plan, too

    def _mine(self, items: Iterable[pytest.Item]) -> list[Path]:
        return [item.folder for item in items if isinstance(item, CaseItem)]

    # --- verdicts ------------------------------------------------------------------------------

    def judge(self, suite: Path, case: str) -> RegressionVerdict:
        """Compare the planner's drive of a case with the accepted outcome."""
        from regents_cosim.evaluation.regression.comparison import judge_drive

        baseline = self.baselines[self.baseline_files[suite]].of(self.known_as, self.where)
        now, words = self.drives.of(suite / case), self.drives.drive(suite / case).words
        return judge_drive(case, now, baseline.get(case), self.limits, words)

    def accepts(self, verdict: RegressionVerdict) -> bool:
        """Whether a case passes; with --regents-update everything passes but a failing planner."""
        return not verdict.fails(self.strict, self.update)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item, call: pytest.CallInfo[None]
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        """Attach the verdict to the report, which xdist sends from the worker to the controller."""
        report = yield
        if isinstance(item, CaseItem) and call.when == "call":
            import msgspec

            if item.verdict is not None:
                vars(report)[_VERDICT] = [str(item.suite), msgspec.to_builtins(item.verdict)]
            elif call.excinfo is not None and self._is_in_all(call.excinfo.value):
                vars(report)[_IN_ALL] = " ".join(str(call.excinfo.value).split())
        return report

    def _is_in_all(self, error: BaseException) -> bool:
        """Whether all cases would have an error: something is not installed, or the drives cannot be prepared."""
        from regents_cosim.errors import MissingDependencyError, RegentsError

        unprepared = self._drives is None and isinstance(error, RegentsError | pytest.UsageError)
        return unprepared or isinstance(error, MissingDependencyError)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Collect the verdicts, here or on the controller. Raises UsageError for an error that all cases would have."""
        if not is_worker(self.config) and _IN_ALL in vars(report):
            raise pytest.UsageError(vars(report)[_IN_ALL])
        if not is_worker(self.config) and _VERDICT in vars(report):
            from regents_cosim.checks.typed_values import from_values
            from regents_cosim.evaluation.regression.comparison import RegressionVerdict

            suite, values = vars(report)[_VERDICT]
            verdict = from_values(values, RegressionVerdict)
            self.verdicts[Path(suite), verdict.case] = verdict

    def pytest_sessionfinish(self) -> None:
        """End all running planners, and save accepted outcomes on the controller."""
        if self._drives is not None:
            self._drives.close()
        if self.update and self._drives_are_wanted and not is_worker(self.config):
            from regents_cosim.errors import RegentsError

            try:
                self._save()
            except RegentsError as error:
                pytest.exit(f"nothing accepted: {error}", returncode=4)
            except KeyboardInterrupt:  # each file is written as a whole or not at all
                pytest.exit("interrupted while outcomes were being accepted", returncode=pytest.ExitCode.INTERRUPTED)

    def _save(self) -> None:
        from regents_cosim.cases.suite import suite_cases
        from regents_cosim.evaluation.regression.baseline import update_baseline

        for file in self.baselines:
            suites = [suite for suite, its in self.baseline_files.items() if its == file]
            new = {case: v.now for (suite, case), v in self.verdicts.items() if suite in suites and self.accepts(v)}

            def accept(now: Baseline, suites: list[Path] = suites, new: dict[str, DriveOutcome] = new) -> Baseline:
                listed = [case for suite in suites for case in suite_cases(suite)]
                return now.accepting(self.known_as, self.where, new, listed)

            update_baseline(file, accept)

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Print what the failures do not show."""
        from regents_cosim.cases.shipped import is_own
        from regents_cosim.evaluation.regression.comparison import changes, how_to_accept, tally, unused

        say = terminalreporter.write_line
        if not self.verdicts:
            return
        terminalreporter.section(f"regents: {self.planner} in {self.where}")
        say(tally(list(self.verdicts.values())))
        told = [("improved", "improved (accept with --regents-update)"), ("known_failure", "known to fail")]
        for status, title in () if self.update else told:
            for case in sorted(case for (_, case), v in self.verdicts.items() if v.status == status):
                say(f"{title}: {case}")
        accepting = "--regents-update"
        if not all(map(is_own, self.baseline_files.values())):
            accepting += " --regents-baseline FILE"
        if not self.update and (hint := how_to_accept(self.verdicts.values(), accepting)):
            say(hint)
        for file, baseline in self.baselines.items():
            listed = [case for suite, its in self.baseline_files.items() if its == file for case in self.cases[suite]]
            if renamed := baseline.stranger(self.known_as, self.where):
                say(renamed)
            for case in unused(baseline.of(self.known_as, self.where), listed):
                say(f"{'removed' if self.update else 'unused'} baseline entry: {case} in {file}")
        if self.update:
            lines = list(filter(None, (changes(v) for v in self.verdicts.values() if self.accepts(v))))
            say(f"accepted {len(lines)} changes")
            for line in lines:
                say(f"  {line}")
