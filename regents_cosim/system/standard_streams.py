"""The standard streams of a process: stdout has results alone, and nothing fails once its reader is gone.

A planner in the process of a command, or code in C that it calls, may print while it is imported or drives. `--json`
has to stay JSON, so what is not printed to `results()` goes to stderr.
"""

import io
import os
import sys
from typing import Any, TextIO

_results: list[TextIO] = []


def results() -> TextIO:
    """The stream for results: stdout as the process was given it."""
    return _results[0] if _results else sys.stdout


def keep_stdout_for_results() -> None:
    """Lead file descriptor 1, and what Python prints, to stderr from now on. A closed descriptor leads nowhere."""
    while (lowest := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(lowest, True)
    os.close(lowest)
    _results[:] = [_stream(os.dup(1), sys.stdout, BrokenPipeError, by_line=os.isatty(1))]
    os.dup2(2, 1)
    sys.__stdout__ = results()  # pyright: ignore[reportAttributeAccessIssue]  # where rich measures the terminal
    print_on()


def print_on() -> None:
    """Lose what Python prints to stdout and stderr, instead of raising, where it cannot be written any more."""
    sys.stdout, sys.stderr = (_stream(n, like, lost=OSError) for n, like in ((1, sys.stdout), (2, sys.stderr)))


def _stream(descriptor: int, like: TextIO | None, lost: type[OSError], by_line: bool = True) -> TextIO:
    buffer = io.BufferedWriter(_Descriptor(descriptor, lost))
    # An encoding such as ASCII lacks letters of names.
    return io.TextIOWrapper(buffer, like.encoding if like else "utf-8", "backslashreplace", line_buffering=by_line)


class _Descriptor(io.FileIO):
    """A descriptor that takes, and loses, what fails with the error `lost`."""

    def __init__(self, descriptor: int, lost: type[OSError]) -> None:
        super().__init__(descriptor, "w", closefd=False)
        self._lost = lost

    def write(self, content: Any, /) -> int:
        """Write, or lose, all or a part."""
        try:
            return super().write(content)
        except self._lost:
            return len(content)
