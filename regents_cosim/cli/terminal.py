"""Output of commands: progress on stderr; tables on stdout, or the same rows as JSON."""

import json
import logging
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from time import perf_counter
from typing import Any, TypeVar

from rich.cells import cell_len
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from regents_cosim.plain_text import one_line, printable, wrapped
from regents_cosim.system.progress_bar import Bar
from regents_cosim.system.standard_streams import results

GAP = 2  # blanks between two columns
_NARROWEST = 16  # shorter words are always whole
_WIDEST = 40  # most width given to words to keep them distinguishable
_LEFT_OUT = "…"
_MOST_LINES = 8  # most lines of a cell


@dataclass(frozen=True)
class Column:
    """A heading, and the cells under it."""

    heading: str
    cells: Sequence[str]

    def width(self, lines: int) -> int:
        """The width at which cells, broken between words, take at most `lines` lines, or a few more."""
        heading = max(map(cell_len, self.heading.split()), default=0)
        whole = max(map(cell_len, self.cells), default=0)
        word = max((cell_len(word) for cell in self.cells for word in cell.split()), default=0)
        broken = max(min(word, max(_NARROWEST, -(-whole // lines))), -(-whole // lines), _NARROWEST)
        return max(heading, min(whole, max(broken, self._apart)), 1)

    @cached_property
    def _apart(self) -> int:
        """The least width at which shortened words remain distinguishable."""
        words = {word for cell in self.cells for word in cell.split() if cell_len(word) > _NARROWEST}
        longest = max(map(cell_len, words), default=0)
        widths = range(_NARROWEST, min(longest, _WIDEST) + 1)
        return next((width for width in widths if len({ends(one, width) for one in words}) == len(words)), _NARROWEST)

    def within(self, width: int | None) -> "Column":
        """The column broken into lines of at most `width`; None: a single line."""
        if width is None:
            return self
        return Column(laid_out(self.heading, width), [laid_out(cell, width) for cell in self.cells])

    def is_shortened(self, width: int | None) -> bool:
        """Whether a word is shortened to its two ends."""
        return width is not None and any(cell_len(word) > width for cell in self.cells for word in cell.split())


def laid_out(cell: str, width: int) -> str:
    """A cell in lines of at most `width`, broken between words; a longer word is shown by its two ends."""
    return wrapped(" ".join(ends(word, width) for word in cell.split(" ")), width)


def ends(word: str, width: int) -> str:
    """A word, shortened to its begin and its end if it is too long."""
    if cell_len(word) <= width:
        return word
    kept = max(width - cell_len(_LEFT_OUT), 0)
    while True:
        shown = f"{word[: kept - kept // 2]}{_LEFT_OUT}{word[len(word) - kept // 2 :]}"
        if cell_len(shown) <= width or not kept:  # some characters are two columns wide
            return shown
        kept -= 1


def fit(columns: Mapping[str, Column], essential: Sequence[str], room: int) -> dict[str, int]:
    """The columns that fit into `room`, by key in their order, with their widths.

    Essential columns are added first, in the given order, then others that fit without more lines. Cells take as few
    lines as the essential columns need (the first column if there are none).
    """
    first = [key for key in essential if key in columns] or list(columns)[:1]
    widths = [{key: column.width(lines) for key, column in columns.items()} for lines in range(1, _MOST_LINES + 1)]
    within = next((some for some in widths if _sum(some[key] for key in first) <= room), widths[-1])
    chosen: list[str] = []
    for key in (*first, *(key for key in columns if key not in first)):
        if not chosen or _sum(within[one] for one in (*chosen, key)) <= room:
            chosen.append(key)
    return _filled({key: within[key] for key in columns if key in chosen}, widths[0], room)


def _filled(widths: dict[str, int], whole: Mapping[str, int], room: int) -> dict[str, int]:
    """Give the remaining room to the columns that are broken into lines."""
    for key in widths:
        widths[key] += max(0, min(whole[key] - widths[key], room - _sum(widths.values())))
    return widths


def _sum(widths: Iterable[int]) -> int:
    each = list(widths)
    return sum(each) + GAP * (len(each) - 1)


_Item = TypeVar("_Item")
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Terminal:
    """The output channels of a command: `quiet` shows only the result, `json` prints it as JSON.

    `wide` prints every column of a table, even where the terminal is too narrow. With `verbose` loggers report progress
    on stderr, so no bars are shown.
    """

    quiet: bool = False
    json: bool = False
    wide: bool = False
    verbose: bool = False

    def say(self, text: str) -> None:
        """Show one line on stderr."""
        _note(text)
        if not (self.quiet or self.verbose):
            _print_lines(_stderr(), text)

    @contextmanager
    def waiting(self, what: str) -> Iterator[None]:
        """Show a bar without an end while the block runs."""
        with self._bar.waiting(what), _timed(what):
            yield

    def each(
        self, items: Iterable[_Item], what: str, total: int | None, row: Callable[[_Item], str] | None = None
    ) -> Iterator[_Item]:
        """Pass `items` on while a bar counts them; `row` describes each finished item in a line."""
        with _timed(f"{what} ({total})"):
            yield from self._bar.each(items, what, total, row)

    def publish(self, text: str, value: object, grids: Sequence[tuple[str, Sequence[dict[str, Any]]]] = ()) -> None:
        """Print a result as text, or with --json its `value`; a terminal gets the tables `grids` instead."""
        if self.json:
            json.dump(value, results(), indent=1)
            results().write("\n")
        elif self._fits(grids):
            for title, rows in grids:
                self._print(title, rows, tuple(rows[0]) if rows else ())
        else:
            self.write(text)

    def write(self, text: str) -> None:
        """Print text on stdout, line by line as it is."""
        results().writelines(f"{printable(line, limit=None)}\n" for line in text.rstrip("\n").split("\n"))

    def suggest(self, command: Sequence[object]) -> None:
        """Show the command for the next step under the table; programs do not get it."""
        if results().isatty() and not (self.quiet or self.json):
            _stderr().print(Text(printable(f"next: {shlex.join(map(str, command))}")), soft_wrap=True)

    def show(self, title: str, rows: Sequence[dict[str, Any]], note: str = "", essential: Sequence[str] = ()) -> None:
        """Print a table of `rows`, whose keys are the headings, with a `note` below.

        On a terminal the `essential` columns come first, the others if there is room; elsewhere all are printed.
        """
        if self.json:
            self.publish("", rows)
            return
        self._print(title, rows, essential)
        if note:
            _note(note)
            _print_lines(_stdout(), *note.split("\n"))

    def _fits(self, grids: Sequence[object]) -> bool:
        """Whether to fit tables to a terminal; files and pipes have no width."""
        return bool(grids) and not self.wide and results().isatty()

    def _print(self, title: str, rows: Sequence[dict[str, Any]], essential: Sequence[str]) -> None:
        _note(title)
        console = _stdout()
        fitted = self._fits(rows)
        if title:
            _print_lines(console, title, style="italic")
        keys = rows[0] if rows else ()
        columns = {key: Column(printable(key.replace("_", " ")), [_cell(row.get(key)) for row in rows]) for key in keys}
        widths = fit(columns, essential, console.width) if fitted else dict.fromkeys(columns)
        table = _table([columns[key].within(width) for key, width in widths.items()])
        if not fitted:
            console.width = Measurement.get(console, console.options.update(max_width=10_000), table).maximum
        console.print(table)
        left_out = [column.heading for key, column in columns.items() if key not in widths]
        shortened = [columns[key].heading for key, width in widths.items() if columns[key].is_shortened(width)]
        self._say_left_out(left_out, shortened)

    def _say_left_out(self, left_out: Sequence[str], shortened: Sequence[str]) -> None:
        said = [f"no room for: {', '.join(left_out)}"] if left_out else []
        said += [f"shortened: {', '.join(shortened)}"] if shortened else []
        if said and not self.quiet:
            _print_lines(_stderr(), f"{'; '.join(said)} (--wide shows them)", style="dim")

    @property
    def _bar(self) -> Bar:
        return Bar(hidden=self.quiet or self.verbose or not _stderr().is_terminal)


@contextmanager
def _timed(stage: str) -> Iterator[None]:
    _note(f"{stage}: begins")
    begin = perf_counter()
    try:
        yield
    finally:
        _note(f"{stage}: {'stopped' if sys.exc_info()[0] else 'done'} after {perf_counter() - begin:.2f} s")


def _note(text: str) -> None:
    """Log a message, in characters that every handler of the user can write."""
    _log.info("%s", printable(text, None))


def complain(message: str) -> None:
    """Show an error or a note of a command on stderr, as a single line where there is no terminal."""
    _print_lines(_stderr(), one_line(f"regents: {message}"))


def _stderr() -> Console:
    return Console(file=sys.stderr)


def _print_lines(console: Console, *lines: str, style: str = "") -> None:
    """Print lines of text; on a terminal broken between words, but not within a path or another long word."""
    width = console.width if console.file.isatty() else None
    shown = [text if width is None else wrapped(text, width) for text in map(printable, lines)]
    console.print(Text("\n".join(shown)), style=style, soft_wrap=True)


def _stdout() -> Console:
    return Console(file=results(), highlight=False)


def _table(columns: Sequence[Column]) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, GAP, 0, 0), header_style="bold")
    for column in columns:
        table.add_column(Text(column.heading), no_wrap=True)
    for cells in zip(*(column.cells for column in columns), strict=True):
        table.add_row(*map(Text, cells))
    return table


def _cell(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_cell, value))
    return f"{value:.3g}" if isinstance(value, float) else printable(str(value))
