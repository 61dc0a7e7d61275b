"""The ledger of a folder: a list of finished work, by which the same command continues where it was stopped.

`FOLDER/.run/ledger.jsonl` has a line that identifies the run, a line that lists all units of work once they are known,
and two lines for every unit, each added in one piece: the cases that it is about to save, and that all of it is on
disk. A killed run leaves at worst a torn last line, which the next run cuts off. In the ledger of a finished run only
the last line of each unit is left, in the order of the units; nothing shows when or how often the run was stopped.
"""

import os
import stat
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
from msgspec.structs import replace as replace_struct

from regents_cosim.cases.files import CASE_FILES
from regents_cosim.cases.header import HEADER
from regents_cosim.cases.json_files import with_new_keys
from regents_cosim.cases.manifest import MANIFEST, listed_in
from regents_cosim.cases.map_files import is_map_file
from regents_cosim.checks.bounded import MIB, read_bounded
from regents_cosim.checks.names import inside, require_file_name, require_inside
from regents_cosim.checks.typed_values import from_json
from regents_cosim.errors import CaseError, InputError
from regents_cosim.runs.identity import Identity, changed_makers, require_same
from regents_cosim.runs.shards import WHOLE, Shard
from regents_cosim.system.files.atomic import clear_leftovers, explain_write, is_temporary, remove_written, write_atomic
from regents_cosim.system.files.locks import open_plain, writing
from regents_cosim.system.interruption import uninterrupted

FOLDER = ".run"
STEPS = "steps"  # folder in `.run` for the intermediate steps of a larger result
RUNS = "runs"  # folder beside `.run` for the runs of a table, each with its own ledger
_FILE = "ledger.jsonl"
_CLOCK = "clock.json"  # only while the run is unfinished, as times differ from run to run
_BYTES = 1024 * MIB  # limit of the file; a unit takes 300 bytes
SCHEMA = 1
_LOOKED_AT_S = 0.2  # `regents status` holds the lock for a moment, to see whether another process does
_NOT_DONE = ""  # in the place of a key: no unit of a run has it


class WorkUnit(msgspec.Struct, frozen=True, array_like=True):
    """A piece of work: its name, and a key over everything that decides its result."""

    name: str
    key: str

    def __post_init__(self) -> None:
        require_file_name(self.name, "unit of a ledger")


class DoneUnit(msgspec.Struct, frozen=True, tag="done", omit_defaults=True):
    """A finished unit of work."""

    unit: WorkUnit
    cases: tuple[tuple[str, str], ...] = ()  # names and content hashes of the cases that it left in the folder
    said: dict[str, Any] = {}
    error: str = ""  # why it failed; empty if it did not

    def __post_init__(self) -> None:
        for name, _ in self.cases:
            require_file_name(name, "case of a ledger")


class RunPlan(msgspec.Struct, frozen=True, tag="plan", omit_defaults=True):
    """All units of a run, with those of its other shards; `key` identifies what they follow from."""

    key: str
    units: tuple[WorkUnit, ...]
    ended: bool = False  # no more units come: everything is found, or cannot be found


class RunBegun(msgspec.Struct, frozen=True, tag="run"):
    """The identity of the run in a folder."""

    schema: int
    identity: Identity
    shard: tuple[int, int] = (1, 1)
    together: int = 1  # neighbouring units that share one computation


class Clock(msgspec.Struct, frozen=True):
    """When the latest session began, and how many units were done by then."""

    begin_s: float  # [s] since 1970
    done: int


@dataclass(frozen=True)
class LedgerRecord:
    """The content of a ledger."""

    begun: RunBegun
    plan: RunPlan | None = None
    done: dict[str, DoneUnit] = field(default_factory=dict)  # by name; also outdated and lost ones, for their cases

    @property
    def shard(self) -> Shard:
        """The shard of this folder."""
        return Shard(*self.begun.shard)

    @property
    def own(self) -> Sequence[WorkUnit]:
        """The units of this folder, in order; empty while they are unknown."""
        return self.shard.of(self.plan.units, self.begun.together) if self.plan else ()

    def is_done(self, unit: WorkUnit) -> bool:
        """Whether this very unit is done or has failed."""
        found = self.done.get(unit.name)
        return found is not None and found.unit == unit

    @property
    def finished(self) -> list[DoneUnit]:
        """The units of this folder that are done or have failed, in order."""
        return [self.done[unit.name] for unit in self.own if self.is_done(unit)]

    def lines(self) -> bytes:
        """The whole file, with its units in order and no others."""
        return _lines(self, self.finished)


