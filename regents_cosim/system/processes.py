"""A spawned process that does one job at a time, and the set-up that all child processes share.

Processes are spawned, never forked: threads of JAX and the state of libsumo do not survive a fork. A process ends with
its parent (`die_with_parent`), and leaves Ctrl-C and SIGTERM to it: a terminal sends these to all processes, and only
the parent knows what is finished.
"""

import fcntl
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager, suppress
from functools import cache
from multiprocessing import resource_tracker, util
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from multiprocessing.reduction import ForkingPickler
from multiprocessing.util import Finalize
from typing import Any

from regents_cosim.errors import RegentsError

# Child processes that end with their parent, however it ends: by exit, a signal, or SIGKILL.
#
# A child holds the reading end of a pipe whose writing end only its parent holds, and never writes to. When the
# parent ends, the kernel closes that end, and kills the child, even while it runs foreign code. (PR_SET_PDEATHSIG would
# already fire when the thread that started the child ends, and pools start children from threads.)
_GONE = 1  # exit code of a child whose parent is gone; nobody reads it


def die_with_parent() -> None:
    """Call this first in the child; does nothing in a process that `multiprocessing` did not start."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    pipe = parent.sentinel  # such a pipe
    fcntl.fcntl(pipe, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(pipe, fcntl.F_SETSIG, signal.SIGKILL)
    fcntl.fcntl(pipe, fcntl.F_SETFL, fcntl.fcntl(pipe, fcntl.F_GETFL) | os.O_ASYNC)
    # This notices a parent that was already gone.
    threading.Thread(target=_end_when_closed, args=(pipe,), name="parent-death", daemon=True).start()


def _end_when_closed(pipe: int) -> None:
    wait([pipe])
    os._exit(_GONE)


_MAIN = threading.Lock()  # only one thread at a time hides the caller's script
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_running: set[BaseProcess] = set()


class Worker:
    """A child process, and the connection to it. Use it from one thread at a time; `kill` from any."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_work, args=(theirs,))
        _running.add(self._process)
        _kill_all_at_end()
        with _starting():
            self._process.start()
        theirs.close()

    def begin(self, function: Callable[..., Any], *args: Any, **kwargs: Any) -> None:
        """Begin a job; call `result` for its outcome."""
        with suppress(OSError):  # it has died, which `result` reports
            self._pipe.send((function, args, kwargs))

    def result(self, timeout_s: float | None = None) -> Any:
        """Return what the job returned. Raises what it raised, BrokenExecutor where the process died.

        A job that takes longer than `timeout_s` goes on; TimeoutError is raised.
        """
        try:
            answers = self._pipe.poll(timeout_s)
            fine, outcome = self._pipe.recv() if answers else (False, TimeoutError())
        except (EOFError, OSError) as error:
            self.close()
            raise BrokenExecutor("the process died") from error
        if fine:
            return outcome
        raise outcome

    @property
    def exit_code(self) -> int | None:
        """The exit code of the process, negative for a signal; None while it runs."""
        return self._process.exitcode

    def is_alive(self) -> bool:
        """Whether it can do another job."""
        return not self._pipe.closed and self._process.is_alive()

    def kill(self) -> None:
        """End the process; a caller that waits for its result gets an error."""
        self._process.kill()

    def close(self) -> None:
        """End the process, and free its resources; may be called twice."""
        if not self._pipe.closed:
            self._process.kill()
            self._process.join()
            self._pipe.close()
            _running.discard(self._process)


@contextmanager
def _starting() -> Iterator[None]:
    """A block that starts a process.

    The process does not import the caller's script, and Ctrl-C or SIGTERM wait until it is ready for them.
    """
    with main_hidden(), _children_allowed():
        resource_tracker.ensure_running()  # starting it later would let the signals through
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _children_allowed() -> Iterator[None]:
    """Allow child processes even in a daemonic process, such as a Dask worker.

    `multiprocessing` forbids these because children might outlive the process; ours do not (`die_with_parent`).
    """
    ours: Any = multiprocessing.current_process()
    daemon = ours._config.pop("daemon", None)  # there is no public function
    try:
        yield
    finally:
        if daemon is not None:
            ours._config["daemon"] = daemon


@contextmanager
def main_hidden() -> Iterator[None]:
    """Keep spawned processes from importing the parent's main script again.

    They would do so if it has a file or a spec, and also search the working directory unless their path is safe.
    """
    main = sys.modules["__main__"]
    with _MAIN, safe_path():
        hidden = {name: main.__dict__.pop(name) for name in ("__file__", "__spec__") if name in main.__dict__}
        main.__spec__ = None
        try:
            yield
        finally:
            main.__dict__.update(hidden)


def _kill_all() -> None:
    for process in _running:
        if process.pid is not None:
            process.kill()


@cache
def _kill_all_at_end() -> None:
    """Kill all at the end of this process, before `multiprocessing` waits for them, as they ignore SIGTERM.

    Also if `multiprocessing` started this process, as it does for a worker of Dask.
    """
    Finalize(None, _kill_all, exitpriority=0)


def _leave_to_parent(*_: object) -> None:
    """Do nothing: the parent gets the signal as well, and ends this process."""


def _work(pipe: Connection) -> None:
    """Do jobs in a new process, which ends with its parent, and leaves Ctrl-C and SIGTERM to it."""
    die_with_parent()
    for number in _SIGNALS:
        signal.signal(number, _leave_to_parent)  # SIG_IGN would be inherited by programs
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
    with suppress(EOFError, OSError):  # the parent has gone
        while True:
            _send(pipe, _outcome(pipe.recv_bytes()))


def _outcome(message: bytes) -> tuple[bool, Any]:
    """Do the job of a message; whether it succeeded, and its result or its error. One may fail to be loaded here."""
    try:
        function, args, kwargs = ForkingPickler.loads(message)  # pyright: ignore  # it is no method
        return True, function(*args, **kwargs)
    except BaseException as error:  # including `sys.exit`
        if not isinstance(error, RegentsError):
            error.add_note(f"In a process of its own:\n{traceback.format_exc()}")
        return False, error


def _send(pipe: Connection, outcome: tuple[bool, Any]) -> None:
    try:
        pipe.send(outcome)
    except OSError:
        raise
    except Exception as error:  # an exception of a foreign library may hold anything
        pipe.send((False, RuntimeError(f"{type(outcome[1]).__name__} {outcome[1]}: {error}")))


# `multiprocessing` starts `python -c ...`, for which Python searches the working directory first, which may be a
# stranger's suite: a `json.py` there would run before any line of ours. With `-P` it is not searched. It is passed as a
# flag, since an environment variable would reach the programs that a planner starts, and keep them from the modules
# beside their script.
_FLAG = "-P"
_LOCK = threading.Lock()
_multiprocessing: Any = util  # it has no public place for flags
_its_flags = _multiprocessing._args_from_interpreter_flags
_blocks = 0  # number of open blocks


@contextmanager
def safe_path() -> Iterator[None]:
    """Start all processes of `multiprocessing` with a safe path while the block runs, including its helpers."""
    _count(1)
    try:
        yield
    finally:
        _count(-1)


def python_flags() -> list[str]:
    """Python's flags for a child process: those of this process, and the safe path."""
    flags: list[str] = subprocess._args_from_interpreter_flags()  # pyright: ignore[reportAttributeAccessIssue]
    return flags if _FLAG in flags else [_FLAG, *flags]


def _count(more: int) -> None:
    global _blocks
    with _LOCK:
        _blocks += more
        _multiprocessing._args_from_interpreter_flags = python_flags if _blocks else _its_flags
