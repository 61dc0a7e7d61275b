"""Locks between processes, which the kernel takes back from a holder that is killed.

They are `flock`s. A library would add nothing: what needs care is a folder that is replaced while one waits for
it, and `filelock` would go on to hold the lock of the folder that is gone.
"""

import errno
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows: one writer at a time is up to the user there
    fcntl = None

from regents_cosim.errors import RegentsError

LOCK = ".lock"  # its name in a folder; removed when the lock is given back, and without meaning when no one holds it
WAIT_S = 60.0
_POLL_S = 0.01
_MOVED_S = 1.0  # how long a folder may be on its way to its place
_NO_LOCKS = frozenset({errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL})


@contextmanager
def writing(folder: Path, wait_s: float = WAIT_S) -> Iterator[None]:
    """Be the only process and thread that changes what lies in `folder`, which exists.

    Holds for the folder of that name, also where another one has taken its place meanwhile. Raises RegentsError
    where others do not let go of it within `wait_s`, or its file system has no locks.
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


def take(path: Path, flags: int) -> int | None:
    """A descriptor of the file or folder at `path` that holds its lock; None where another has it, or it is gone."""
    file = os.open(path, flags | getattr(os, "O_CLOEXEC", 0), 0o666)
    if _lock(file) and is_at(file, path):
        return file
    os.close(file)
    return None


def is_at(file: int, path: Path) -> bool:
    """Whether `path` is the name of this very file."""
    try:
        return os.path.samestat(os.fstat(file), os.lstat(path))
    except OSError:
        return False


def _wait_for(path: Path, until: float) -> int | None:
    """The lock at `path`, made there and held; None where it could not be had in time."""
    moved_until = time.monotonic() + _MOVED_S
    while True:
        try:
            file = take(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0))
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
            os.ftruncate(file, 0)
            os.write(file, str(os.getpid()).encode())
            return file
        if time.monotonic() > until:
            return None
        time.sleep(_POLL_S)


def _lock(file: int) -> bool:
    if fcntl is None:
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _holder(path: Path) -> str:
    """Who wrote itself into a lock file, in words."""
    try:
        number = path.read_bytes()[:20].decode("ascii")
    except (OSError, UnicodeDecodeError):
        return ""
    return f" (process {number})" if number.isdigit() else ""
