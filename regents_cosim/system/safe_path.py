"""Keeps child processes from importing modules from the working directory, which may be a stranger's suite.

`multiprocessing` starts `python -c ...`, for which Python searches the working directory first: a `json.py` there would
run before any line of ours. With `-P` it is not searched. It is passed as a flag, since an environment variable would
reach the programs that a planner starts, and keep them from the modules beside their script.
"""

import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import util
from typing import Any

_FLAG = "-P"
_LOCK = threading.Lock()
_multiprocessing: Any = util  # it has no public place for flags
_its_flags = _multiprocessing._args_from_interpreter_flags
_blocks = 0  # number of open blocks


@contextmanager
def safe_path() -> Iterator[None]:
    """Start all processes of `multiprocessing` with a safe path while the block runs, including its helpers."""
    _count(1)
    try:
        yield
    finally:
        _count(-1)


def python_flags() -> list[str]:
    """Python's flags for a child process: those of this process, and the safe path."""
    flags: list[str] = subprocess._args_from_interpreter_flags()  # pyright: ignore[reportAttributeAccessIssue]
    return flags if _FLAG in flags else [_FLAG, *flags]


def _count(more: int) -> None:
    global _blocks
    with _LOCK:
        _blocks += more
        _multiprocessing._args_from_interpreter_flags = python_flags if _blocks else _its_flags
