"""Commands under a mark that all of their children inherit, so that what they leave running can be found."""

import os
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import psutil

REGENTS = Path(sys.executable).parent / "regents"
_MARK = "REGENTS_ENDURANCE_MARK"


@dataclass
class Marked:
    """A command that runs in a session of its own."""

    process: subprocess.Popen[bytes]
    mark: str
    errors: Path

    def alive(self) -> list[psutil.Process]:
        """Every process that carries the mark, zombies left out."""
        found = []
        for process in psutil.process_iter():
            try:
                if process.environ().get(_MARK) == self.mark and process.status() != psutil.STATUS_ZOMBIE:
                    found.append(process)
            except (psutil.NoSuchProcess, psutil.AccessDenied, psutil.ZombieProcess):
                continue
        return found

    def send(self, number: signal.Signals, whole_group: bool) -> None:
        """A signal to the command alone (`kill`, `timeout`), or to its whole group (Ctrl-C at a terminal)."""
        with suppress(ProcessLookupError):
            (os.killpg if whole_group else os.kill)(self.process.pid, number)

    def left_after(self, seconds: float) -> list[str]:
        """End the processes that still run some time after their command has ended; return their command lines."""
        until = time.monotonic() + seconds
        left = self.alive()
        while left and time.monotonic() < until:
            time.sleep(0.1)
            left = self.alive()
        told = [_told(process) for process in left]
        for process in left:
            try:
                process.kill()
            except psutil.NoSuchProcess:
                continue
        return told


def start(words: Sequence[object], folder: Path, errors: Path) -> Marked:
    """Start a command whose stderr goes to the file `errors`."""
    mark = uuid.uuid4().hex
    with errors.open("wb") as stderr:
        process = subprocess.Popen(
            [str(word) for word in words],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=stderr,
            env=os.environ | {_MARK: mark, "PYTHONHASHSEED": "0"},
            start_new_session=True,
        )
    return Marked(process, mark, errors)


def _told(process: psutil.Process) -> str:
    try:
        return " ".join(process.cmdline())[:200] or process.name()
    except (psutil.NoSuchProcess, psutil.ZombieProcess):
        return f"process {process.pid}"
