"""Reads columns of tables in text files, plain or gzip, piece by piece."""

import csv
import io
import itertools
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from regents_cosim.checks.bounded import open_bounded
from regents_cosim.checks.xml_input import unpacked_limit
from regents_cosim.errors import InputError, LogError
from regents_cosim.scenario.scenario import Kind
from regents_cosim.sources.logs.files.text import encoding_of
from regents_cosim.sources.logs.kinds import kind_named

_ROWS = 50_000  # read at a time
_LONGEST_HEADER = 1 << 16  # characters
_GROUPED = re.compile(r"[-+]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?")  # digits grouped in thousands
_HEADING = re.compile(r"yaw|psi|orient|heading|theta|azimuth|course|bearing|(^|_)(angle|rotation)", re.IGNORECASE)
_CHANGE = re.compile(r"rate|dot|vel|speed|acc|change|source|type", re.IGNORECASE)
_POINT = re.compile(r"cent(er|re)|corner|front|rear|bumper|offset", re.IGNORECASE)


class Columns(NamedTuple):
    """Numeric columns by name, and text columns as codes into the list of distinct texts."""

    numbers: dict[str, Float[np.ndarray, " row"]]
    codes: dict[str, Int[np.ndarray, " row"]]
    texts: dict[str, list[str]]
    header: tuple[str, ...] = ()  # all columns of the file
    dates: frozenset[str] = frozenset()  # numeric columns that were dates or durations; they count seconds

    def __len__(self) -> int:
        return len(next(iter(self.numbers.values())))

    def kinds(self, name: str, kind_of: Callable[[str], Kind] = kind_named) -> np.ndarray:
        """The kind of road user in each row, given that of each word of a text column."""
        return np.array([kind_of(word) for word in self.texts[name]], object)[self.codes[name]]


def header_of(head: bytes) -> list[str]:
    """The column names in the first line of a file in UTF-8."""
    return _fields(head.split(b"\n", 1)[0].decode("utf-8-sig", "replace"))


def _fields(line: str) -> list[str]:
    return [name.strip().strip('"') for name in line.rstrip("\r\n").split(_separator(line))]


def read_columns(
    path: Path,
    numbers: Sequence[str],
    texts: Sequence[str] = (),
    optional: Sequence[str] = (),
    header: Sequence[str] = (),
) -> Columns:
    """Columns of a file by name; a column in `optional` may be missing, and is then missing in the result.

    `header` has the names of a file whose first line has none. Fields are separated by commas, semicolons or tabs, else
    by white space. Commas within numbers are decimal where fields are separated by semicolons or tabs, else they
    separate thousands; an empty field is NaN. Raises LogError for a missing column, a row that is too short, or a field
    that is not a number.
    """
    with _opened(path) as file:
        line = file.readline(_LONGEST_HEADER)
        names = list(header) or _fields(line)
        missing = [name for name in (*numbers, *texts) if name not in names and name not in optional]
        if missing:
            raise LogError(f"{path}: no column {', '.join(missing)}; the header has {', '.join(names)[:200]}")
        known: dict[str, list[np.ndarray]] = {name: [] for name in numbers if name in names}
        coded: dict[str, list[np.ndarray]] = {name: [] for name in texts if name in names}
        codes: dict[str, dict[str, int]] = {name: {} for name in coded}
        separator = _separator(line)
        lines = itertools.chain([line], file) if header else file
        rows = map(str.split, lines) if separator is None else csv.reader(lines, delimiter=separator)
        for piece in _pieces(rows):
            if longer := next((row for row in piece if any(row[len(names) :])), None):
                raise LogError(
                    f"{path}: a row of {len(longer)} fields ({','.join(longer)[:60]!r}), but {len(names)} columns "
                    "(are its commas decimal, or does a row hold several samples? write one sample in each row)"
                )
            for name, parts in known.items():
                parts.append(_numbers(_column(piece, names.index(name), path), separator, name, path))
            for name, parts in coded.items():
                code, words = codes[name], _column(piece, names.index(name), path)
                parts.append(np.array([code.setdefault(word.strip(), len(code)) for word in words], int))
    if not all(known.values()):
        raise LogError(f"{path}: no rows")
    return Columns(
        {name: np.concatenate(parts) for name, parts in known.items()},
        {name: np.concatenate(parts) for name, parts in coded.items()},
        {name: list(code) for name, code in codes.items()},
        tuple(names),
    )


def heading_like(names: Iterable[str]) -> list[str]:
    """The columns whose names suggest a heading."""
    return [name for name in names if _HEADING.search(name) and not _CHANGE.search(name)]


def refuse_other_poses(path: Path, table: Columns, known: Collection[str], what: str) -> None:
    """Raise LogError where a file has columns of poses that the format does not have: then it is of another format."""
    unknown = [name for name in table.header if name not in known]
    others = [*heading_like(unknown), *(name for name in unknown if _POINT.search(name))]
    if others:
        raise LogError(
            f"{path}: {', '.join(dict.fromkeys(others))[:100]} is no {what} column, so places and headings may mean "
            "something else (describe the file with a mapping, and name that file by `columns`, with `format` table)"
        )


def _column(piece: list[list[str]], place: int, path: Path) -> list[str]:
    shortest = min(piece, key=len)
    if len(shortest) > place:
        return [row[place] for row in piece]
    raise LogError(f"{path}: truncated or damaged CSV, a row of {len(shortest)} fields ({','.join(shortest)[:60]!r})")


def _pieces(rows: Iterator[list[str]]) -> Iterator[list[list[str]]]:
    while piece := list(itertools.islice(rows, _ROWS)):
        if filled := [row for row in piece if row]:
            yield filled


def _numbers(values: list[str], separator: str | None, name: str, path: Path) -> Float[np.ndarray, " row"]:
    try:
        return np.array(values, float)
    except ValueError:
        pass
    try:
        return np.array([_number(value.strip(), separator) for value in values])
    except ValueError as error:
        raise LogError(f"{path}: column {name}: {str(error)[:200]}") from error


def _number(text: str, separator: str | None) -> float:
    """Parse a number that may contain commas. Raises ValueError where their meaning is ambiguous."""
    if "," not in text:
        return float(text) if text else np.nan
    is_grouped = _GROUPED.fullmatch(text) is not None
    if separator == "," and is_grouped:
        return float(text.replace(",", ""))
    is_decimal = text.count(",") == 1 and "." not in text
    if is_decimal and (separator == ";" or (separator == "\t" and not is_grouped)):
        return float(text.replace(",", "."))
    raise ValueError(
        f"{text[:40]!r}: what its commas mean is not certain (write decimals with a point and thousands without a mark)"
    )


def _separator(line: str) -> str | None:
    """The separator of fields; None for white space of any length."""
    likely = max(",;\t", key=line.count)
    return likely if likely in line else None


@contextmanager
def _opened(path: Path) -> Iterator[io.TextIOWrapper]:
    try:
        with open_bounded(path, unpacked_limit(path)) as file:
            yield io.TextIOWrapper(file, encoding_of(file.peek(2)), newline="")
    except InputError as error:
        raise LogError(f"{error}; expected a table") from error
    except (csv.Error, UnicodeError) as error:
        raise LogError(f"{path}: truncated or damaged CSV ({error})") from error
