"""Reads Parquet and Feather with polars, which the extra `logs` installs (pyarrow clashes with libsumo).

polars parses in Rust: a damaged file may make it allocate any amount of memory, crash or hang. So a separate process
reads the file, within `_MEMORY` bytes above what it starts with and within a time limit, and returns plain arrays.
"""

import importlib.util
import io
import os
import resource
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from regents_cosim.checks.work import Work
from regents_cosim.errors import InputError, LogError, MissingDependencyError, RegentsError, install_hint
from regents_cosim.sources.logs.files.csv_columns import Columns
from regents_cosim.sources.logs.formats import unpacked
from regents_cosim.system.workers import run_isolated

if TYPE_CHECKING:
    import polars as pl

_MEMORY = 4 << 30
_SECONDS, _BYTES_PER_S = 30, 5_000_000  # 30 s, plus one second per 5 MB


def read_polars(path: Path, numbers: Sequence[str], texts: Sequence[str] = (), optional: Sequence[str] = ()) -> Columns:
    """Columns of a Parquet or Feather file, in the form that `csv_columns.read_columns` returns.

    Raises MissingDependencyError where polars is not installed, LogError where the file is damaged.
    """
    if importlib.util.find_spec("polars") is None:
        raise MissingDependencyError(
            f"{path.name}: Parquet and Feather files need polars; install it with the extra `logs` "
            f"({install_hint('logs')})"
        )
    try:
        return run_isolated(_read, path, tuple(numbers), tuple(texts), tuple(optional))
    except (LogError, InputError):
        raise
    except RegentsError as error:
        raise LogError(f"{path}: damaged Parquet or Feather file (polars died over it)") from error


def _read(path: Path, numbers: tuple[str, ...], texts: tuple[str, ...], optional: tuple[str, ...]) -> Columns:
    """Read the columns. Runs in a worker process."""
    import polars as pl

    content = unpacked(path)
    _limit(len(content))
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # its threads print when they panic, which the error tells in a line
    try:
        whole = (pl.scan_parquet if content[:4] == b"PAR1" else pl.scan_ipc)(io.BytesIO(content))
        columns = whole.collect_schema().names()
        missing = [name for name in (*numbers, *texts) if name not in columns and name not in optional]
        if missing:
            raise LogError(f"{path}: no column {', '.join(missing)}; there are {', '.join(columns)[:200]}")
        wanted = list(dict.fromkeys(name for name in (*numbers, *texts) if name in columns))
        rows = whole.select(pl.len()).collect().item()
        if rows == 0:
            raise LogError(f"{path}: no rows")
        Work.of(path).spend("rows x columns", rows, len(wanted))
        frame = whole.select(wanted).collect()
        dates = frozenset(name for name in numbers if name in wanted and frame[name].dtype.is_temporal())
        found = {name: _numbers(frame, name, name in dates) for name in numbers if name in wanted}
        coded = {name: _texts(frame, name) for name in texts if name in wanted}
    except (LogError, InputError):
        raise
    except BaseException as error:  # polars panics with exceptions that do not derive from Exception
        said = (str(error).splitlines() or [""])[0][:200]
        raise LogError(f"{path}: damaged Parquet or Feather file ({said})") from None
    codes, words = {k: v[0] for k, v in coded.items()}, {k: v[1] for k, v in coded.items()}
    return Columns(found, codes, words, tuple(columns), dates)


def _numbers(frame: "pl.DataFrame", name: str, is_date: bool) -> Float[np.ndarray, " row"]:
    """A numeric column; of dates the seconds since 1970, of times of day those since midnight, of durations all."""
    import polars as pl

    values = frame[name]
    if is_date:
        exact = {pl.Duration: pl.Duration("ns"), pl.Time: pl.Time}.get(values.dtype.base_type(), pl.Datetime("ns"))
        values = values.cast(exact).cast(pl.Int64)
    return values.cast(pl.Float64).to_numpy().astype(float) * (1e-9 if is_date else 1.0)


def _limit(size: int) -> None:
    """Limit the time and memory of this process; the system enforces the limits even if the process hangs."""
    seconds = _SECONDS + size // _BYTES_PER_S
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(10 * seconds)  # by the clock: the machine may be busy otherwise
    _at_most(resource.RLIMIT_CPU, seconds)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    _at_most(resource.RLIMIT_AS, used + _MEMORY)


def _at_most(what: int, value: int) -> None:
    """Set a limit of this process, at most as high as the one that it was started with."""
    hard = resource.getrlimit(what)[1]
    value = value if hard == resource.RLIM_INFINITY else min(value, hard)
    resource.setrlimit(what, (value, value))


def _texts(frame: "pl.DataFrame", name: str) -> tuple[Int[np.ndarray, " row"], list[str]]:
    import polars as pl

    values = frame[name].cast(pl.String).fill_null("")  # in a NumPy array each row would take the room of the longest
    return values.rank("dense").to_numpy().astype(int) - 1, values.unique().sort().to_list()