def read_record(folder: Path) -> LedgerRecord | None:
    """The ledger of `folder`; None where no run with a ledger has begun. Raises CaseError for a damaged ledger."""
    return _read(require_inside(folder / FOLDER / _FILE, folder))[0]


def read_clock(folder: Path) -> tuple[Clock, float] | None:
    """The begin of the latest session, and the time of its last unit [s since 1970]; None for a finished run."""
    try:
        text, last = read_bounded(folder / FOLDER / _CLOCK, MIB), (folder / FOLDER / _FILE).stat().st_mtime
        return from_json(text, Clock), last
    except (OSError, InputError, msgspec.MsgspecError):
        return None


class Ledger:
    """The ledger of one folder, held by the one process that works there (see `open_ledger`)."""

    def __init__(self, folder: Path, record: LedgerRecord, changed: Sequence[str] = ()) -> None:
        self.folder, self.record = folder, record
        self.changed = changed  # packages and planners whose code has changed since earlier sessions
        self.place = folder / FOLDER
        self._begin_s = time.time()
        self._file: int | None = None

    def gone(self, units: Sequence[WorkUnit]) -> list[str]:
        """The names of cases in the folder that belong to none of these units."""
        names = {unit.name for unit in units}
        return [case for name, done in self.record.done.items() if name not in names for case, _ in done.cases]

    def plan(self, key: str, units: Sequence[WorkUnit]) -> None:
        """Note the list of units, and forget finished units that are not in it."""
        names = {unit.name for unit in units}
        kept = {name: done for name, done in self.record.done.items() if name in names}
        self.record = replace(self.record, plan=RunPlan(key, tuple(units)), done=kept)
        self._rewrite(_lines(self.record, self.record.done.values()))

    def note_begun(self, name: str, cases: Iterable[str]) -> None:
        """Note the cases that are about to be saved for the unit `name`, which a kill may leave without a done unit."""
        known = {case for case, _ in self.record.done[name].cases} if name in self.record.done else set[str]()
        self.note(DoneUnit(WorkUnit(name, _NOT_DONE), tuple((case, "") for case in sorted(known.union(cases)))))

    def note(self, done: DoneUnit) -> None:
        """Note a unit that is done and on disk."""
        with explain_write(self.folder), uninterrupted():
            if self._file is None:
                write_atomic(self.place / _CLOCK, msgspec.json.encode(Clock(self._begin_s, len(self.record.finished))))
                self._file = open_plain(self.place / _FILE, os.O_WRONLY | os.O_APPEND)
            os.write(self._file, _line(done))
        self.record.done[done.unit.name] = done

    def holds_work(self) -> bool:
        """Whether a unit is done, or intermediate results are kept."""
        return bool(self.record.done) or any(path.is_dir() for path in self.place.iterdir())

    def left(self, retry: bool = False) -> list[WorkUnit]:
        """The units of this folder that are not done; with `retry` also those that failed."""
        return [u for u in self.record.own if not self.record.is_done(u) or (retry and self.record.done[u.name].error)]

    def end(self) -> None:
        """Note that the units that are not done are no longer wanted."""
        assert self.record.plan is not None
        done = tuple(unit for unit in self.record.plan.units if self.record.is_done(unit))
        self.record = replace(self.record, plan=replace_struct(self.record.plan, units=done, ended=True))

    def finish(self) -> None:
        """Finish the run: write the final ledger, and remove everything that depends on how the run went."""
        self._rewrite(self.record.lines())
        (self.place / _CLOCK).unlink(missing_ok=True)
        for path in self.place.iterdir():
            if path.is_dir():
                remove_written(path, is_written)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _rewrite(self, lines: bytes) -> None:
        self.close()
        with explain_write(self.folder):
            write_atomic(self.place / _FILE, lines)


