"""Hosts of one planner: one process per asking thread, or the one object in this process."""

import queue
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Self

from regents_cosim.errors import PlannerError
from regents_cosim.planners.hosting.host_messages import encoder, questions
from regents_cosim.planners.hosting.host_process import HostProcess
from regents_cosim.planners.hosting.host_server import ServedPlanner
from regents_cosim.planners.interface import Planner
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S, Deadlines
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.system.user_code import is_importing


class ServedHere:
    """Serves a planner in this process, an object that cannot leave it.

    Questions and answers go through the same bytes as with a process of its own, so that the planner gets exact copies,
    and an error costs only its drive. But nothing can end it: a planner that hangs hangs this process, and one that
    crashes below Python ends this process.
    """

    def __init__(self, planner: Planner) -> None:
        self._served = ServedPlanner(planner)

    def ask(self, question: bytes, timeout_s: float) -> bytes:
        """The answer, however long it takes."""
        return encoder.encode(self._served.answered(questions.decode(question)))

    def stack(self) -> str:
        """Empty: it does not hang while it is asked."""
        return ""

    def outcome(self) -> str:
        """That it has none."""
        return "it is in this process"

    def end(self) -> None:
        """Do nothing, as the object is the caller's."""


class HostPool:
    """A context manager that lends hosts, reuses them, and ends them all."""

    def __init__(self, planner: PlannerUnderTest, act_timeout_s: float = ACT_TIMEOUT_S) -> None:
        """Raises RegentsError for an impossible time limit, PlannerError while a module of a user is imported."""
        if planner.where == "own process" and is_importing():  # that process would import the module, too, and so on
            raise PlannerError(
                f"planner {planner.name!r} cannot drive while its module is imported: put calls such as `evaluate` "
                'after `if __name__ == "__main__":`'
            )
        self.planner = planner
        self._patience = Deadlines(act_timeout_s)
        self._free: queue.SimpleQueue[HostProcess] = queue.SimpleQueue()
        self._all: list[HostProcess] = []
        self._one_alone = planner.where == "this process"
        if self._one_alone:
            self._free.put(self._new())
        # Also ends them where the pool is never closed: an abandoned iterator, or Ctrl-C.
        self._finalizer = weakref.finalize(self, _close, self._all)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._finalizer()

    @contextmanager
    def lend(self) -> Iterator[HostProcess]:
        """Lend a host. Waits if there is only one, and another thread has it."""
        try:
            host = self._free.get(block=self._one_alone)
        except queue.Empty:
            host = self._new()
        try:
            yield host
        finally:
            self._free.put(host)

    def _new(self) -> HostProcess:
        planner = self.planner
        here = None if planner.here is None else partial(ServedHere, planner.here)
        host = HostProcess(planner.name, self._patience, planner.source, here)
        self._all.append(host)
        return host


def _close(hosts: list[HostProcess]) -> None:
    for host in hosts:
        host.close()
