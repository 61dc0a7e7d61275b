"""Code from outside the package: whatever it does to leave, it costs what it was asked for, and not the run.

A planner may raise anything, `SystemExit` included, or call `os._exit`. All of that becomes an error of ours. Only a
real interrupt, a Ctrl-C that Python turned into an exception, goes through. What kills the process from below Python
(a fault in C) is not seen here: code of which that is to be feared belongs into a process of its own.
"""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NoReturn

from regents_cosim.errors import RegentsError

_leave = os._exit
_guarded = threading.local()


class OwnSignal(BaseException):
    """What our own code raises to leave a drive: it passes through the guards of code from outside."""


@contextmanager
def foreign_code(failed: Callable[[BaseException], BaseException]) -> Iterator[None]:
    """A block that calls such code: what it raises is raised as what `failed` makes of it, but for our own errors."""
    with _interrupts() as interrupts, _exit_is_raised():
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


@contextmanager
def _exit_is_raised() -> Iterator[None]:
    """In this thread `os._exit` raises SystemExit meanwhile; not in processes that are forked from it."""
    before = getattr(_guarded, "process", None)
    os._exit = _exit
    _guarded.process = os.getpid()
    try:
        yield
    finally:
        _guarded.process = before


def _exit(status: int) -> NoReturn:
    if getattr(_guarded, "process", None) == os.getpid():
        raise SystemExit(status)
    _leave(status)
