"""What a session's options and ini keys say."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from regents_cosim.evaluation.regression.drives_ahead import DrivesAhead
    from regents_cosim.planners.under_test import AnyPlanner


MANIFEST = "suite.json"  # as `cases.manifest` has it, which would import NumPy here
WHERE = ("mirror", "sumo", "highway")


def suites(config: pytest.Config) -> list[Path]:
    """Folders of the suites that are named."""
    given = [from_here(config, path) for path in config.known_args_namespace.regents_suite or ()]
    return given or [Path(path) for path in config.getini("regents_suite")]


def from_here(config: pytest.Config, path: str) -> Path:
    """A path of the command line, or what comes with the package."""
    from regents_cosim.cases.shipped import located

    return config.invocation_params.dir / located(Path(path))


def option(config: pytest.Config, name: str) -> str:
    """What the command line says, else the ini key of the same name."""
    return getattr(config.option, f"regents_{name}") or config.getini(f"regents_{name}")


def drives_ahead(config: pytest.Config, planner: AnyPlanner, margin: bool = False) -> DrivesAhead:
    """The drives of one planner, as the session asks for them."""
    from regents_cosim.evaluation.regression.drives_ahead import DrivesAhead

    alone = 1 if is_worker(config) else None  # xdist has a process for each core already
    return DrivesAhead(planner, where(config), _act_timeout_s(config), alone, margin)


def _act_timeout_s(config: pytest.Config) -> float:
    given = getattr(config.option, "regents_act-timeout")
    if given is not None:
        return given
    written = config.getini("regents_act_timeout")
    try:
        return float(written)
    except ValueError:
        raise pytest.UsageError(f"regents_act_timeout = {written}, expected a number of seconds") from None


def where(config: pytest.Config) -> Any:
    """The simulator that it drives in. Raises UsageError."""
    found = option(config, "in")
    if found not in WHERE:
        raise pytest.UsageError(f"regents_in = {found}, expected one of {', '.join(WHERE)}")
    return found


def is_worker(config: pytest.Config) -> bool:
    """Whether this is a worker of xdist, whose results the controller gathers."""
    return hasattr(config, "workerinput")
