"""Processes that host one planner, as many as there are threads that ask."""

import queue
import weakref
from collections.abc import Iterator
from contextlib import contextmanager

from regents_cosim.planners.host_process import HostProcess


class HostPool:
    """Lends processes; one that has been used waits for the next who asks. A context manager that ends them all."""

    def __init__(self, planner: str, act_timeout_s: float) -> None:
        self.planner, self.act_timeout_s = planner, act_timeout_s
        self._free: queue.SimpleQueue[HostProcess] = queue.SimpleQueue()
        self._all: list[HostProcess] = []
        # Also where nobody says goodbye: an iterator that is given up, Ctrl-C.
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
            process = HostProcess(self.planner, self.act_timeout_s)
            self._all.append(process)
        try:
            yield process
        finally:
            self._free.put(process)


def _close(processes: list[HostProcess]) -> None:
    for process in processes:
        process.close()
