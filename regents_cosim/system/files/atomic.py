"""Writes files and folders atomically: under a temporary name, which is then renamed.

The writer locks its temporary file, so that the next writer recognises those of dead writers and removes them.
"""

import os
import re
import secrets
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from pathlib import Path

from regents_cosim.errors import RegentsError
from regents_cosim.system.files.locks import LOCK, try_lock
from regents_cosim.system.files.swap import restore, swap
from regents_cosim.system.interruption import uninterrupted

_TEMPORARY = re.compile(r"\.(?P<name>.+)\.[0-9a-f]{8}\.tmp(?P<aside>\.old)?", re.DOTALL)
_TRIES = 20  # for names, and for a folder that is replaced while a file in it is written


@contextmanager
def new_folder(target: Path, ours: Callable[[Path, Path], bool] = lambda folder, path: True) -> Iterator[Path]:
    """Yield a folder with a temporary name that replaces `target` when the block succeeds.

    Content of the old folder for which `ours(folder, path)` is false is kept in the new one. Only one writer at a time
    may replace a folder: hold a lock where there can be others.
    """
    target = Path(os.path.realpath(target.parent), target.name)
    restore(target)
    clear_leftovers(target.parent, target.name)
    with uninterrupted():
        folder, lock = temporary(target, make_folder)
        old = folder
        try:
            yield folder
            _keep_rest(target, folder, ours)
            old = swap(folder, target)
            _keep_rest(old, target, ours)  # what was added while this was written
        finally:
            remove(old)
            os.close(lock)


def write_atomic(path: Path, content: bytes) -> None:
    """Write `content` to `path`, as a whole or not at all."""
    clear_leftovers(path.parent, path.name)
    with uninterrupted():
        _replace(path, content)


def _replace(path: Path, content: bytes) -> None:
    for left in reversed(range(_TRIES)):
        fresh, file = temporary(path, partial(try_lock, flags=os.O_RDWR | os.O_CREAT | os.O_EXCL))
        try:
            with open(file, "wb", closefd=False) as stream:
                stream.write(content)
            os.replace(fresh, path)
            return
        except FileNotFoundError:  # the folder was replaced meanwhile; write into the new one
            if not left or not path.parent.exists():
                raise
        finally:
            fresh.unlink(missing_ok=True)
            os.close(file)


def is_temporary(name: str) -> bool:
    """Whether a name is that of a lock or of a temporary file or folder, and so not the user's."""
    return name == LOCK or _TEMPORARY.fullmatch(name) is not None


def clear_leftovers(folder: Path, name: str | None = None) -> None:
    """Remove the temporaries of dead writers in `folder`: all, or those for a file or folder `name`."""
    try:
        with os.scandir(folder) as entries:  # a suite may hold tens of thousands
            hidden = [(entry.path, entry.name) for entry in entries if entry.name.startswith(".")]
    except OSError:
        return
    found = [(Path(path), match) for path, called in hidden if (match := _TEMPORARY.fullmatch(called))]
    for path, match in sorted(found, key=lambda one: not one[1]["aside"]):
        if name in (None, match["name"]):
            target = path.with_name(match["name"])
            if match["aside"]:
                restore(target)
            if not match["aside"] or os.path.lexists(target):
                _remove_dead(path)


def require_writable(folder: Path) -> None:
    """Raise RegentsError if `folder` could not be created or written; creates nothing."""
    existing = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK | os.X_OK):
        raise RegentsError(
            f"cannot write to {folder}: {existing} is not a folder that can be written to (choose another)"
        )


def require_new(folder: Path) -> None:
    """Raise RegentsError unless `folder` can be made, or is empty and can be replaced by a new one."""
    require_writable(folder)
    if folder.exists() and any(folder.iterdir()):
        raise RegentsError(f"{folder} is not empty; name a new folder with -o")
    if folder.exists() and folder.samefile("."):
        raise RegentsError(f"{folder} is the current folder, which is not replaced; name a new folder with -o")


@contextmanager
def explain_write(folder: Path) -> Iterator[None]:
    """Turn the system's refusal to write into an error that names the folder."""
    try:
        yield
    except OSError as error:
        raise RegentsError(f"cannot write to {folder}: {error.strerror} (choose another folder)") from error


def temporary(target: Path, make: Callable[[Path], int | None]) -> tuple[Path, int]:
    """Make a new file or folder beside `target`; also returns the descriptor that holds its lock."""
    for _ in range(_TRIES):
        path = target.with_name(f".{target.name}.{secrets.token_hex(4)}.tmp")
        lock = make(path)
        if lock is not None:
            return path, lock
    raise RegentsError(f"cannot write to {target}: another process removes its temporary files (choose another folder)")


def make_folder(path: Path, mode: int = 0o777) -> int | None:
    """Make a folder with `mode`, reduced by the umask, and lock it; None where it was removed meanwhile."""
    path.mkdir(mode)
    try:
        return try_lock(path, os.O_RDONLY)
    except FileNotFoundError:  # removed before it was locked
        return None


def _remove_dead(path: Path) -> None:
    """Remove a temporary unless its writer still holds the lock."""
    try:
        lock = try_lock(path, os.O_RDONLY)
    except OSError:
        return  # gone, or owned by another user
    if lock is None:
        return
    remove(path)
    os.close(lock)


def remove(path: Path) -> None:
    """Remove a file or a folder as far as possible; of a link only the link itself."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
        return
    with suppress(OSError):
        path.unlink(missing_ok=True)


def remove_written(folder: Path, ours: Callable[[str], bool]) -> None:
    """Remove files in `folder` and below whose names are ours, then empty folders; links are not followed."""
    if folder.is_symlink():
        return
    for place, _, files in os.walk(folder, topdown=False):
        for name in filter(ours, files):
            with suppress(OSError):
                os.unlink(os.path.join(place, name))
        with suppress(OSError):
            os.rmdir(place)


def _keep_rest(old: Path, new: Path, ours: Callable[[Path, Path], bool]) -> None:
    """Add to `new` what is in `old`, is not ours, and is not in `new` yet, as hard links."""
    if old.is_symlink():
        return
    for folder, folders, files in os.walk(old):
        inside = Path(folder).relative_to(old)
        linked = [name for name in folders if (old / inside / name).is_symlink()]
        folders[:] = [name for name in folders if not is_temporary(name)]
        for name in (*files, *linked):
            path = inside / name
            if not is_temporary(name) and not ours(old, path) and not os.path.lexists(new / path):
                (new / inside).mkdir(parents=True, exist_ok=True)
                _link(old / path, new / path)


def _link(source: Path, target: Path) -> None:
    try:
        os.link(source, target, follow_symlinks=False)
    except OSError:  # a file system without hard links
        mode = os.lstat(source).st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISLNK(mode)):
            raise
        shutil.copy2(source, target, follow_symlinks=False)


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """A temporary folder, readable only by this user, that is removed when the block ends.

    If the process is killed before, the next process that asks for such a folder removes it.
    """
    folder, lock = temporary(_place(tempfile.gettempdir()), partial(make_folder, mode=0o700))
    try:
        yield folder
    finally:
        remove(folder)
        os.close(lock)


@cache
def _place(among: str) -> Path:
    """The name prefix of the folders in `among`; the first call removes those of dead processes."""
    place = Path(among, f"regents-{os.getuid()}")
    clear_leftovers(place.parent, place.name)
    return place
