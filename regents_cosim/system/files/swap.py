"""Replaces a folder by another one, so that a kill at any moment leaves one of the two in place."""

import ctypes
import os
import re
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from regents_cosim.system.files.locks import try_lock

_AT_FDCWD = -100
_RENAME_EXCHANGE = 2
_OLD = ".old"  # suffix of the replaced folder
_WAIT_S = 2.0
_POLL_S = 0.01


def swap(fresh: Path, target: Path) -> Path:
    """Rename `fresh` to `target`; return the new path of the previous `target`, if there was one.

    Linux exchanges the two in one step. On NFS two renames do, and `restore` undoes the first one if the second did not
    happen.
    """
    if not os.path.lexists(target):
        fresh.rename(target)
        return fresh
    if _exchange(fresh, target):
        return fresh
    old = fresh.with_name(fresh.name + _OLD)
    target.rename(old)
    fresh.rename(target)
    return old


def restore(target: Path) -> None:
    """Put the folder `target` back where a writer was killed between the two renames of `swap`.

    For readers and writers that do not find it; it waits for a writer that is alive.
    """
    until = time.monotonic() + _WAIT_S
    while not os.path.lexists(target) and time.monotonic() < until:
        left = list(_set_aside(target))
        if not left:
            return
        for old in left:
            _give_back(old, target)


def _set_aside(target: Path) -> Iterator[Path]:
    ours = re.compile(rf"\.{re.escape(target.name)}\.[0-9a-f]{{8}}\.tmp{re.escape(_OLD)}")
    try:
        yield from (Path(entry.path) for entry in os.scandir(target.absolute().parent) if ours.fullmatch(entry.name))
    except OSError:
        return


def _give_back(old: Path, target: Path) -> None:
    fresh = old.with_name(old.name.removesuffix(_OLD))
    try:
        lock = try_lock(fresh, os.O_RDONLY)
    except OSError:
        _rename_if_free(old, target)
        return
    if lock is None:
        time.sleep(_POLL_S)
        return
    _rename_if_free(old, target)
    os.close(lock)


def _rename_if_free(old: Path, target: Path) -> None:
    try:
        if not os.path.lexists(target):
            old.rename(target)
    except OSError:
        return  # another process was faster, or the folder is read-only


def _exchange(one: Path, other: Path) -> bool:
    """Exchange two names in one step. False where the system or the file system cannot."""
    call = _renameat2()
    if call is None:
        return False
    return call(_AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other), _RENAME_EXCHANGE) == 0


@cache
def _renameat2() -> Any:
    try:
        return ctypes.CDLL(None, use_errno=True).renameat2
    except (AttributeError, OSError):  # an old C library
        return None
