"""The progress of a run, read from its ledger while it runs or afterwards."""

import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from regents_cosim.errors import CaseError
from regents_cosim.runs.ledger import FOLDER, RUNS, STEPS, read_clock, read_record
from regents_cosim.system.data_frames import Rows
from regents_cosim.system.files.locks import LOCK, try_lock


@dataclass(frozen=True)
class RunStatus:
    """The progress of one run."""

    folder: str
    command: str
    shard: str
    state: Literal["running", "stopped", "finished"]
    units: int | None  # number of units of work in this folder; None while unknown, as during recording
    done: int  # including the failed ones
    failed: int
    left: int | None
    per_hour: float | None  # units per hour in the latest session; None before its second unit, and for a finished run
    left_s: float | None  # [s] time for the rest at that rate
    failures: tuple[tuple[str, str], ...]  # pairs of unit and reason


def runs_in(folder: Path | str) -> Rows[RunStatus]:
    """The progress of the run in a folder; for a suite or a table being built, of each of its runs so far.

    Raises CaseError where no run that can be continued has begun there.
    """
    folder = Path(folder)
    places = (folder / FOLDER / STEPS, folder / RUNS)
    steps = sorted(path for place in places for path in place.glob("*") if (path / FOLDER).is_dir())
    return Rows(map(status_of, steps or [folder]))


def status_of(folder: Path) -> RunStatus:
    """The progress of the run in a folder. Raises CaseError where no run that can be continued has begun there."""
    record = read_record(folder)
    if record is None:
        raise CaseError(
            f"no run in {folder} (expected a folder that `regents record`, `attack`, `evaluate`, `suite build` or "
            "`bench table1` was given with -o)"
        )
    done = record.finished
    units = len(record.own) if record.plan else None
    left = None if units is None else units - len(done)
    running = _is_held(folder / FOLDER / LOCK)
    rate = _per_second(folder, running, len(done)) if left else None
    return RunStatus(
        folder=str(folder),
        command=record.begun.identity.command,
        shard=str(record.shard),
        state="running" if running else "finished" if left == 0 else "stopped",
        units=units,
        done=len(done),
        failed=sum(bool(one.error) for one in done),
        left=left,
        per_hour=round(3600.0 * rate, 1) if rate else None,
        left_s=round(left / rate, 1) if left and rate else None,
        failures=tuple((one.unit.name, one.error) for one in done if one.error),
    )


def _per_second(folder: Path, running: bool, done: int) -> float | None:
    """Units per second in the latest session: up to now while it runs, otherwise up to its last unit."""
    found = read_clock(folder)
    if found is None:
        return None
    clock, last_s = found
    seconds = (time.time() if running else last_s) - clock.begin_s
    return (done - clock.done) / seconds if done > clock.done and seconds > 0.0 else None


def _is_held(path: Path) -> bool:
    if not path.exists():
        return False
    try:
        file = try_lock(path, os.O_RDWR)
    except OSError:
        return False  # removed meanwhile, or of another user
    if file is not None:
        os.close(file)
    return file is None
