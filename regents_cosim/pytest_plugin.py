"""The pytest plugin: every case of a suite is a test of a planner.

    pytest --regents-suite scenarios/standard --regents-planner my_package.planner:Mine

Loading it imports neither NumPy nor JAX; without `--regents-suite` it does nothing. What a regression
is says `evaluation.regression.comparison`; here are only the hooks. Needs pytest 8.3 or newer.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import pytest

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable, Iterator

    from regents_cosim.evaluation.drives.driving import Drive
    from regents_cosim.evaluation.regression.baseline import Baseline, DriveOutcome
    from regents_cosim.evaluation.regression.comparison import RegressionVerdict
    from regents_cosim.evaluation.regression.drives_ahead import DrivesAhead
    from regents_cosim.planners.under_test import AnyPlanner
    from regents_cosim.scenario import Scenario

_RUN = "regents-run"
_VERDICT = "regents_verdict"  # on a report
_WHERE = ("mirror", "sumo", "highway")


def pytest_addoption(parser: pytest.Parser) -> None:
    """One group of options; those that are no matter of a single run have an ini key of the same name."""
    group = parser.getgroup("regents", "regression tests of driving planners (regents_cosim)")

    def add(name: str, text: str, **how: Any) -> None:
        group.addoption(f"--regents-{name}", dest=f"regents_{name}", help=text, **how)

    add("suite", "folder of cases to run as tests; may be given more than once", action="append", metavar="PATH")
    add("planner", "system under test, as in `regents evaluate --planner`", metavar="NAME")
    add("in", "where it drives: mirror (default), sumo or highway", choices=_WHERE)
    add("baseline", "file of accepted outcomes (default: baseline.json in each suite)", metavar="PATH")
    add("update", "accept what the planner does now, and print what changed", action="store_true")
    add("fail", 'also fail on metrics that get worse, e.g. "min_ttc_s:-5%% collision:+0"', metavar="EXPR")
    add("strict", "fail on improvements that are not accepted yet", action="store_true")
    add("margin", "measure how little of an attack makes the planner fail (up to six more drives per case)",
        action="store_true")  # fmt: skip
    add("act-timeout", "a planner that takes longer over one decision has failed (default: 10)", type=float,
        metavar="SECONDS")  # fmt: skip
    parser.addini("regents_suite", "folders of cases to run as tests", type="paths")
    parser.addini("regents_planner", "system under test")
    parser.addini("regents_in", "where it drives: mirror, sumo or highway", default="mirror")
    parser.addini("regents_act_timeout", "a planner that takes longer over one decision has failed [s]", default="10")
    parser.addini("regents_baseline", "file of accepted outcomes", type="paths")
    parser.addini("regents_fail", "which metrics may get how much worse")


def pytest_configure(config: pytest.Config) -> None:
    """Register the marker, and where a suite is named everything else."""
    config.addinivalue_line(
        "markers",
        "regents(suite, kind, network, planner): a case of a suite; choose with -m \"regents(kind='t_bone')\", "
        "or with -k by the same words",
    )
    if _suites(config) and not config.option.help:
        config.pluginmanager.register(_SuiteSession(config), _RUN)


def _refuse_code(suite: Path) -> None:
    """A suite is data: pytest is not to run what it holds, or to take its configuration from there."""
    from regents_cosim.cases.suite_code import code_for_pytest
    from regents_cosim.errors import RegentsError

    if found := code_for_pytest(suite):
        raise RegentsError(
            f"{suite} holds {', '.join(found)}, which pytest would run or obey: remove it, or start pytest in the "
            "suite's own folder if it is yours"
        )


def _suites(config: pytest.Config) -> list[Path]:
    given = [_from_here(config, path) for path in config.option.regents_suite or ()]
    return given or [Path(path) for path in config.getini("regents_suite")]


def _from_here(config: pytest.Config, path: str) -> Path:
    """A path of the command line, or what comes with the package."""
    from regents_cosim.cases.shipped import located

    return config.invocation_params.dir / located(Path(path))


@pytest.fixture(scope="session")
def regents(pytestconfig: pytest.Config) -> Iterator[Regents]:
    """Drives a planner through cases: `regents.drive(case)`, `regents.suite`."""
    run = pytestconfig.pluginmanager.get_plugin(_RUN)
    found = Regents(pytestconfig, run)
    yield found
    found.close()


class Regents:
    """What the fixture `regents` gives."""

    def __init__(self, config: pytest.Config, run: _SuiteSession | None) -> None:
        self._run = run
        self._config = config
        self._others: dict[int | str, tuple[Any, DrivesAhead]] = {}

    @property
    def suite(self) -> tuple[Path, ...]:
        """Folders of all cases of the suites named by --regents-suite."""
        return tuple(
            folder / case for folder, cases in (self._run.cases if self._run else {}).items() for case in cases
        )

    def drive(self, case: Path | str | Scenario, planner: AnyPlanner | None = None) -> Drive:
        """Let the planner, by default that of --regents-planner, drive a case: a folder or a Scenario.

        `planner` is a name or an object, as `regents_cosim.attack` takes it.
        """
        given = _option(self._config, "planner") if planner is None else planner
        if not given:
            raise pytest.UsageError("name the planner: regents.drive(case, planner=...), or --regents-planner NAME")
        return self._drives(given).drive(_from_here(self._config, case) if isinstance(case, str) else case)

    def _drives(self, planner: AnyPlanner) -> DrivesAhead:
        if self._run and isinstance(planner, str) and planner == self._run.planner:
            return self._run.drives
        key = planner if isinstance(planner, str) else id(planner)
        if key not in self._others:  # with the object, whose id is not given away meanwhile
            self._others[key] = planner, _drives_ahead(self._config, planner)
        return self._others[key][1]

    def close(self) -> None:
        """End what is still running."""
        for _, drives in self._others.values():
            drives.close()


def _option(config: pytest.Config, name: str) -> str:
    return getattr(config.option, f"regents_{name}") or config.getini(f"regents_{name}")


def _drives_ahead(config: pytest.Config, planner: AnyPlanner, margin: bool = False) -> DrivesAhead:
    from regents_cosim.evaluation.regression.drives_ahead import DrivesAhead

    alone = 1 if _is_worker(config) else None  # xdist has a process for each core already
    return DrivesAhead(planner, _where(config), _act_timeout_s(config), alone, margin)


def _act_timeout_s(config: pytest.Config) -> float:
    given = getattr(config.option, "regents_act-timeout")
    if given is not None:
        return given
    written = config.getini("regents_act_timeout")
    try:
        return float(written)
    except ValueError:
        raise pytest.UsageError(f"regents_act_timeout = {written}, expected a number of seconds") from None


def _where(config: pytest.Config) -> Any:
    where = _option(config, "in")
    if where not in _WHERE:
        raise pytest.UsageError(f"regents_in = {where}, expected one of {', '.join(_WHERE)}")
    return where


def _is_worker(config: pytest.Config) -> bool:
    """Whether this is a worker of xdist, whose results the controller gathers."""
    return hasattr(config, "workerinput")


class _SuiteSession:
    """One session with suites: collects their cases, judges what the planner does, reports."""

    def __init__(self, config: pytest.Config) -> None:
        self.config = config
        self.planner = _option(config, "planner")
        self.update, self.strict = config.option.regents_update, config.option.regents_strict
        self.margin = config.option.regents_margin
        self._drives: DrivesAhead | None = None
        self.verdicts: dict[tuple[Path, str], RegressionVerdict] = {}
        if pytest.version_tuple < (9,):  # older ones leave out the other tests of the folder that a suite lies in
            raise pytest.UsageError(f"--regents-suite needs pytest 9 or newer, this is {pytest.__version__}")
        if not self.planner:
            raise pytest.UsageError("--regents-suite needs the planner that is tested: --regents-planner NAME")
        self.where = _where(config)
        with _usage_errors():
            self._read()
        here = config.invocation_params.dir
        named = {Path(here, argument.partition("::")[0]).resolve() for argument in config.args}
        config.args += [str(suite / "suite.json") for suite in self.cases if suite / "suite.json" not in named]

    def _read(self) -> None:
        from regents_cosim.cases.shipped import require_own
        from regents_cosim.cases.suite import suite_cases
        from regents_cosim.evaluation.regression.baseline import load_baseline, require_one_home
        from regents_cosim.evaluation.regression.comparison import thresholds_measurable
        from regents_cosim.evaluation.regression.thresholds import parse_thresholds

        self.cases = {suite.resolve(): suite_cases(suite) for suite in _suites(self.config)}
        for suite in self.cases:
            _refuse_code(suite)
        self.baseline_files = self._baseline_files()
        if self.update:
            for file in self.baseline_files.values():
                require_own(file, "--regents-baseline")
        require_one_home(self.cases, self.baseline_files)
        self.baselines: dict[Path, Baseline] = {f: load_baseline(f) for f in set(self.baseline_files.values())}
        self.thresholds = parse_thresholds(_option(self.config, "fail"))
        thresholds_measurable(self.thresholds, self.margin)

    def _baseline_files(self) -> dict[Path, Path]:
        from regents_cosim.evaluation.regression.baseline import FILE

        given, from_ini = self.config.option.regents_baseline, self.config.getini("regents_baseline")
        one = _from_here(self.config, given) if given else Path(from_ini[0]) if from_ini else None
        return {suite: one or suite / FILE for suite in self.cases}

    @property
    def drives(self) -> DrivesAhead:
        """Where the drives come from; made, and JAX imported, when it is first asked for."""
        if self._drives is None:
            self._drives = _drives_ahead(self.config, self.planner, self.margin)
        return self._drives

    # --- collection and order ------------------------------------------------------------------

    def pytest_collect_file(self, file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
        """The manifests of the suites, and no other file."""
        if file_path.name == "suite.json" and file_path.resolve().parent in self.cases:
            return SuiteFile.from_parent(parent, path=file_path, run=self)
        return None

    def pytest_runtestloop(self, session: pytest.Session) -> None:
        """A planner that does not exist is wrong usage, said once and not by every case."""
        if not _is_worker(self.config) and not self.config.option.collectonly and self._mine(session.items):
            with _usage_errors():
                self.drives.begin(self._mine(session.items))

    def pytest_runtest_protocol(self, item: pytest.Item, nextitem: pytest.Item | None) -> None:
        """A worker of xdist knows one item ahead."""
        if _is_worker(self.config) and isinstance(item, CaseItem):
            self.drives.begin(self._mine(filter(None, (item, nextitem))))

    def _mine(self, items: Iterable[pytest.Item]) -> list[Path]:
        return [item.folder for item in items if isinstance(item, CaseItem)]

    # --- verdicts ------------------------------------------------------------------------------

    def judge(self, suite: Path, case: str) -> RegressionVerdict:
        """What the planner does in a case now, held against what was accepted."""
        from regents_cosim.evaluation.regression.comparison import judge_drive

        baseline = self.baselines[self.baseline_files[suite]].of(self.planner, self.where)
        return judge_drive(case, self.drives.of(suite / case), baseline.get(case), self.thresholds)

    def accepts(self, verdict: RegressionVerdict) -> bool:
        """Whether its item passes; what an update accepts is anything but a planner that fails."""
        if self.update:
            return verdict.now.outcome != "planner_error"
        return not verdict.fails(self.strict)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item, call: pytest.CallInfo[None]
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        """The verdict travels with the report, from a worker of xdist to the controller as well."""
        report = yield
        if isinstance(item, CaseItem) and call.when == "call" and item.verdict is not None:
            import msgspec

            vars(report)[_VERDICT] = [str(item.suite), msgspec.to_builtins(item.verdict)]
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Gather the verdicts, here or on the controller."""
        if not _is_worker(self.config) and _VERDICT in vars(report):
            import msgspec

            from regents_cosim.evaluation.regression.comparison import RegressionVerdict

            suite, values = vars(report)[_VERDICT]
            verdict = msgspec.convert(values, RegressionVerdict)
            self.verdicts[Path(suite), verdict.case] = verdict

    def pytest_sessionfinish(self) -> None:
        """End what is still running; accept, on the controller alone."""
        if self._drives is not None:
            self._drives.close()
        if self.update and not _is_worker(self.config):
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
                return now.accepting(self.planner, self.where, new, listed)

            update_baseline(file, accept)

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """What is worth knowing besides the failures."""
        from regents_cosim.evaluation.regression.comparison import changes, tally, unused

        if not self.verdicts:
            return
        say = terminalreporter.write_line
        terminalreporter.section(f"regents: {self.planner} in {self.where}")
        say(tally(list(self.verdicts.values())))
        told = [("improved", "improved (accept with --regents-update)"), ("known_failure", "known to fail")]
        for status, title in () if self.update else told:
            for case in sorted(case for (_, case), v in self.verdicts.items() if v.status == status):
                say(f"{title}: {case}")
        for file, baseline in self.baselines.items():
            listed = [case for suite, its in self.baseline_files.items() if its == file for case in self.cases[suite]]
            if renamed := baseline.stranger(self.planner, self.where):
                say(renamed)
            for case in unused(baseline.of(self.planner, self.where), listed):
                say(f"{'removed' if self.update else 'unused'} baseline entry: {case} in {file}")
        if self.update:
            lines = list(filter(None, (changes(v) for v in self.verdicts.values() if self.accepts(v))))
            say(f"accepted {len(lines)} changes")
            for line in lines:
                say(f"  {line}")


