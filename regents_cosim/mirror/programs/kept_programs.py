"""The folder of cached programs: private, as its content is run; bounded; without entries cut off by a kill."""

import os
import stat
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from regents_cosim.errors import require

LIMIT_BYTES = 2 << 30
_CHECKED = ".checked"  # its time is that of the last search for cut-off entries
_OTHERS = stat.S_IWGRP | stat.S_IWOTH
_ZLIB = b"\x78"  # first byte of JAX's entries that are packed with zlib

_Entry = os.DirEntry[str]


def private_folder(folder: Path) -> Path:
    """Return `folder`, made private to its owner where it is missing.

    Raises OSError where it cannot be made, RegentsError where others can write to it or replace it.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    real = folder.resolve()
    found = real.stat()
    require(found.st_uid == os.geteuid(), _refused(real, f"belongs to user {found.st_uid}"))
    require(not found.st_mode & _OTHERS, _refused(real, "can be written by others (`chmod go-w` forbids it)"))
    for parent in real.parents:
        mode = parent.stat().st_mode
        open_to_all = mode & stat.S_IWOTH and not mode & stat.S_ISVTX
        require(not open_to_all, _refused(real, f"lies in {parent}, which all users can write to"))
    return folder


def tidy(folder: Path, limit_bytes: int = LIMIT_BYTES) -> None:
    """Remove entries that a kill has cut off since the last call, then the least recently used beyond the limit."""
    taken = 0
    for entry in sorted(_without_cut_off(folder), key=_last_used, reverse=True):
        taken += entry.stat().st_size
        if taken > limit_bytes:
            with suppress(OSError):
                os.unlink(entry)


def _without_cut_off(folder: Path) -> list[_Entry]:
    """Remove entries that a kill has cut off, and return the rest.

    JAX writes entries in place; it reports a damaged one in every run, but never replaces it.
    """
    checked = folder / _CHECKED
    since = checked.stat().st_mtime if checked.exists() else 0.0
    checked.touch()
    kept = []
    for entry in _entries(folder):
        if entry.stat().st_mtime >= since and entry.name.endswith("-cache") and _is_cut_off(Path(entry)):
            Path(entry).unlink(missing_ok=True)
        else:
            kept.append(entry)
    return kept


def _is_cut_off(path: Path) -> bool:
    with suppress(OSError):
        content = path.read_bytes()
        try:
            if not content or content[:1] == _ZLIB:
                zlib.decompress(content)
        except zlib.error:
            return True
    return False


def _entries(folder: Path | _Entry) -> Iterator[_Entry]:
    """All files of a folder; faster than `Path.rglob`, because every process looks at thousands of them."""
    with suppress(OSError), os.scandir(folder) as found:  # another process may tidy as well
        for entry in found:
            if entry.is_dir(follow_symlinks=False):
                yield from _entries(entry)
            elif entry.name != _CHECKED:
                with suppress(OSError):
                    if stat.S_ISREG(entry.stat().st_mode):  # which the entry caches
                        yield entry


def _last_used(entry: _Entry) -> float:
    return max(entry.stat().st_atime, entry.stat().st_mtime)


def _refused(folder: Path, why: str) -> str:
    return (
        f"compiled programs are not kept in {folder}: it {why}, and they would be run; "
        "name another folder with $REGENTS_CACHE, or REGENTS_CACHE=off"
    )
