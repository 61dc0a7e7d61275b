"""Windows of an X display, closed as a click on their cross does: through Xlib alone, as there is no window manager."""

import ctypes
import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager

_CLIENT_MESSAGE = 33


@contextmanager
def x_server() -> Iterator[str]:
    """The name of a display that none sees."""
    read, write = os.pipe()
    server = subprocess.Popen(["Xvfb", "-displayfd", str(write)], pass_fds=[write], stderr=subprocess.DEVNULL)
    try:
        os.close(write)
        with os.fdopen(read) as answer:
            yield f":{answer.readline().strip()}"
    finally:
        server.terminate()
        server.wait()


class _Message(ctypes.Structure):
    _fields_ = (
        ("type", ctypes.c_int), ("serial", ctypes.c_ulong), ("sent", ctypes.c_int), ("display", ctypes.c_void_p),
        ("window", ctypes.c_ulong), ("kind", ctypes.c_ulong), ("bits", ctypes.c_int), ("data", ctypes.c_long * 5),
        ("rest", ctypes.c_long * 12),
    )  # fmt: skip


class XDisplay:
    """A display, given by its name."""

    def __init__(self, name: str) -> None:
        self._x = ctypes.CDLL("libX11.so.6")
        self._x.XOpenDisplay.restype = ctypes.c_void_p
        self._x.XDefaultRootWindow.restype = self._x.XInternAtom.restype = ctypes.c_ulong
        self._display = ctypes.c_void_p(self._x.XOpenDisplay(name.encode()))
        assert self._display.value, f"no display {name}"

    def named(self) -> list[int]:
        """The windows that have a name, right below the root."""
        found, count, other = ctypes.POINTER(ctypes.c_ulong)(), ctypes.c_uint(), ctypes.c_ulong()
        root = ctypes.c_ulong(self._x.XDefaultRootWindow(self._display))
        places = ctypes.byref(other), ctypes.byref(other), ctypes.byref(found), ctypes.byref(count)
        self._x.XQueryTree(self._display, root, *places)
        return [found[index] for index in range(count.value) if self._name(found[index])]

    def wait_for_one(self, most_s: float) -> int:
        """The first window with a name that appears."""
        until = time.monotonic() + most_s
        while not (windows := self.named()):
            assert time.monotonic() < until, "no window appeared"
            time.sleep(0.1)
        return windows[0]

    def close(self, window: int) -> None:
        """Ask who made a window to close it."""
        kind, how = (self._x.XInternAtom(self._display, name, 0) for name in (b"WM_PROTOCOLS", b"WM_DELETE_WINDOW"))
        message = _Message(_CLIENT_MESSAGE, window=window, kind=kind, bits=32, data=(how, 0, 0, 0, 0))
        self._x.XSendEvent(self._display, ctypes.c_ulong(window), 0, ctypes.c_long(0), ctypes.byref(message))
        self._x.XSync(self._display, 0)

    def _name(self, window: int) -> bytes | None:
        name = ctypes.c_char_p()
        self._x.XFetchName(self._display, ctypes.c_ulong(window), ctypes.byref(name))
        return name.value
