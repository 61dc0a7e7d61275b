"""The pytest plugin: every case of a suite is a test of a planner.

    pytest --regents-suite scenarios/standard --regents-planner my_package.planner:Mine

Loading it imports neither NumPy nor JAX; without `--regents-suite` it does nothing. It needs pytest 9. This module
has the hooks and the fixture; `evaluation.regression.comparison` decides what a regression is.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from regents_cosim.pytest_plugin.session import SuiteSession
from regents_cosim.pytest_plugin.settings import WHERE, drives_ahead, from_here, planner_name, suites
from regents_cosim.pytest_plugin.strangers import conftests_of_tests_left_out, require_no_strangers_code
from regents_cosim.system.c_exit import SAID, fail_at_exit_of_c

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator

    from regents_cosim.evaluation.drives.driving import DriveResult
    from regents_cosim.evaluation.regression.drives_ahead import DrivesAhead
    from regents_cosim.planners.under_test import AnyPlanner
    from regents_cosim.scenario.scenario import Scenario

_RUN = "regents-run"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the group of options; options that apply to all runs of a project also have an ini key of the same name."""
    group = parser.getgroup("regents", "regression tests of driving planners (regents_cosim)")

    def add(name: str, text: str, **how: Any) -> None:
        group.addoption(f"--regents-{name}", dest=f"regents_{name.replace('-', '_')}", help=text, **how)

    add(
        "suite",
        "folder of cases to run as tests, alone where no tests are named; repeatable",
        action="append",
        metavar="PATH",
    )
    add("planner", "system under test, as in `regents evaluate --planner`", metavar="NAME")
    add("in", "where it drives: mirror (default), sumo or highway", choices=WHERE)
    add("baseline", "file of accepted outcomes (default: baseline.json in each suite)", metavar="PATH")
    add("update", "accept what the planner does now, and print what changed", action="store_true")
    add(
        "fail-on",
        "events that fail a planner with or without a baseline, and metrics that may get so much worse, "
        'e.g. "telling min_ttc_s:-5%%"',
        metavar="EXPR",
    )
    add("as", "name by which the baseline knows the planner (default: as in --regents-planner)", metavar="NAME")
    add("strict", "fail on improvements that are not accepted yet", action="store_true")
    add("act-timeout", "a planner that takes longer over one decision has failed (default: 10)", type=float,
        metavar="SECONDS")  # fmt: skip
    parser.addini("regents_suite", "folders of cases to run as tests", type="args")
    parser.addini("regents_planner", "system under test")
    parser.addini("regents_in", "where it drives: mirror, sumo or highway", default="mirror")
    parser.addini("regents_act_timeout", "a planner that takes longer over one decision has failed [s]", default="10")
    parser.addini("regents_baseline", "file of accepted outcomes", type="args")
    parser.addini("regents_fail_on", "events that fail a planner, and which metrics may get how much worse")


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_load_initial_conftests(early_config: pytest.Config) -> Generator[None, object, object]:
    """Check the suites' surroundings before pytest runs any file."""
    _leave_asserts_as_they_are(early_config)
    require_no_strangers_code(early_config)
    with conftests_of_tests_left_out(early_config):
        return (yield)


def _leave_asserts_as_they_are(config: pytest.Config) -> None:
    """Keep pytest from rewriting the asserts of this package, as it does in packages with a plugin.

    It takes time, and fails by chance where two threads import (SystemError, python/cpython#106905).
    """
    marked: set[str] = getattr(config.pluginmanager.rewrite_hook, "_must_rewrite", set())  # there is no public function
    marked.discard("regents_cosim")


def pytest_configure(config: pytest.Config) -> None:
    """Register the marker, and the session if a suite is named."""
    config.addinivalue_line(
        "markers",
        "regents(suite, collision_type, network, planner, TAG): a case of a suite; choose with "
        '-m "regents(collision_type=\'t_bone\')" or -m "regents(cut_in=True)", or with -k by the same words',
    )
    if suites(config) and not config.option.help:
        config.pluginmanager.register(SuiteSession(config), _RUN)
        _tell_of_an_exit_in_c(config)
    elif config.option.regents_update:
        raise pytest.UsageError("--regents-update needs the cases whose outcomes it accepts: --regents-suite PATH")


def _tell_of_an_exit_in_c(config: pytest.Config) -> None:
    """End with an error where a planner calls C's `exit`, and say so where pytest does not capture it."""
    uncaptured = os.dup(2)
    config.add_cleanup(lambda: os.close(uncaptured))
    config.add_cleanup(fail_at_exit_of_c(lambda: os.write(uncaptured, f"\nregents: {SAID}\n".encode())))


class Regents:
    """The value of the fixture `regents`: drives a planner through cases."""

    def __init__(self, config: pytest.Config, run: SuiteSession | None) -> None:
        self._run = run
        self._config = config
        self._others: dict[int | str, tuple[Any, DrivesAhead]] = {}

    @property
    def suite(self) -> tuple[Path, ...]:
        """Folders of all cases of the suites named by --regents-suite."""
        return tuple(
            folder / case for folder, cases in (self._run.cases if self._run else {}).items() for case in cases
        )

    def drive(self, case: Path | str | Scenario, planner: AnyPlanner | None = None) -> DriveResult:
        """Let the planner, by default that of --regents-planner, drive a case: a folder or a Scenario.

        `planner` is a name or an object, as `regents_cosim.attack` takes it.
        """
        given = planner_name(self._config) if planner is None else planner
        if not given:
            raise pytest.UsageError("name the planner: regents.drive(case, planner=...), or --regents-planner NAME")
        return self._drives(given).drive(from_here(self._config, case) if isinstance(case, str) else case)

    def _drives(self, planner: AnyPlanner) -> DrivesAhead:
        if self._run and isinstance(planner, str) and planner == self._run.planner:
            return self._run.drives
        key = planner if isinstance(planner, str) else id(planner)
        if key not in self._others:  # keep the object, so that its id is not reused
            self._others[key] = planner, drives_ahead(self._config, planner)
        return self._others[key][1]

    def close(self) -> None:
        """End all running planners."""
        for _, drives in self._others.values():
            drives.close()


@pytest.fixture(scope="session")
def regents(pytestconfig: pytest.Config) -> Iterator[Regents]:
    """Fixture that lets a planner drive cases: `regents.drive(case)`, `regents.suite`."""
    run = pytestconfig.pluginmanager.get_plugin(_RUN)
    found = Regents(pytestconfig, run)
    yield found
    found.close()
