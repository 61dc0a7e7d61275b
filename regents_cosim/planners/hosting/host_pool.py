"""Hosts of one planner: one process per asking thread, or the one object in this process."""

import queue
import weakref
from collections.abc import Iterator
from contextlib import contextmanager

from regents_cosim.planners.hosting.host_messages import encoder, questions
from regents_cosim.planners.hosting.host_process import HostProcess, QuestionServer
from regents_cosim.planners.hosting.host_server import ServedPlanner
from regents_cosim.planners.interface import Planner
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S, Deadlines
from regents_cosim.planners.under_test import PlannerUnderTest


# Host a planner in this process, for an object that cannot leave it.
#
# It is asked and checked as in a process of its own (`host_process`), and an error costs only its drive. But nothing
# can end it: a planner that hangs hangs this process, and one that crashes below Python ends this process.
class HostInThisProcess(HostProcess):
    """A host whose planner is in this process; use it from one thread at a time."""

    def __init__(self, name: str, planner: Planner, patience: Deadlines | None = None) -> None:
        super().__init__(name, patience)
        self._here = planner

    def _serving(self) -> QuestionServer:
        return _HostInThisProcess(ServedPlanner(self._here))


class _HostInThisProcess:
    """Serves questions and answers through the same bytes as a process, so that the planner gets exact copies."""

    def __init__(self, served: ServedPlanner) -> None:
        self._served = served

    def ask(self, question: bytes, timeout_s: float) -> bytes:
        """The answer, however long it takes."""
        return encoder.encode(self._served.answered(questions.decode(question)))

    def stack(self) -> str:
        return ""

    def outcome(self) -> str:
        return "it is in this process"

    def end(self) -> None:
        """Do nothing, as the object is the caller's."""


class HostPool:
    """A context manager that lends hosts, reuses them, and ends them all."""

    def __init__(self, planner: PlannerUnderTest, act_timeout_s: float = ACT_TIMEOUT_S) -> None:
        """Raises RegentsError for an impossible time limit."""
        self.planner = planner
        self._patience = Deadlines(act_timeout_s)
        self._free: queue.SimpleQueue[HostProcess] = queue.SimpleQueue()
        self._all: list[HostProcess] = []
        self._one_alone = planner.where == "this process"
        if self._one_alone:
            self._free.put(self._new())
        # Also ends them where the pool is never closed: an abandoned iterator, or Ctrl-C.
        self._finalizer = weakref.finalize(self, _close, self._all)

    def __enter__(self) -> "HostPool":
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
        if planner.source is None and planner.here is not None:
            host = HostInThisProcess(planner.name, planner.here, self._patience)
        else:
            host = HostProcess(planner.name, self._patience, planner.source)
        self._all.append(host)
        return host


def _close(hosts: list[HostProcess]) -> None:
    for host in hosts:
        host.close()
