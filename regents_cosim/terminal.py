"""What a person sees: progress on stderr, tables on stdout, the same rows as JSON on demand."""

import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from rich.console import Console
from rich.measure import Measurement
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from regents_cosim.plain_text import printable

_Item = TypeVar("_Item")
_LABEL_LIMIT = 120


@dataclass(frozen=True)
class Terminal:
    """How to talk: `quiet` leaves out everything but the result, `json` prints it for machines."""

    quiet: bool = False
    json: bool = False

    def say(self, text: str) -> None:
        """One line on stderr."""
        if not self.quiet:
            _stderr().print(plain(text), soft_wrap=True)

    @contextmanager
    def waiting(self, what: str) -> Iterator[None]:
        """A bar without an end while the block runs."""
        with self._progress() as bar:
            bar.add_task(printable(what, _LABEL_LIMIT), total=None)
            yield

    def each(self, items: Iterable[_Item], what: str, total: int) -> Iterator[_Item]:
        """Pass `items` on while a bar counts them."""
        with self._progress() as bar:
            task = bar.add_task(printable(what, _LABEL_LIMIT), total=total)
            for item in items:
                bar.advance(task)
                yield item

    def publish(self, text: str, value: object) -> None:
        """A result that is a text of its own, or as JSON the `value` that it tells of."""
        if self.json:
            json.dump(value, sys.stdout, indent=1)
            sys.stdout.write("\n")
        else:
            sys.stdout.writelines(f"{printable(line, limit=None)}\n" for line in text.rstrip("\n").split("\n"))

    def show(self, title: str, rows: Sequence[dict[str, Any]], note: str = "") -> None:
        """A table of `rows`, whose keys are the headings, and a `note` under it."""
        if self.json:
            self.publish("", rows)
            return
        table = Table(
            title=plain(title) if title else None, title_justify="left", box=None, pad_edge=False, header_style="bold"
        )
        for heading in rows[0] if rows else ():
            table.add_column(plain(heading.replace("_", " ")), no_wrap=True)
        for row in rows:
            table.add_row(*(plain(_cell(value)) for value in row.values()))
        console = Console(file=sys.stdout, highlight=False)
        # As wide as it needs: a terminal that is narrower breaks lines, which reads better than broken cells.
        console.width = Measurement.get(console, console.options.update(max_width=10_000), table).maximum
        console.print(table)
        if note:
            console.print(Text("\n").join(map(plain, note.split("\n"))))

    def _progress(self) -> Progress:
        columns = (
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
        )
        console = _stderr()
        return Progress(*columns, console=console, transient=True, disable=self.quiet or not console.is_terminal)


def _stderr() -> Console:
    return Console(file=sys.stderr)


def plain(text: str) -> Text:
    """Text that says what it says: no markup, no emoji codes, no control characters."""
    return Text(printable(text))


def _cell(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_cell, value))
    return f"{value:.3g}" if isinstance(value, float) else str(value)
