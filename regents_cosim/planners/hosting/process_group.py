"""Run a command in its own session, which ends with all that it started, whatever ends this process.

A keeper waits beside it: a shell that reads from a pipe whose other end only this process holds. Whatever ends this
process, even SIGKILL, closes that end; a second later the keeper kills the group. POSIX only.
"""

import os
import signal
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

_KEEPER = 'read -r _; sleep 1; kill -s KILL -- "-$0"'


class ProcessGroup:
    """The process of `command`; `how` holds further arguments of `subprocess.Popen`."""

    def __init__(self, command: Sequence[str], **how: Any) -> None:
        self.process: subprocess.Popen[Any] = subprocess.Popen(command, start_new_session=True, **how)
        self._keeper = subprocess.Popen(
            ["sh", "-c", _KEEPER, str(self.process.pid)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    def end(self) -> None:
        """Kill it and all that it started, except processes that have left its group."""
        with suppress(ProcessLookupError, PermissionError):  # macOS raises the latter for a group of dead processes
            os.killpg(self.process.pid, signal.SIGKILL)
        self._keeper.kill()
        for process in (self.process, self._keeper):
            process.wait()
        assert self._keeper.stdin
        self._keeper.stdin.close()

    def outcome(self, patience_s: float) -> str:
        """How it ended, or that it has not ended within `patience_s` [s]."""
        try:
            code = self.process.wait(patience_s)
        except subprocess.TimeoutExpired:
            return "it was ended"
        return f"exit code {code}" if code >= 0 else f"killed by {signal.Signals(-code).name}"
