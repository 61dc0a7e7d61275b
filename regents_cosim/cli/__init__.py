"""The command line: options in, calls of the package, tables out. Nothing else lives here.

Heavy imports happen inside the commands, so that `--help` answers at once. What follows `--` goes to SUMO. Exit codes
stand in `errors`. This module imports next to nothing: until `main` runs, Ctrl-C is answered by Python's traceback.
"""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys
import threading
from contextlib import suppress

TYPE_CHECKING = False  # what type checkers take for true
if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

# Importing and tracing make hundreds of thousands of objects that stay. With Python's own threshold (700) half a second
# of a command would be looking through them again and again.
_COLLECTED_AFTER = 50_000


def run(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code."""
    from regents_cosim.cli.application import run as run_command

    return run_command(arguments)


def main() -> None:
    """Entry point `regents`."""
    if hasattr(signal, "pthread_sigmask"):  # they wait until `end_at_once` has been imported
        signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
    from regents_cosim.system.interruption import end_at_once

    end_at_once()
    gc.set_threshold(_COLLECTED_AFTER)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # NumPy's threads spin while there is no large matrix for them
    _leave(run(sys.argv[1:]))


def _leave(code: int) -> None:
    """End this process as Python does, but for its last step: to take all modules apart, JAX's, lasts a second."""
    threads: Any = threading  # no public way to wait for all of them, nor to call what is registered
    registered: Any = atexit
    with suppress(OSError):  # the reader of the output is gone: Python has its own words for that
        threads._shutdown()
        registered._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)
