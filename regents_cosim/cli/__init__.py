"""The command line: options in, calls of the package, tables out. Nothing else belongs here.

Heavy imports happen inside the commands, so that `--help` answers at once. Options after `--` are SUMO's. `errors`
lists the exit codes. This module imports next to nothing, since before `main` runs Ctrl-C would print Python's
traceback.
"""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys
import threading
from contextlib import suppress

TYPE_CHECKING = False  # type checkers assume that it is true
if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

# Importing and tracing create hundreds of thousands of objects that stay alive. With Python's default threshold (700)
# the garbage collector would spend half a second of a command on scanning them again and again.
_COLLECTED_AFTER = 50_000


def run(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code."""
    from regents_cosim.cli.application import run as run_command

    return run_command(arguments)


def main() -> None:
    """The entry point of `regents`."""
    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))  # until `end_at_once` is imported
    from regents_cosim.system.interruption import end_at_once
    from regents_cosim.system.standard_streams import keep_stdout_for_results

    keep_stdout_for_results()
    end_at_once()
    gc.set_threshold(_COLLECTED_AFTER)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # threads of NumPy would spin, since there are no large matrices
    _leave(run(sys.argv[1:]))


def _leave(code: int) -> None:
    """End this process as Python does, but without destroying all modules, which takes a second with JAX."""
    from regents_cosim.system.foreign_code import has_left_threads
    from regents_cosim.system.standard_streams import results

    threads: Any = threading  # there is no public function for this
    registered: Any = atexit
    with suppress(OSError):
        if not has_left_threads():  # those of a planner may never end
            threads._shutdown()
        registered._run_exitfuncs()
    for stream in (results(), sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # there is no room for it, or a planner has closed it
            stream.flush()
    os._exit(code)
