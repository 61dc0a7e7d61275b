"""Keeps code in C from ending this process by `exit` as if all were well: `exit(0)` of a library that a planner calls.

Python can raise no exception for it, as C's `exit` never returns. A function that C calls on its way out ends the
process with an exit code of its own; Python's way out removes that function first.
"""

import atexit
import ctypes
import os
from collections.abc import Callable
from contextlib import suppress

SAID = "a planner, or code that it calls, has ended this process by C's exit"
_ENDED_IN_C = 70  # exit code: EX_SOFTWARE of sysexits.h

_leave = os._exit  # `foreign_code` puts another one in its place
_AtExit = ctypes.CFUNCTYPE(None, ctypes.c_void_p)
_in_c: list[Callable[..., object]] = []  # C holds no references to these


def fail_at_exit_of_c(tell: Callable[[], object]) -> Callable[[], None]:
    """End this process with exit code 70, after a call of `tell`, where code in C calls `exit` before Python ends.

    `tell` runs in the thread that called `exit`. C's `_exit` is not seen. The returned function takes this back.
    """
    process, is_over = os.getpid(), False

    @_AtExit
    def fail(_: object) -> None:
        if is_over or os.getpid() != process:
            return
        try:
            tell()
        finally:
            _leave(_ENDED_IN_C)

    def take_back() -> None:
        nonlocal is_over
        is_over = True
        libc.__cxa_finalize(ctypes.byref(handle))  # calls `fail` for the last time

    _in_c.append(fail)
    handle = ctypes.c_char()  # its address names `fail` in C's list
    with suppress(OSError, AttributeError):  # a C library without these functions
        libc = ctypes.PyDLL(None)
        libc.__cxa_atexit(fail, None, ctypes.byref(handle))
        atexit.register(take_back)
        return take_back
    return lambda: None
