"""A process with SUMO that is kept for the next job, as loading SUMO takes time: what reads traffic then runs it."""

import os
import threading
from collections.abc import Callable
from typing import NamedTuple, ParamSpec, TypeVar

from regents_cosim.system.workers import LocalProcesses, local_processes, result_of, submit

_P = ParamSpec("_P")
_R = TypeVar("_R")


class _AtHand(NamedTuple):
    """The process, and what it was started with."""

    process: LocalProcesses
    surroundings: tuple[str, dict[str, str]]  # the working directory and the environment, which it keeps


class _OfThread(threading.local):
    """Each thread has its own."""

    kept: _AtHand | None = None


_mine = _OfThread()


def in_sumo_process(function: Callable[_P, _R], /, *args: _P.args, **kwargs: _P.kwargs) -> _R:
    """What `function` returns there. Raises what it raised, WorkerError where the process died."""
    surroundings = (os.getcwd(), dict(os.environ))
    if _mine.kept is not None and _mine.kept.surroundings != surroundings:
        end_sumo_process()
    if _mine.kept is None:
        _mine.kept = _AtHand(local_processes(1), surroundings)
    return result_of(submit(_mine.kept.process, function, *args, **kwargs))


def end_sumo_process() -> None:
    """End it, also in the middle of a job that is given up; the next job starts another."""
    kept, _mine.kept = _mine.kept, None
    if kept is not None:
        kept.process.shutdown(wait=False)
