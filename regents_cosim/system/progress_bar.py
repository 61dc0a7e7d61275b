"""A bar for a long run, and above it a row for each thing that is done: on a terminal's stderr, or in a notebook."""

import io
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from time import monotonic
from typing import Any, TypeVar

from rich.console import Console, RenderableType
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskID, TextColumn, TimeElapsedColumn
from rich.text import Text

from regents_cosim.plain_text import printable, wrapped
from regents_cosim.system.progress import DOING, in_notebook

_Item = TypeVar("_Item")
_LABEL_LIMIT = 120
_BAR_WIDTH = 16  # with words of 30 characters all fits 80 columns
_REFRESHED_S = 0.5  # of a notebook's cell
_NOTEBOOK_WIDTH = 100

_one = threading.Lock()  # held by the bar that is shown: what runs within a run has none of its own


@dataclass(frozen=True)
class Bar:
    """Shows bars, or nothing where it is `hidden`."""

    hidden: bool = False

    def say(self, text: str) -> None:
        """One line."""
        if not self.hidden:
            _stderr().print(Text(printable(text)), soft_wrap=True)

    @contextmanager
    def waiting(self, what: str) -> Iterator[None]:
        """A bar without an end while the block runs."""
        with self._opened(what, None):
            yield

    def each(
        self, items: Iterable[_Item], what: str, total: int | None, row: Callable[[_Item], str] | None = None
    ) -> Iterator[_Item]:
        """Pass `items` on while a bar counts them; `row` says in a line what came of each."""
        with self._opened(what, total) as bar:
            for number, item in enumerate(items, 1):
                if row is not None and bar is not None:
                    bar.print(f"{number}{f'/{total}' if total else ''} {row(item)}")
                if bar is not None:
                    bar.advance()
                yield item

    @contextmanager
    def _opened(self, what: str, total: int | None) -> "Iterator[_Open | None]":
        if self.hidden or not _one.acquire(blocking=False):
            yield None
            return
        try:
            with (_InNotebook if in_notebook() else _OnTerminal)(what, total) as bar:
                yield bar
        finally:
            _one.release()


class _Open:
    """A bar that is shown."""

    def __init__(self, what: str, total: int | None, console: Console, **how: Any) -> None:
        columns = (_What(), BarColumn(_BAR_WIDTH), TextColumn("{task.fields[count]}"), TimeElapsedColumn(), _Left())
        self._rich = Progress(*columns, console=console, **how)
        self._task: TaskID = self._rich.add_task(
            printable(what, _LABEL_LIMIT), total=total, count=_count(0, total), pace=_Pace()
        )

    def advance(self) -> None:
        """One more is done."""
        task = self._rich.tasks[0]
        task.fields["pace"].note()
        count = _count(int(task.completed) + 1, task.total)
        self._rich.update(self._task, advance=1, count=count)

    def print(self, line: str) -> None:
        """A row above the bar."""
        raise NotImplementedError


class _OnTerminal(_Open):
    def __init__(self, what: str, total: int | None) -> None:
        # What a program prints meanwhile stays on stdout where that is read by another.
        super().__init__(what, total, _stderr(), transient=True, redirect_stdout=sys.stdout.isatty())

    def __enter__(self) -> "_OnTerminal":
        self._rich.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._rich.stop()

    def print(self, line: str) -> None:
        console = self._rich.console
        console.print(Text(wrapped(printable(line, None), console.width)), soft_wrap=True)


class _InNotebook(_Open):
    """The same as text, in an output of the cell that is written again and again: widgets are not asked for."""

    def __init__(self, what: str, total: int | None) -> None:
        super().__init__(what, total, Console(file=io.StringIO(), width=_NOTEBOOK_WIDTH), auto_refresh=False)
        self._rows: list[str] = []
        self._over = threading.Event()
        self._output: Any = None

    def __enter__(self) -> "_InNotebook":
        from IPython.display import display  # pyright: ignore[reportMissingImports]  (a notebook has it)

        self._output = display({"text/plain": self._text()}, raw=True, display_id=True)
        threading.Thread(target=self._refresh, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._output.update({"text/plain": "\n".join(self._rows)}, raw=True)

    def print(self, line: str) -> None:
        self._rows.append(printable(line, None))

    def _refresh(self) -> None:
        while not self._over.wait(_REFRESHED_S):
            with suppress(Exception):  # of a kernel that ends
                self._output.update({"text/plain": self._text()}, raw=True)

    def _text(self) -> str:
        page = Console(file=io.StringIO(), width=_NOTEBOOK_WIDTH)
        page.print(self._rich.get_renderable())
        assert isinstance(page.file, io.StringIO)
        return "\n".join([*self._rows, page.file.getvalue().rstrip()])


@dataclass
class _Pace:
    """When the first and the last were done: what comes before the first (programs are compiled) takes place once."""

    done: int = 0
    first: float = field(default=0.0)
    last: float = field(default=0.0)

    def note(self) -> None:
        """One more is done now."""
        self.done += 1
        self.last = monotonic()
        self.first = self.first if self.done > 1 else self.last

    def left_s(self, total: float | None) -> float | None:
        """How long the others take; None where that is not known."""
        if total is None or self.done < 2:
            return None
        each = (self.last - self.first) / (self.done - 1)
        left_s = each * (total - self.done) - (monotonic() - self.last)
        return left_s if left_s > 0.0 else None


class _What(ProgressColumn):
    """What is done; in its place what is waited for meanwhile, such as a compiler."""

    def render(self, task: Task) -> RenderableType:
        return Text(DOING.now() or task.description)


class _Left(ProgressColumn):
    """How long it still takes."""

    def render(self, task: Task) -> RenderableType:
        left_s = task.fields["pace"].left_s(task.total)
        if left_s is None or task.finished:
            return Text("")
        minutes, seconds = divmod(round(left_s), 60)
        return Text(f"{minutes}:{seconds:02d} left")


def _count(done: int, total: float | None) -> str:
    return f"{done}/{int(total)}" if total else str(done) if done else ""


def _stderr() -> Console:
    return Console(file=sys.stderr)
