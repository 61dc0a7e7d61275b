"""Columns of CSV files, plain or gzip, read a piece at a time."""

import csv
import gzip
import io
import itertools
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from regents_cosim.errors import LogError

_ROWS = 50_000  # at a time
_MOST_UNPACKED = 100  # times the size of a gzip file; logs as text are 3 to 10 times as large


class Columns(NamedTuple):
    """Numbers by column, and texts as codes into a list of those that occur."""

    numbers: dict[str, Float[np.ndarray, " row"]]
    codes: dict[str, Int[np.ndarray, " row"]]
    texts: dict[str, list[str]]

    def __len__(self) -> int:
        return len(next(iter(self.numbers.values())))


def header_of(head: bytes) -> list[str]:
    """The names in the first line."""
    line = head.split(b"\n", 1)[0].decode("utf-8-sig", "replace").strip()
    return [name.strip().strip('"') for name in line.split(_separator(line))]


def read_columns(
    path: Path, numbers: Sequence[str], texts: Sequence[str] = (), optional: Sequence[str] = ()
) -> Columns:
    """Columns of a file by name; those in `optional` may be missing, and then are missing in the result.

    Numbers may have separators of thousands; an empty field is NaN. Raises LogError for a
    missing column, a row that is too short, a field that is no number.
    """
    with _opened(path) as file:
        line = file.readline()
        names = header_of(line.encode())
        missing = [name for name in (*numbers, *texts) if name not in names and name not in optional]
        if missing:
            raise LogError(f"{path}: no column {', '.join(missing)}; the header has {', '.join(names)[:200]}")
        wanted = [name for name in (*numbers, *texts) if name in names]
        kept: dict[str, list[np.ndarray]] = {name: [] for name in wanted}
        codes: dict[str, dict[str, int]] = {name: {} for name in texts}
        rows = csv.reader(file, delimiter=_separator(line))
        for piece in _pieces(rows, path):
            for name in wanted:
                place = names.index(name)
                values = [row[place] for row in piece] if len(min(piece, key=len)) > place else _short(piece, path)
                known = codes.get(name)
                if known is None:
                    kept[name].append(_numbers(values, name, path))
                else:
                    kept[name].append(np.array([known.setdefault(v, len(known)) for v in values], int))
    joined = {name: np.concatenate(parts) if parts else np.zeros(0) for name, parts in kept.items()}
    if not len(joined[wanted[0]]):
        raise LogError(f"{path}: no rows")
    return Columns(
        {name: joined[name] for name in numbers if name in joined},
        {name: joined[name] for name in texts if name in joined},
        {name: list(codes[name]) for name in texts if name in joined},
    )


def _short(piece: list[list[str]], path: Path) -> list[str]:
    shortest = min(piece, key=len)
    raise LogError(f"{path}: truncated or damaged CSV, a row of {len(shortest)} fields ({','.join(shortest)[:60]!r})")


def _pieces(rows: Iterator[list[str]], path: Path) -> Iterator[list[list[str]]]:
    try:
        while piece := list(itertools.islice(rows, _ROWS)):
            if filled := [row for row in piece if row]:
                yield filled
    except (csv.Error, UnicodeDecodeError, EOFError, OSError, zlib.error) as error:
        raise LogError(f"{path}: truncated or damaged CSV ({error})") from error


def _numbers(values: list[str], name: str, path: Path) -> Float[np.ndarray, " row"]:
    try:
        return np.array(values, float)
    except ValueError:
        pass
    try:
        return np.array([float(v.replace(",", "")) if v.strip() else np.nan for v in values])
    except ValueError as error:
        raise LogError(f"{path}: column {name}: {str(error)[:200]}") from error


def _separator(line: str) -> str:
    return max(",;\t", key=line.count)


@contextmanager
def _opened(path: Path) -> Iterator[io.TextIOWrapper]:
    with path.open("rb") as file:
        is_gzip = file.read(2) == b"\x1f\x8b"
        file.seek(0)
        limit = _MOST_UNPACKED * path.stat().st_size + (1 << 26)
        if is_gzip:
            with gzip.GzipFile(fileobj=file) as packed:
                yield io.TextIOWrapper(io.BufferedReader(_Limited(packed, limit, path)), "utf-8-sig", newline="")
        else:
            yield io.TextIOWrapper(file, "utf-8-sig", newline="")


class _Limited(io.RawIOBase):
    """What a gzip file holds, up to a limit: no log packs a hundred to one."""

    def __init__(self, stream: gzip.GzipFile, limit: int, path: Path) -> None:
        self._stream, self._left, self._path = stream, limit, path

    def readable(self) -> bool:
        """It is."""
        return True

    def readinto(self, buffer: Any) -> int:
        """As `io.RawIOBase` has it."""
        view = memoryview(buffer).cast("B")
        content = self._stream.read(len(view))
        self._left -= len(content)
        if self._left < 0:
            raise LogError(f"{self._path}: unpacks to more than 100 times its size, expected a log")
        view[: len(content)] = content
        return len(content)
