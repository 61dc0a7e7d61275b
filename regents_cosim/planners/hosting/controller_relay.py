"""Let a simulator in a worker process use a planner that cannot leave this process.

The worker calls back over a local socket that only processes with its key may open. POSIX only.
"""

import secrets
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import AuthenticationError
from multiprocessing.connection import Client, Listener
from typing import Any

from regents_cosim.errors import DriveError, RegentsError
from regents_cosim.planners.controllers import PlannerControllers
from regents_cosim.planners.interface import Debug, Snapshot
from regents_cosim.scenario import Scenario


@dataclass(frozen=True)
class Relay:
    """The address at which a worker reaches the controllers."""

    address: str
    key: bytes

    @contextmanager
    def lend(self) -> "Iterator[RelayedController]":
        """Lend a controller for one drive."""
        with Client(self.address, family="AF_UNIX", authkey=self.key) as line:
            yield RelayedController(line)


class RelayedController:
    """A controller that passes calls on over a connection."""

    def __init__(self, line: Any) -> None:
        self._line = line

    def start(self, scenario: Scenario) -> None:
        """Prepare for `scenario`. Raises DriveError where the planner fails."""
        self._asked("start", scenario)

    def advance(self, step: int, seen: Snapshot) -> tuple[float, float, float, float]:
        """The ego's (x, y, yaw, speed) at `step` + 1. Raises DriveError where the planner fails."""
        return self._asked("advance", step, seen)

    def thoughts(self) -> dict[int, Debug]:
        """What the planner has thought in this drive, by step."""
        return self._asked("thoughts")

    def _asked(self, *question: Any) -> Any:
        self._line.send(question)
        answer = self._line.recv()
        if isinstance(answer, RegentsError):
            raise answer
        return answer


@contextmanager
def relayed(drivers: PlannerControllers) -> Iterator[Relay]:
    """Serve `drivers` as long as the context lasts; any number of workers may call, one after the other."""
    key = secrets.token_bytes(32)
    with Listener(family="AF_UNIX", authkey=key) as listener:
        threading.Thread(target=_listen, args=(listener, drivers), daemon=True).start()
        assert isinstance(listener.address, str)
        yield Relay(listener.address, key)


def _listen(listener: Listener, drivers: PlannerControllers) -> None:
    while True:
        try:
            line = listener.accept()
        except (AuthenticationError, EOFError):
            continue
        except OSError:  # closed: nothing more is wanted
            return
        threading.Thread(target=_answer, args=(line, drivers), daemon=True).start()


def _answer(line: Any, drivers: PlannerControllers) -> None:
    with line, suppress(EOFError, OSError), drivers.lend() as driver:
        while True:
            verb, *given = line.recv()
            try:
                answer = getattr(driver, verb)(*given)
            except RegentsError as failure:
                answer = failure
            except BaseException as failure:  # an error of this package; the caller must not wait for ever
                answer = DriveError(f"planner {drivers.name!r} failed: {type(failure).__name__}: {failure}")
            line.send(answer)
