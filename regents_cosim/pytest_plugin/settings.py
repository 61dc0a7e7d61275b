"""Reads a session's options and ini keys."""

from __future__ import annotations

import os
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

    from regents_cosim.evaluation.regression.drives_ahead import DrivesAhead
    from regents_cosim.planners.under_test import AnyPlanner


MANIFEST = "suite.json"  # as in `cases.manifest`, whose import would load NumPy
WHERE = ("mirror", "sumo", "highway")


@contextmanager
def usage_errors() -> Iterator[None]:
    """Turn our errors into usage errors of pytest: one line, exit code 4."""
    from regents_cosim.errors import RegentsError

    try:
        yield
    except RegentsError as error:
        raise pytest.UsageError(" ".join(str(error).split())) from error


def suites(config: pytest.Config) -> list[Path]:
    """The folders of the suites that are named. Raises UsageError."""
    given = [from_here(config, path) for path in config.known_args_namespace.regents_suite or ()]
    return given or from_ini(config, "suite")


def baseline_file(config: pytest.Config) -> Path | None:
    """The file of accepted outcomes that is named. Raises UsageError."""
    if config.option.regents_baseline:
        return from_here(config, config.option.regents_baseline)
    named = from_ini(config, "baseline")
    if len(named) > 1:
        names = ", ".join(str(path) for path in named)
        raise pytest.UsageError(f"regents_baseline = {names}, expected one file (put a name with spaces in quotes)")
    return named[0] if named else None


def from_here(config: pytest.Config, path: str) -> Path:
    """A path of the command line, or of a shipped suite. Raises UsageError."""
    return _located(config.invocation_params.dir, path)


def from_ini(config: pytest.Config, name: str) -> list[Path]:
    """The paths of an ini key, or of shipped suites. Raises UsageError."""
    start = config.inipath.parent if config.inipath else config.invocation_params.dir
    return [_located(start, path) for path in config.getini(f"regents_{name}")]


def _located(start: Path, path: str) -> Path:
    from regents_cosim.cases.shipped import located

    with usage_errors():
        return start / located(Path(path))


def option(config: pytest.Config, name: str) -> str:
    """The value of an option on the command line, else of the ini key of the same name."""
    return getattr(config.option, f"regents_{name}") or config.getini(f"regents_{name}")


def planner_name(config: pytest.Config) -> str:
    """The planner's name; FILE.py:CLASS in the ini file as seen from here, if the file lies where suites do."""
    if config.option.regents_planner or config.inipath is None:
        return option(config, "planner")
    named = config.getini("regents_planner")
    file, _, attribute = named.rpartition(":")
    found = config.inipath.parent / file
    return f"{os.path.relpath(found, config.invocation_params.dir)}:{attribute}" if found.is_file() else named


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
