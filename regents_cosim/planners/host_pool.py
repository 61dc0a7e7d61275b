"""Hosts of one planner: as many processes as there are threads that ask, or the one object that is in this process."""

import queue
import weakref
from collections.abc import Iterator
from contextlib import contextmanager

from regents_cosim.planners.host_here import HostInThisProcess
from regents_cosim.planners.host_process import HostProcess
from regents_cosim.planners.patience import ACT_TIMEOUT_S, Deadlines
from regents_cosim.planners.under_test import PlannerUnderTest


class HostPool:
    """Lends hosts; one that has been used waits for the next who asks. A context manager that ends them all."""

    def __init__(self, planner: PlannerUnderTest, act_timeout_s: float = ACT_TIMEOUT_S) -> None:
        """Raises RegentsError for a time that cannot be waited."""
        self._planner = planner
        self._patience = Deadlines(planner.name, act_timeout_s)
        self._free: queue.SimpleQueue[HostProcess] = queue.SimpleQueue()
        self._all: list[HostProcess] = []
        self._one_alone = planner.where == "this process"
        if self._one_alone:
            self._free.put(self._new())
        # Also where it is never closed: an iterator that is given up, Ctrl-C.
        self._finalizer = weakref.finalize(self, _close, self._all)

    def __enter__(self) -> "HostPool":
        return self

    def __exit__(self, *error: object) -> None:
        self._finalizer()

    @contextmanager
    def lend(self) -> Iterator[HostProcess]:
        """A host for the time being. Waits where there is one alone, and another thread has it."""
        try:
            host = self._free.get(block=self._one_alone)
        except queue.Empty:
            host = self._new()
        try:
            yield host
        finally:
            self._free.put(host)

    def _new(self) -> HostProcess:
        planner = self._planner
        if planner.source is None and planner.here is not None:
            host = HostInThisProcess(planner.name, planner.here, self._patience)
        else:
            host = HostProcess(planner.name, self._patience, planner.source)
        self._all.append(host)
        return host


def _close(hosts: list[HostProcess]) -> None:
    for host in hosts:
        host.close()
