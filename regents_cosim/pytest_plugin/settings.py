"""Reads a session's options and ini keys."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from regents_cosim.evaluation.regression.drives_ahead import DrivesAhead
    from regents_cosim.planners.under_test import AnyPlanner


MANIFEST = "suite.json"  # as in `cases.manifest`, whose import would load NumPy
WHERE = ("mirror", "sumo", "highway")


def suites(config: pytest.Config) -> list[Path]:
    """The folders of the suites that are named."""
    given = [from_here(config, path) for path in config.known_args_namespace.regents_suite or ()]
    return given or [Path(path) for path in config.getini("regents_suite")]


def from_here(config: pytest.Config, path: str) -> Path:
    """A path of the command line, or of a shipped suite."""
    from regents_cosim.cases.shipped import located

    return config.invocation_params.dir / located(Path(path))


def option(config: pytest.Config, name: str) -> str:
    """The value of an option on the command line, else of the ini key of the same name."""
    return getattr(config.option, f"regents_{name}") or config.getini(f"regents_{name}")


def drives_ahead(config: pytest.Config, planner: AnyPlanner) -> DrivesAhead:
    """The drives of one planner, with the session's settings."""
    from regents_cosim.evaluation.regression.drives_ahead import DrivesAhead

    alone = 1 if is_worker(config) else None  # xdist already runs one process per core
    return DrivesAhead(planner, where(config), _act_timeout_s(config), alone)


def _act_timeout_s(config: pytest.Config) -> float:
    given = config.option.regents_act_timeout
    if given is not None:
        return given
    written = config.getini("regents_act_timeout")
    try:
        return float(written)
    except ValueError:
        raise pytest.UsageError(f"regents_act_timeout = {written}, expected a number of seconds") from None


def where(config: pytest.Config) -> Any:
    """The simulator to drive in. Raises UsageError."""
    found = option(config, "in")
    if found not in WHERE:
        raise pytest.UsageError(f"regents_in = {found}, expected one of {', '.join(WHERE)}")
    return found


def is_worker(config: pytest.Config) -> bool:
    """Whether this process is a worker of xdist, whose results the controller collects."""
    return hasattr(config, "workerinput")
