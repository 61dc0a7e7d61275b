"""Merge the shards of one run into the folder that the undivided run would give, byte for byte."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from msgspec.structs import replace as replace_struct

from regents_cosim.cases.files import STILL, load_case
from regents_cosim.cases.manifest import MANIFEST, SETTINGS_FILES, Suite, listed_in, load_manifest
from regents_cosim.checks.arguments import as_several
from regents_cosim.checks.bounded import MIB, read_bounded
from regents_cosim.checks.names import require_inside
from regents_cosim.errors import CaseError
from regents_cosim.runs.identity import changed_makers
from regents_cosim.runs.ledger import LedgerRecord, read_record, write_record
from regents_cosim.saving import add_case
from regents_cosim.system.files.atomic import explain_write, new_folder, require_new, write_atomic

_STILL_BYTES = 64 * MIB
_SETTINGS_BYTES = MIB


def shards_in(folders: Sequence[Path]) -> list[LedgerRecord] | None:
    """The ledgers of all shards of one finished run; None where the folders are ordinary suites.

    Raises CaseError where the shards belong to different runs, or one is missing or not finished.
    """
    found = [read_record(folder) for folder in folders]
    records = [record for record in found if record is not None and record.shard.count > 1]
    if not records:
        return None
    for folder, record in zip(folders, found, strict=True):
        _require_finished(folder, record)
    for folder, record in zip(folders[1:], records[1:], strict=True):
        _require_same_run(folders[0], records[0], folder, record)
    _require_all(folders, records)
    return sorted(records, key=lambda record: record.shard.number)


def merge_shards(output: Path | str, folders: Sequence[Path | str]) -> int:
    """Fill the new folder `output` with the cases of all shards of one finished run; return their number.

    Raises CaseError where the shards belong to different runs, or one is missing or not finished.
    """
    folder, shards = Path(output), [Path(one) for one in as_several(folders)]
    records = shards_in(shards)
    if records is None:
        raise CaseError(f"{', '.join(map(str, shards))}: expected the shards of a run")
    require_new(folder)
    done = {name: one for record in records for name, one in record.done.items()}
    whole = replace(records[0], begun=replace_struct(records[0].begun, shard=(1, 1)), done=done)
    home = {entry.case: shard for shard in shards for entry in listed_in(shard)}
    notes = replace(_notes(shards), cases=())
    with explain_write(folder), new_folder(folder.resolve()) as fresh:
        for case, shard in sorted(home.items()):
            add_case(load_case(shard / case), fresh, notes)
            if (still := require_inside(shard / case / STILL, shard)).exists():
                write_atomic(fresh / case / STILL, read_bounded(still, _STILL_BYTES))
        for name in SETTINGS_FILES:
            if (settings := require_inside(shards[0] / name, shards[0])).exists():
                write_atomic(fresh / name, read_bounded(settings, _SETTINGS_BYTES))
        write_record(fresh, whole)
    return len(home)


def _require_finished(folder: Path, record: LedgerRecord | None) -> None:
    if record is None or record.shard.count == 1:
        raise CaseError(f"{folder} is no shard, others are: expected all shards of one run, or suites alone")
    left = len(record.own) - len(record.finished)
    if record.plan is None or left:
        said = f"{left} of its {len(record.own)} units are left" if record.plan else "it has not begun its work"
        raise CaseError(f"{folder} is not finished, {said}: give its command again")


def _require_same_run(first: Path, one: LedgerRecord, folder: Path, other: LedgerRecord) -> None:
    a, b = one.begun.identity, other.begun.identity
    why = ""
    if (a.command, a.settings) != (b.command, b.settings) or one.shard.count != other.shard.count:
        why = "asked for other things"
    elif changed := changed_makers(a, b):
        why = f"were made by different code ({', '.join(changed)})"
    elif one.plan != other.plan:
        why = "found different windows"
    if why:
        raise CaseError(f"{first} (shard {one.shard}) and {folder} (shard {other.shard}) are of different runs: {why}")


def _require_all(folders: Sequence[Path], records: Sequence[LedgerRecord]) -> None:
    numbers = [record.shard.number for record in records]
    count = records[0].shard.count
    missing = sorted(set(range(1, count + 1)) - set(numbers))
    if missing:
        raise CaseError(f"shard {missing[0]}/{count} is missing ({len(missing)} of {count} are)")
    if len(numbers) > count:
        twice = next(number for number in numbers if numbers.count(number) > 1)
        raise CaseError(f"shard {twice}/{count} is named twice, of {len(folders)} folders")


def _notes(shards: Sequence[Path]) -> Suite:
    """The notes of the manifests on how the cases were made; all shards have the same."""
    return next((load_manifest(shard) for shard in shards if (shard / MANIFEST).exists()), Suite(()))
