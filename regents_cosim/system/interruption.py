"""Ctrl-C and SIGTERM end a command at once, whatever it is busy with, with one line that says what is kept.

Python's own way, an exception in the main thread, comes when that thread runs Python again and then waits for all
others: half a minute in a compiled search. Here nothing is unwound. A thread is told by the signal's handler in C
through a socket, says the line, and ends the process; whatever was started ends with it (`parent_death`). What was
finished is saved by then, for it is saved as it is finished, whole or not at all.
"""

import os
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from regents_cosim.plain_text import printable, wrapped

_WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
_WRITING_S = 0.7  # how long something that is being written may take to become whole
_CLEAR = b"\r\x1b[2K\x1b[?25h"  # the line of a bar, and the cursor that it hides

_changed = threading.Condition()
_writing: list[int] = []  # threads in the middle of what is to be whole, once for each block
_ending = threading.Event()
_kept = ["nothing is half-written, run the same command again"]


def end_at_once() -> None:
    """From now on Ctrl-C and SIGTERM end this process, with exit code 130 and 143. Call it from the main thread."""
    here, there = socket.socketpair()
    there.setblocking(False)
    for number in _WORDS:
        if signal.getsignal(number) is not signal.SIG_IGN:  # as `nohup` and the background jobs of scripts want it
            signal.signal(number, _leave_to_thread)
    threading.Thread(target=_wait, args=(here, there), name="interruption", daemon=True).start()
    signal.set_wakeup_fd(there.fileno(), warn_on_full_buffer=False)
    if hasattr(signal, "pthread_sigmask"):  # the caller may have held them back so far
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _WORDS)


def keep(what: str) -> None:
    """Note what an interruption leaves behind and how to go on, for the line that says it."""
    _kept[:] = [what]


@contextmanager
def made_whole() -> Iterator[None]:
    """A block of moments, such as a case and its entry in the manifest, that an interruption waits for."""
    me = threading.get_ident()
    with _changed:
        _changed.wait_for(lambda: me in _writing or not _ending.is_set())  # the end is near: nothing else is begun
        _writing.append(me)
    try:
        yield
    finally:
        with _changed:
            _writing.remove(me)
            _changed.notify_all()


def _leave_to_thread(*_: object) -> None:
    """Called when the main thread runs Python again, which may be much later."""


def _wait(here: socket.socket, _there: socket.socket) -> None:
    """Wait for the number of a signal. The other end is given for keeping: it must stay open."""
    while True:
        for number in here.recv(16):
            if number in _WORDS:
                _end(signal.Signals(number))


def _end(number: signal.Signals) -> None:
    _ending.set()
    with _changed:
        _changed.wait_for(lambda: not _writing, timeout=_WRITING_S)
    line = f"regents: {_WORDS[number]}; {printable(_kept[0])}"
    try:
        if os.isatty(2):
            line = wrapped(line, os.get_terminal_size(2).columns or 80)
        # Not by sys.stderr, which the main thread may hold.
        os.write(2, (_CLEAR if os.isatty(2) else b"") + f"{line}\n".encode(errors="backslashreplace"))
    finally:
        os._exit(128 + number)
