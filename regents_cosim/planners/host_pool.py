"""Processes that host one planner, as many as there are threads that ask."""

import queue
import weakref
from collections.abc import Iterator
from contextlib import contextmanager

from regents_cosim.planners.host_process import HostProcess
from regents_cosim.planners.patience import ACT_TIMEOUT_S, Patience


class HostPool:
    """Lends processes; one that has been used waits for the next who asks. A context manager that ends them all."""

    def __init__(self, planner: str, act_timeout_s: float = ACT_TIMEOUT_S) -> None:
        """Raises RegentsError for a time that cannot be waited."""
        self.planner = planner
        self._patience = Patience(planner, act_timeout_s)
        self._free: queue.SimpleQueue[HostProcess] = queue.SimpleQueue()
        self._all: list[HostProcess] = []
        # Also where it is never closed: an iterator that is given up, Ctrl-C.
        self._finalizer = weakref.finalize(self, _close, self._all)

    def __enter__(self) -> "HostPool":
        return self

    def __exit__(self, *error: object) -> None:
        self._finalizer()

    @contextmanager
    def lend(self) -> Iterator[HostProcess]:
        """A process for the time being."""
        try:
            process = self._free.get_nowait()
        except queue.Empty:
            process = HostProcess(self.planner, self._patience)
            self._all.append(process)
        try:
            yield process
        finally:
            self._free.put(process)


def _close(processes: list[HostProcess]) -> None:
    for process in processes:
        process.close()
