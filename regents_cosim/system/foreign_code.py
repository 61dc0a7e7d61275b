"""Runs code from outside the package so that its failure ends only its own task, not the run.

A planner may raise anything, including `SystemExit`, or call `os._exit`. All of that becomes an error of ours. Only a
real interrupt, a Ctrl-C that Python turned into an exception, passes through. A fault in C that kills the process is
not caught: code that may do so belongs into a separate process.

`os._exit` is also guarded in threads that such code starts, and in those of XLA, where the callbacks of a compiled
program run. Threads that were started earlier, for example a watchdog, may end the process.
"""

import os
import signal
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NoReturn

from regents_cosim.checks.names import did_you_mean
from regents_cosim.errors import RegentsError

_leave = os._exit
_guards: "list[_Guard]" = []  # of the open blocks, in any thread
_theirs: "weakref.WeakSet[threading.Thread]" = weakref.WeakSet()  # threads that such code has started
os.register_at_fork(after_in_child=_theirs.clear)


@contextmanager
def foreign_code(failed: Callable[[BaseException], BaseException]) -> Iterator[None]:
    """A block that runs foreign code: what `failed` returns replaces its exceptions, except for our own errors."""
    with _interrupts() as interrupts, exit_is_raised():
        try:
            yield
        except BaseException as error:
            if interrupts:
                raise interrupts[0] from None
            if isinstance(error, RegentsError):
                raise
            raise failed(error) from error


def has_left_threads() -> bool:
    """Whether threads that such code has started still run."""
    return any(thread.is_alive() for thread in tuple(_theirs))


def said_by(error: BaseException) -> str:
    """The message of a foreign exception, in one line, with what a value of ours has in place of what was asked for."""
    said = " ".join(f"{type(error).__name__}: {error}".split())
    if not isinstance(error, AttributeError) or not type(error.obj).__module__.startswith("regents_cosim."):
        return said
    return f"{said} ({did_you_mean(str(error.name), (name for name in dir(error.obj) if not name.startswith('_')))})"


@contextmanager
def _interrupts() -> Iterator[list[BaseException]]:
    """The exceptions that the handler of Ctrl-C raises meanwhile; any other is the foreign code's own."""
    raised: list[BaseException] = []
    handler = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        yield raised
        return

    def note(number: int, frame: object) -> None:
        try:
            handler(number, frame)  # pyright: ignore[reportArgumentType]  # a frame, as Python passes it
        except BaseException as error:
            raised.append(error)
            raise

    signal.signal(signal.SIGINT, note)
    try:
        yield raised
    finally:
        if signal.getsignal(signal.SIGINT) is note:  # the code may have replaced it
            signal.signal(signal.SIGINT, handler)


@dataclass(frozen=True)
class _Guard:
    """An open block in `process`, and the threads outside of its code, which may end the process."""

    process: int
    bystanders: frozenset[threading.Thread]


@contextmanager
def exit_is_raised() -> Iterator[None]:
    """Make `os._exit` raise SystemExit in this thread and in new ones, but not in forked processes."""
    before = _known_threads()
    guard = _Guard(os.getpid(), before - set(_theirs) - {threading.current_thread()})
    os._exit = _exit
    _guards.append(guard)
    try:
        yield
    finally:
        _guards.remove(guard)
        _theirs.update(_known_threads() - before)


def _known_threads() -> frozenset[threading.Thread]:
    """All threads except the stand-ins that Python creates for threads of C, such as XLA's."""
    stand_in = vars(threading)["_DummyThread"]  # it has no public name
    return frozenset(thread for thread in threading.enumerate() if not isinstance(thread, stand_in))


def _exit(status: int) -> NoReturn:
    process, thread = os.getpid(), threading.current_thread()
    guards = (guard for guard in tuple(_guards) if guard.process == process)
    if thread in _theirs or any(thread not in guard.bystanders for guard in guards):
        raise SystemExit(status)
    _leave(status)
