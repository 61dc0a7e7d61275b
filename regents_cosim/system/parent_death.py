"""Child processes that end with their parent, however it ends: by exit, a signal, or SIGKILL.

A child holds the reading end of a pipe whose writing end only its parent holds, and never writes to. When the parent
ends, the kernel closes that end. On Linux the kernel then kills the child itself, even while it runs foreign code;
elsewhere a thread of the child waits at the pipe. (PR_SET_PDEATHSIG would already fire when the thread that started the
child ends, and pools start children from threads.)
"""

import multiprocessing
import os
import signal
import threading
from multiprocessing.connection import wait

_GONE = 1  # exit code of a child whose parent is gone; nobody reads it


def die_with_parent(pipe: int | None = None) -> None:
    """Call this first in the child. `pipe` is such a pipe; by default that of `multiprocessing`.

    Does nothing in a process that `multiprocessing` did not start, if no pipe is given.
    """
    parent = multiprocessing.parent_process()
    if pipe is None and parent is not None:
        pipe = parent.sentinel
    if pipe is None:
        return
    _killed_by_kernel(pipe)
    # On Linux too, as it notices a parent that was already gone.
    threading.Thread(target=_end_when_closed, args=(pipe,), name="parent-death", daemon=True).start()


def _killed_by_kernel(pipe: int) -> None:
    """Let the kernel send SIGKILL when the other end of the pipe is closed; only Linux can do this."""
    try:
        import fcntl
    except ImportError:  # Windows
        return
    if not hasattr(fcntl, "F_SETSIG"):  # macOS
        return
    fcntl.fcntl(pipe, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(pipe, fcntl.F_SETSIG, signal.SIGKILL)
    fcntl.fcntl(pipe, fcntl.F_SETFL, fcntl.fcntl(pipe, fcntl.F_GETFL) | os.O_ASYNC)


def _end_when_closed(pipe: int) -> None:
    wait([pipe])
    os._exit(_GONE)
