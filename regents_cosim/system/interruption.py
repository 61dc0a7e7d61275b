"""Makes Ctrl-C and SIGTERM end a command at once, with one line that says what is kept.

By default Python raises an exception when the main thread runs Python code again, and then waits for all other threads:
half a minute in a compiled search. Here no stack is unwound. The signal's handler in C notifies a thread through a
socket; the thread prints the line and ends the process, and all child processes end with it (`die_with_parent`).
Finished results are saved by then, since each is saved atomically when it is finished.
"""

import os
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from regents_cosim.plain_text import printable, wrapped
from regents_cosim.system.c_exit import SAID, fail_at_exit_of_c

_WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
_WRITING_S = 0.7  # longest wait for a write in progress
_CLEAR = b"\r\x1b[2K\x1b[?25h"  # erases the line of a bar, and shows the cursor

_changed = threading.Condition()
_writing: list[int] = []  # threads within a `made_whole` block, once for each block
_ending = threading.Event()
_kept = ["nothing is half-written, run the same command again"]


def end_at_once() -> None:
    """Let Ctrl-C and SIGTERM end this process, with exit codes 130 and 143. Call it from the main thread.

    An end by C's `exit` is told in the same way (`fail_at_exit_of_c`).
    """
    fail_at_exit_of_c(lambda: _tell(SAID))
    here, there = socket.socketpair()
    there.setblocking(False)
    for number in _WORDS:
        if signal.getsignal(number) is not signal.SIG_IGN:  # ignored by `nohup` and for background jobs of scripts
            signal.signal(number, _leave_to_thread)
    threading.Thread(target=_wait, args=(here, there), name="interruption", daemon=True).start()
    signal.set_wakeup_fd(there.fileno(), warn_on_full_buffer=False)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _WORDS)  # the caller may have blocked them until now


def announce_kept(what: str) -> None:
    """Set what the line printed at an interruption says: what is kept, and how to continue."""
    _kept[:] = [what]


@contextmanager
def uninterrupted() -> Iterator[None]:
    """A short block that an interruption waits for, such as saving a case and its entry in the manifest."""
    me = threading.get_ident()
    with _changed:
        _changed.wait_for(lambda: me in _writing or not _ending.is_set())  # during an interruption no new block begins
        _writing.append(me)
    try:
        yield
    finally:
        with _changed:
            _writing.remove(me)
            _changed.notify_all()


def _leave_to_thread(*_: object) -> None:
    """Do nothing; Python calls this when the main thread runs Python code again, which may be much later."""


def _wait(here: socket.socket, _there: socket.socket) -> None:
    """Wait for the number of a signal. The other end is passed in to keep it open."""
    while True:
        for number in here.recv(16):
            if number in _WORDS:
                try:
                    _tell(_WORDS[signal.Signals(number)])
                finally:
                    os._exit(128 + number)


def _tell(why: str) -> None:
    """Print why the process ends and what is kept, once nothing is being written."""
    _ending.set()
    with _changed:
        _changed.wait_for(lambda: not _writing, timeout=_WRITING_S)
    line = f"regents: {why}; {printable(_kept[0])}"
    if os.isatty(2):
        line = wrapped(line, os.get_terminal_size(2).columns or 80)
    # Not with sys.stderr, which the main thread may have locked.
    os.write(2, (_CLEAR if os.isatty(2) else b"") + f"{line}\n".encode(errors="backslashreplace"))
