"""One spawned process that does one job at a time, and what every process that we start has to do.

Spawned, never forked: threads of JAX and the state of libsumo do not survive a fork. A process ends with the one that
started it (`parent_death`) and leaves Ctrl-C and SIGTERM to it: a terminal sends them to all, and only the parent
knows what is finished.
"""

import multiprocessing
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager, suppress
from functools import cache, partial
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from multiprocessing.util import Finalize
from typing import Any

from regents_cosim.errors import RegentsError
from regents_cosim.system.parent_death import die_with_parent
from regents_cosim.system.safe_path import safe_path

_MAIN = threading.Lock()  # the caller's script is hidden by one thread at a time
_SIGNALS = (signal.SIGINT, signal.SIGTERM) if hasattr(signal, "pthread_sigmask") else ()  # Windows has no masks
_running: set[BaseProcess] = set()


class Worker:
    """The process, and the conversation with it. Use it from one thread at a time; `kill` from any."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_work, args=(theirs,))
        end_with_this_process(self._process)
        with starting():
            self._process.start()
        theirs.close()

    def begin(self, function: Callable[..., Any], *args: Any, **kwargs: Any) -> None:
        """Begin a job; `result` gives what comes of it."""
        with suppress(OSError):  # it has died; `result` says so
            self._pipe.send((function, args, kwargs))

    def result(self) -> Any:
        """What the job returned. Raises what it raised, BrokenExecutor where the process died."""
        try:
            fine, outcome = self._pipe.recv()
        except (EOFError, OSError) as error:
            self.close()
            raise BrokenExecutor("the process died") from error
        if fine:
            return outcome
        raise outcome

    def is_alive(self) -> bool:
        """Whether it can do another job."""
        return not self._pipe.closed and self._process.is_alive()

    def kill(self) -> None:
        """End the process; who waits for its result is told that it died."""
        self._process.kill()

    def close(self) -> None:
        """End the process, and give back what it took; twice does no harm."""
        if not self._pipe.closed:
            self._process.kill()
            self._process.join()
            self._pipe.close()
            has_ended(self._process)


@contextmanager
def starting() -> Iterator[None]:
    """While a process is started, which has to `begin_child` first thing.

    It does not import the caller's script, and Ctrl-C or SIGTERM wait until it is ready for them.
    """
    if not _SIGNALS:
        with main_hidden(), _children_allowed():
            yield
        return
    with main_hidden(), _children_allowed():
        resource_tracker.ensure_running()  # would let the signals through when it is started on the way
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _children_allowed() -> Iterator[None]:
    """Also in a daemonic process, such as a Dask worker: `multiprocessing` lets it have none, as they might outlive it.

    Ours do not (`begin_child`).
    """
    ours: Any = multiprocessing.current_process()
    daemon = ours._config.pop("daemon", None)  # no public way
    try:
        yield
    finally:
        if daemon is not None:
            ours._config["daemon"] = daemon


def begin_child() -> None:
    """In a new process: end with the parent, and leave Ctrl-C and SIGTERM to it."""
    die_with_parent()
    if _SIGNALS:
        for number in _SIGNALS:
            signal.signal(number, _leave_to_parent)  # a handler, for what is ignored would be so in programs it starts
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)


@contextmanager
def main_hidden() -> Iterator[None]:
    """Spawned processes import the parent's main script again unless it has no file and no spec.

    And what the working directory holds, unless their path is safe.
    """
    main = sys.modules["__main__"]
    with _MAIN, safe_path():
        hidden = {name: main.__dict__.pop(name) for name in ("__file__", "__spec__") if name in main.__dict__}
        main.__spec__ = None
        try:
            yield
        finally:
            main.__dict__.update(hidden)


def end_with_this_process(process: BaseProcess) -> None:
    """Kill a process, which leaves SIGTERM to its parent, before `multiprocessing` waits for it at this one's end."""
    _running.add(process)
    _kill_all_at_end()


def has_ended(process: BaseProcess) -> None:
    """Nothing is left to be killed."""
    _running.discard(process)


def _kill_all() -> None:
    for process in _running:
        if process.pid is not None:
            process.kill()


@cache
def _kill_all_at_end() -> None:
    """Also at the end of a process that `multiprocessing` started: a worker of Dask."""
    Finalize(None, _kill_all, exitpriority=0)


def _leave_to_parent(*_: object) -> None:
    """The parent is told as well, and ends this process."""


def _work(pipe: Connection) -> None:
    begin_child()
    with suppress(EOFError, OSError):  # the parent wants nothing more
        while True:
            _send(pipe, _outcome(_received(pipe)))


def _received(pipe: Connection) -> Callable[[], Any]:
    """The next job; one that cannot be loaded here fails when it is done. Raises EOFError where none will come."""
    try:
        function, args, kwargs = pipe.recv()
    except (EOFError, OSError):
        raise
    except Exception as error:
        return partial(_fail, error)
    return partial(function, *args, **kwargs)


def _fail(error: Exception) -> None:
    raise error


def _outcome(job: Callable[[], Any]) -> tuple[bool, Any]:
    """Whether the job succeeded, and its result or its error."""
    try:
        return True, job()
    except BaseException as error:  # `sys.exit` included
        if not isinstance(error, RegentsError):
            error.add_note(f"In a process of its own:\n{traceback.format_exc()}")
        return False, error


def _send(pipe: Connection, outcome: tuple[bool, Any]) -> None:
    try:
        pipe.send(outcome)
    except OSError:
        raise
    except Exception as error:  # what a foreign library raised may hold anything
        pipe.send((False, RuntimeError(f"{type(outcome[1]).__name__} {outcome[1]}: {error}")))
