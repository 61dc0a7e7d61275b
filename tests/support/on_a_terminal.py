"""Run a program whose stderr is a terminal."""

import fcntl
import os
import pty
import re
import struct
import subprocess
import termios
import threading
from collections.abc import Mapping


def on_a_terminal(
    words: list[str], columns: int = 80, both: bool = False, code: int = 0, **how: object
) -> tuple[str, str]:
    """Run a command; return its stdout (a pipe, or with `both` the terminal) and the terminal's text without colours.

    It has to end with the exit code `code`; `how`: more for `subprocess.Popen`.
    """
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 50, columns, 0, 0))
    how = {"env": _without_a_width(os.environ)} | how
    running = subprocess.Popen(words, stdin=theirs, stdout=theirs if both else subprocess.PIPE, stderr=theirs, **how)  # type: ignore[call-overload]
    os.close(theirs)
    said = bytearray()
    reader = threading.Thread(target=_read, args=(ours, said))
    reader.start()
    data = running.communicate()[0] or b""
    reader.join()
    os.close(ours)
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", said.decode(errors="replace")).replace("\r", "\n")
    assert running.returncode == code, text
    return data.decode(), text


def _without_a_width(environment: Mapping[str, str]) -> dict[str, str]:
    """Let the terminal alone say how wide it is: readline, which pytest imports, sets COLUMNS behind Python's back."""
    return {name: value for name, value in environment.items() if name not in ("COLUMNS", "LINES")}


def _read(end: int, said: bytearray) -> None:
    while True:
        try:
            more = os.read(end, 65536)
        except OSError:  # the other end is closed
            return
        if not more:
            return
        said += more
