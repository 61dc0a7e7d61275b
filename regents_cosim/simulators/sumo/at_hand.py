"""Keeps a process with SUMO for the next job, since loading SUMO takes time; reading traffic then runs it."""

import os
import threading
from collections.abc import Callable
from typing import NamedTuple, ParamSpec, TypeVar

from regents_cosim.system.workers import LocalProcesses, local_processes, result_of, submit

_P = ParamSpec("_P")
_R = TypeVar("_R")


class _AtHand(NamedTuple):
    """The process, and the surroundings that it was started with."""

    process: LocalProcesses
    surroundings: tuple[str, dict[str, str]]  # working directory and environment variables, which the process keeps


class _OfThread(threading.local):
    """State of one thread."""

    kept: _AtHand | None = None


_mine = _OfThread()


def in_sumo_process(function: Callable[_P, _R], /, *args: _P.args, **kwargs: _P.kwargs) -> _R:
    """Call `function` in the process. Raises what it raises, or WorkerError where the process dies."""
    surroundings = (os.getcwd(), dict(os.environ))
    if _mine.kept is not None and _mine.kept.surroundings != surroundings:
        end_sumo_process()
    if _mine.kept is None:
        _mine.kept = _AtHand(local_processes(1), surroundings)
    return result_of(submit(_mine.kept.process, function, *args, **kwargs))


def end_sumo_process() -> None:
    """End the process, even in the middle of a job; the next job starts another."""
    kept, _mine.kept = _mine.kept, None
    if kept is not None:
        kept.process.shutdown(wait=False)