@contextmanager
def open_ledger(folder: Path, identity: Identity, shard: Shard = WHOLE, together: int = 1) -> Iterator[Ledger]:
    """Open the ledger of `folder` for a run; no other process writes to it meanwhile.

    Raises CaseError where the folder was begun with other settings or as another shard, RegentsError where another run
    is at work there.
    """
    place, maps = inside(folder, FOLDER), inside(folder, "maps")
    with explain_write(folder):
        place.mkdir(parents=True, exist_ok=True)
        with writing(place, wait_s=_LOOKED_AT_S):
            for where in (folder, maps, place):
                clear_leftovers(where)
            record, whole = _read(place / _FILE)
            begun = RunBegun(SCHEMA, identity, (shard.number, shard.count), together)
            if record is not None:
                require_same(folder, record.begun.identity, identity, record.shard, shard)
            new = replace(record, begun=begun) if record else LedgerRecord(begun)
            ledger = Ledger(folder, new, changed_makers(record.begun.identity, identity) if record else ())
            if record is None or record.begun != begun or not whole or not _is_its_own(place / _FILE):
                write_atomic(place / _FILE, _lines(new, new.done.values()))
            ended = False
            try:
                yield ledger
                ended = True
            finally:
                ledger.close()
                # the run failed before it did anything
                if ledger.record.plan is None or not (ended or ledger.holds_work()):
                    remove_written(place, is_written)
                    with suppress(OSError):
                        folder.rmdir()


def redo_lost(ledger: Ledger) -> None:
    """Let units of which the user has removed a case be done again; their other cases stay known as theirs."""
    folder, done = ledger.folder, ledger.record.done
    there = {entry.case for entry in listed_in(folder) if (folder / entry.case / HEADER).is_file()}
    for name, one in done.items():
        if not there.issuperset(case for case, _ in one.cases):
            done[name] = replace_struct(one, unit=WorkUnit(name, _NOT_DONE))


def require_free(folder: Path, identity: Identity, shard: Shard = WHOLE) -> None:
    """Raise CaseError where `open_ledger` would refuse the folder; nothing is written."""
    record = read_record(folder)
    if record is not None:
        require_same(folder, record.begun.identity, identity, record.shard, shard)


def write_record(folder: Path, record: LedgerRecord) -> None:
    """Write a finished ledger into a new folder that is about to be moved to its place."""
    (folder / FOLDER).mkdir(exist_ok=True)
    write_atomic(folder / FOLDER / _FILE, record.lines())


def is_written(name: str) -> bool:
    """Whether a file in `FOLDER`, or in the cases and runs below it, has a name that this package writes."""
    return name in (_FILE, _CLOCK, MANIFEST, *CASE_FILES) or is_map_file(name) or is_temporary(name)


def _is_its_own(path: Path) -> bool:
    """Whether a file has no second name, so that writing to it changes no other file."""
    found = os.lstat(path)
    return stat.S_ISREG(found.st_mode) and found.st_nlink == 1


def _line(value: msgspec.Struct) -> bytes:
    return msgspec.json.encode(value, order="deterministic") + b"\n"


def _lines(record: LedgerRecord, done: Iterable[DoneUnit]) -> bytes:
    return b"".join(map(_line, [record.begun, *([record.plan] if record.plan else []), *done]))


def _read(path: Path) -> tuple[LedgerRecord | None, bool]:
    """The content of a ledger, and whether its last line is complete. Raises CaseError."""
    if not path.exists():
        return None, True
    text = read_bounded(path, _BYTES)
    lines = text[: text.rfind(b"\n") + 1].splitlines()
    kind: Any = RunBegun | RunPlan | DoneUnit
    try:
        said = [from_json(with_new_keys(line), kind) for line in lines]
    except msgspec.MsgspecError as error:
        raise CaseError(f"{path}: {error} (remove {path.parent} to begin again)") from error
    if not said or not isinstance(said[0], RunBegun):
        return None, False
    if said[0].schema > SCHEMA:
        raise CaseError(f"{path}: schema {said[0].schema}, this version reads up to {SCHEMA} (upgrade regents_cosim)")
    plans = [one for one in said if isinstance(one, RunPlan)]
    done = {one.unit.name: one for one in said if isinstance(one, DoneUnit)}
    return LedgerRecord(said[0], plans[-1] if plans else None, done), text.endswith(b"\n")