class SuiteFile(pytest.File):
    """suite.json: its items are the cases."""

    def __init__(self, *, run: _SuiteSession, **rest: Any) -> None:
        super().__init__(**rest)
        self.run = run

    def collect(self) -> Iterator[pytest.Item]:
        """The cases in the order of the manifest."""
        suite = self.path.resolve().parent
        for case in self.run.cases[suite]:
            yield CaseItem.from_parent(self, name=case, run=self.run, suite=suite)


class CaseItem(pytest.Item):
    """One case: passes unless the planner got worse in it."""

    def __init__(self, *, run: _SuiteSession, suite: Path, **rest: Any) -> None:
        super().__init__(**rest)
        self.run, self.suite, self.folder = run, suite, suite / self.name
        self.verdict: RegressionVerdict | None = None
        self.adversary, self.advice = "", ""
        self.properties: list[tuple[str, str]] = []
        self._mark()

    def _mark(self) -> None:
        from regents_cosim.errors import CaseError
        from regents_cosim.evaluation.suites.cards import card_of

        try:
            card = card_of(self.folder)
        except CaseError:
            return  # said when it runs
        self.adversary, self.properties = card.adversary_in_words, card.properties
        self.add_marker(
            pytest.mark.regents(suite=self.suite.name, kind=card.kind, network=card.network, planner=card.planner)
        )
        self.extra_keyword_matches |= {card.kind, card.network}

    def runtest(self) -> None:
        """Drive and judge."""
        self.verdict = self.run.judge(self.suite, self.name)
        now = self.verdict.now
        self.user_properties += [("verdict", self.verdict.status), ("outcome", now.outcome), *now.metrics.items()]
        self.user_properties += self.properties
        if not self.run.accepts(self.verdict):
            if now.outcome == "collision":
                self.advice = self.run.drives.advice(self.folder)
                self.user_properties += [("advice", self.advice)] if self.advice else []
            raise _RegressionError(self.verdict)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Case, adversary, what happened, baseline and now, and how to see it; no traceback of ours."""
        from regents_cosim.errors import RegentsError
        from regents_cosim.evaluation.regression.comparison import explain

        if isinstance(excinfo.value, _RegressionError):
            folder = _relative(self.folder, self.config.invocation_params.dir)
            of, (planner, where) = excinfo.value.verdict, (self.run.planner, self.run.where)
            return explain(of, folder, planner, where, self.adversary, self.advice)
        if isinstance(excinfo.value, RegentsError):
            return f"{self.name}: {excinfo.value}"
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """The heading of a failure."""
        return self.path, None, f"{self.suite.name}::{self.name}"


class _RegressionError(Exception):
    """A verdict that is no pass."""

    def __init__(self, verdict: RegressionVerdict) -> None:
        super().__init__("; ".join(verdict.reasons))
        self.verdict = verdict


class _usage_errors:  # noqa: N801  a context manager reads as a verb
    """Our errors as pytest's wrong usage: one line, exit code 4."""

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        from regents_cosim.errors import RegentsError

        if isinstance(error, RegentsError):
            _complain(error)


def _complain(error: BaseException) -> NoReturn:
    raise pytest.UsageError(" ".join(str(error).split())) from error


def _relative(folder: Path, start: Path) -> Path:
    """As short as it can be pasted where pytest was started."""
    return folder.relative_to(start) if folder.is_relative_to(start) else folder
