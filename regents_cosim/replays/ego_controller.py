"""The interface of ego controllers in simulator replays, and the checks of their answers."""

from collections.abc import Callable
from dataclasses import astuple
from traceback import format_exception
from typing import Protocol, TypeVar, runtime_checkable

import numpy as np

from regents_cosim.errors import DriveError
from regents_cosim.planners.interface import Placement, Snapshot
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.foreign_code import foreign_code, said_by

_R = TypeVar("_R")


@runtime_checkable
class EgoController(Protocol):
    """Drives the ego in closed loop. It is sent to a worker process, so it must be picklable until `start`."""

    def start(self, scenario: Scenario) -> None:
        """Prepare to drive through `scenario`."""
        ...

    def advance(self, step: int, seen: Snapshot) -> tuple[float, float, float, float]:
        """The ego's x, y, yaw and speed (`Placement`) at `step` + 1, given the simulator's state at `step`."""
        ...


def decision(driver: EgoController, step: int, seen: Snapshot) -> Placement:
    """The state in which the controller puts the ego after `step`.

    Raises DriveError where the driver fails or returns no state.
    """
    found = ask(lambda: driver.advance(step, Snapshot(*(np.copy(values) for values in seen))), f"at step {step}")
    try:
        ego = Placement(*map(float, found))
    except (TypeError, ValueError) as error:
        raise DriveError(
            f"the planner answered {found!r} at step {step}, expected four numbers: x, y, yaw, speed"
        ) from error
    if not np.isfinite(astuple(ego)).all() or ego.speed < 0:
        raise DriveError(f"the planner put the ego at {ego} after step {step}, expected finite numbers and speed >= 0")
    return ego


def ask(question: Callable[[], _R], when: str) -> _R:
    """Call code from outside the package. Raises DriveError where it fails."""

    def failed(error: BaseException) -> DriveError:
        return DriveError(f"the planner failed {when} ({said_by(error)})", "".join(format_exception(error)))

    with foreign_code(failed):
        return question()
