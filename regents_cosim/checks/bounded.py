"""Read files of unknown origin: regular files only, and never more bytes than a stated limit.

A named pipe would block for ever, and a few kilobytes of gzip can hold gigabytes. So a file is opened without blocking,
its type is checked, and it is read and unpacked piece by piece.
"""

import gzip
import io
import os
import stat
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from regents_cosim.errors import InputError

MIB = 1 << 20
_GZIP = b"\x1f\x8b"
_LFS_POINTER = b"version https://git-lfs.github.com/spec/"  # where a repository was copied without its large files
_PIECE_BYTES = 1 << 16
_DATA = "gzip data"
_KINDS = {
    stat.S_IFDIR: "folder",
    stat.S_IFLNK: "link",
    stat.S_IFIFO: "named pipe",
    stat.S_IFCHR: "device",
    stat.S_IFBLK: "device",
}


class PointerError(InputError):
    """A file is a pointer of Git LFS."""


def read_bounded(path: Path, limit_bytes: int) -> bytes:
    """The content of a regular file. Raises InputError for anything else and for more than `limit_bytes`."""
    with _explain(path), _open_regular(path, limit_bytes) as file:
        return b"".join(_pieces(file, str(path), limit_bytes))


def gunzip_bounded(data: bytes, limit_bytes: int) -> bytes:
    """`data` decompressed. Raises InputError where the gzip data is damaged or holds more than `limit_bytes`."""
    with _explain(_DATA), gzip.GzipFile(fileobj=io.BytesIO(data)) as file:
        return b"".join(_pieces(file, _DATA, limit_bytes))


def open_bounded(path: Path, limit_bytes: int) -> io.BufferedReader:
    """Open a regular file, plain or gzip, as a stream of at most `limit_bytes` (after decompression).

    Raises InputError at once if it is not a regular file, and while reading if it is damaged or passes the limit.
    """
    with _explain(path):
        file = _open_regular(path, limit_bytes)
        packed = file.peek(2)[:2] == _GZIP
        plain = gzip.GzipFile(fileobj=file) if packed else file
    return io.BufferedReader(_Bounded(path, plain, file, limit_bytes), _PIECE_BYTES)


class _Bounded(io.RawIOBase):
    """A stream that passes on the bytes of `plain` and counts them."""

    def __init__(self, path: Path, plain: BinaryIO | gzip.GzipFile, file: BinaryIO, limit_bytes: int) -> None:
        super().__init__()
        self._path, self._plain, self._file = path, plain, file
        self._limit_bytes, self._given = limit_bytes, 0

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview, /) -> int:  # type: ignore[override]
        with _explain(self._path):
            piece = self._plain.read(min(len(buffer), _PIECE_BYTES))
        self._given += len(piece)
        _require_within(self._given, self._limit_bytes, str(self._path))
        buffer[: len(piece)] = piece
        return len(piece)

    def close(self) -> None:
        self._file.close()
        super().close()


def _open_regular(path: Path, limit_bytes: int) -> io.BufferedReader:
    """Open a regular file without blocking, as opening a named pipe otherwise would."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    try:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode):
            raise InputError(f"{path} is a {kind_in_words(found.st_mode)}, expected a file")
        _require_within(found.st_size, limit_bytes, str(path))
        if os.pread(descriptor, len(_LFS_POINTER), 0) == _LFS_POINTER:
            raise PointerError(f"{path} is a pointer of Git LFS, not the file itself (fetch that with `git lfs pull`)")
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def kind_in_words(mode: int) -> str:
    """The word for a file type, given the mode of something that is not a regular file."""
    return _KINDS.get(stat.S_IFMT(mode), "special file")


def _pieces(file: BinaryIO | gzip.GzipFile, name: str, limit_bytes: int) -> Iterator[bytes]:
    total = 0
    while piece := file.read(_PIECE_BYTES):
        total += len(piece)
        _require_within(total, limit_bytes, name)
        yield piece


def _require_within(size: int, limit_bytes: int, name: str) -> None:
    if size > limit_bytes:
        limit = f"{limit_bytes / MIB:g} MiB" if limit_bytes >= MIB else f"{limit_bytes} bytes"
        raise InputError(f"{name} holds more than {limit}, the most that is read of it")


@contextmanager
def _explain(name: Path | str) -> Iterator[None]:
    try:
        yield
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise InputError(f"{name}: its gzip data is damaged or cut off ({error})") from error
    except ValueError as error:  # a null byte in the name
        raise InputError(f"{name!r} cannot be a file name ({error})") from error
    except OSError as error:
        raise InputError(f"{name} cannot be read ({error.strerror or error})") from error
