"""Locks between processes, which the kernel releases when the holder is killed.

They are `flock`s. A library would not help with the difficult case, a folder that is replaced while one waits for it:
`filelock` would keep the lock of the folder that is gone.
"""

import errno
import fcntl
import os
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from regents_cosim.checks.bounded import kind_in_words
from regents_cosim.errors import RegentsError

LOCK = ".lock"  # name of the lock file in a folder; it is removed on release, and means nothing while nobody holds it
WAIT_S = 60.0
_POLL_S = 0.01
_MOVED_S = 1.0  # longest time during which a folder is being swapped
_PLAIN = os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_NOCTTY
_NO_LOCKS = frozenset({errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL})


@contextmanager
def writing(folder: Path, wait_s: float = WAIT_S) -> Iterator[None]:
    """Be the only process and thread that changes the content of `folder`, which must exist.

    The lock is that of the folder's name, even if another folder takes its place meanwhile. Raises RegentsError where
    another process holds it for longer than `wait_s`, or the file system has no locks.
    """
    path = folder / LOCK
    file = _wait_for(path, time.monotonic() + wait_s)
    if file is None:
        raise RegentsError(
            f"{folder} has been written by another process for {wait_s:g} s{_holder(path)}: "
            "wait until it has ended, or name another folder with -o"
        )
    try:
        yield
    finally:
        if is_at(file, path):
            path.unlink(missing_ok=True)
        os.close(file)


def try_lock(path: Path, flags: int) -> int | None:
    """Lock the file or folder at `path` and return a descriptor; None where another holds the lock, or it is gone.

    Raises OSError for a link, a pipe or a device, which is not opened.
    """
    file = open_plain(path, flags)
    if _lock(file) and is_at(file, path):
        return file
    os.close(file)
    return None


def open_plain(path: Path, flags: int) -> int:
    """Open the file or folder at `path` itself. Raises OSError for a link, a pipe or a device."""
    with suppress(FileNotFoundError):
        mode = os.lstat(path).st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise OSError(errno.ENXIO, f"{path.name} is a {kind_in_words(mode)}, expected a file or folder of ours")
    return os.open(path, flags | _PLAIN, 0o666)


def is_at(file: int, path: Path) -> bool:
    """Whether `path` still names this open file."""
    try:
        return os.path.samestat(os.fstat(file), os.lstat(path))
    except OSError:
        return False


def _wait_for(path: Path, until: float) -> int | None:
    """Create the lock file at `path` and lock it; None where that fails in time."""
    moved_until = time.monotonic() + _MOVED_S
    while True:
        try:
            file = try_lock(path, os.O_RDWR | os.O_CREAT)
        except FileNotFoundError:
            if time.monotonic() > moved_until:
                raise
            file = None
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                raise
            raise RegentsError(
                f"{path.parent}: its file system has no locks ({error.strerror}); name a folder elsewhere with -o"
            ) from error
        if file is not None:
            if os.fstat(file).st_nlink == 1:  # a second name (hard link) may lie in a place that is not ours
                os.ftruncate(file, 0)
                os.write(file, str(os.getpid()).encode())
            return file
        if time.monotonic() > until:
            return None
        time.sleep(_POLL_S)


def _lock(file: int) -> bool:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _holder(path: Path) -> str:
    try:
        with path.open("rb") as file:
            number = file.read(20).decode("ascii")
    except (OSError, UnicodeDecodeError):
        return ""
    return f" (process {number})" if number.isdigit() else ""
