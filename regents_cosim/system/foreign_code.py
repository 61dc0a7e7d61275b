"""Code from outside the package: whatever it does to leave, it costs what it was asked for, and not the run.

A planner may raise anything, `SystemExit` included, or call `os._exit`. All of that becomes an error of ours. Only a
real interrupt, a Ctrl-C that Python turned into an exception, goes through. What kills the process from below Python
(a fault in C) is not seen here: code of which that is to be feared belongs into a process of its own.

`os._exit` is guarded also in threads that such code starts, and in those of XLA, where the callbacks of a compiled
program run. Threads that were there before it was called end the process as they like: a watchdog, say.
"""

import os
import signal
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NoReturn

from regents_cosim.errors import RegentsError

_leave = os._exit
_guards: "list[_Guard]" = []  # of the blocks that are open now, in any thread
_theirs: "weakref.WeakSet[threading.Thread]" = weakref.WeakSet()  # threads that such code has started
if hasattr(os, "register_at_fork"):  # Windows has no fork
    os.register_at_fork(after_in_child=_theirs.clear)


class OwnSignal(BaseException):
    """What our own code raises to leave a drive: it passes through the guards of code from outside."""


@contextmanager
def foreign_code(failed: Callable[[BaseException], BaseException]) -> Iterator[None]:
    """A block that calls such code: what it raises is raised as what `failed` makes of it, but for our own errors."""
    with _interrupts() as interrupts, exit_is_raised():
        try:
            yield
        except BaseException as error:
            if interrupts:
                raise interrupts[0] from None
            if isinstance(error, RegentsError | OwnSignal):
                raise
            raise failed(error) from error


def said_by(error: BaseException) -> str:
    """What such code raised, in one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())


@contextmanager
def _interrupts() -> Iterator[list[BaseException]]:
    """What the handler of Ctrl-C raises meanwhile; a KeyboardInterrupt that it did not is the code's own."""
    raised: list[BaseException] = []
    handler = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        yield raised
        return

    def note(number: int, frame: object) -> None:
        try:
            handler(number, frame)  # pyright: ignore[reportArgumentType]  # a frame, as Python gives it
        except BaseException as error:
            raised.append(error)
            raise

    signal.signal(signal.SIGINT, note)
    try:
        yield raised
    finally:
        if signal.getsignal(signal.SIGINT) is note:  # the code may have put another in its place
            signal.signal(signal.SIGINT, handler)


@dataclass(frozen=True)
class _Guard:
    """A block that is open in `process`, and the threads that may end this: those that are none of its code's."""

    process: int
    bystanders: frozenset[threading.Thread]


@contextmanager
def exit_is_raised() -> Iterator[None]:
    """Meanwhile `os._exit` raises SystemExit in this thread and in new ones; not in processes that are forked."""
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
    """Without the stand-ins that Python makes for threads of C, such as XLA's, once these ask who they are."""
    stand_in = vars(threading)["_DummyThread"]  # has no public name
    return frozenset(thread for thread in threading.enumerate() if not isinstance(thread, stand_in))


def _exit(status: int) -> NoReturn:
    process, thread = os.getpid(), threading.current_thread()
    guards = (guard for guard in tuple(_guards) if guard.process == process)
    if thread in _theirs or any(thread not in guard.bystanders for guard in guards):
        raise SystemExit(status)
    _leave(status)
