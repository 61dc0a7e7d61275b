"""The value of the fixture `regents`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from regents_cosim.pytest_plugin.session import SuiteSession
from regents_cosim.pytest_plugin.settings import drives_ahead, from_here, option

if TYPE_CHECKING:
    from regents_cosim.evaluation.drives.driving import DriveResult
    from regents_cosim.evaluation.regression.drives_ahead import DrivesAhead
    from regents_cosim.planners.under_test import AnyPlanner
    from regents_cosim.scenario import Scenario


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
        given = option(self._config, "planner") if planner is None else planner
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
