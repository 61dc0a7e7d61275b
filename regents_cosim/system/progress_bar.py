"""A bar for a long run, with a row above it for each finished item: on a terminal's stderr, or in a notebook."""

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
_BAR_WIDTH = 16  # with texts of 30 characters everything fits into 80 columns
_REFRESHED_S = 0.5  # update interval in a notebook
_NOTEBOOK_WIDTH = 100

_one = threading.Lock()  # held by the bar that is shown: a run within a run has none


@dataclass(frozen=True)
class Bar:
    """Shows bars, or nothing if `hidden`."""

    hidden: bool = False

    def say(self, text: str) -> None:
        """Show one line."""
        if not self.hidden:
            Console(file=sys.stderr).print(Text(printable(text)), soft_wrap=True)

    @contextmanager
    def waiting(self, what: str) -> Iterator[None]:
        """Show a bar without an end while the block runs."""
        with self._opened(what, None):
            yield

    def each(
        self, items: Iterable[_Item], what: str, total: int | None, row: Callable[[_Item], str] | None = None
    ) -> Iterator[_Item]:
        """Pass `items` on while a bar counts them; `row` describes each finished item in a line."""
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
    def __init__(self, what: str, total: int | None, console: Console, **how: Any) -> None:
        columns = (_What(), BarColumn(_BAR_WIDTH), TextColumn("{task.fields[count]}"), TimeElapsedColumn(), _Left())
        self._rich = Progress(*columns, console=console, **how)
        self._task: TaskID = self._rich.add_task(
            printable(what, _LABEL_LIMIT), total=total, count=_count(0, total), pace=_Pace()
        )

    def advance(self) -> None:
        """Count one more item."""
        task = self._rich.tasks[0]
        task.fields["pace"].note()
        count = _count(int(task.completed) + 1, task.total)
        self._rich.update(self._task, advance=1, count=count)

    def print(self, line: str) -> None:
        """Print a row above the bar."""
        raise NotImplementedError


class _OnTerminal(_Open):
    def __init__(self, what: str, total: int | None) -> None:
        # Other output stays on stdout if that is not a terminal, since another program reads it.
        super().__init__(what, total, Console(file=sys.stderr), transient=True, redirect_stdout=sys.stdout.isatty())

    def __enter__(self) -> "_OnTerminal":
        self._rich.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._rich.stop()

    def print(self, line: str) -> None:
        console = self._rich.console
        console.print(Text(wrapped(printable(line, None), console.width)), soft_wrap=True)


class _InNotebook(_Open):
    """A bar as text in a notebook, in an output of the cell that is updated; needs no widgets."""

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
            with suppress(Exception):  # the kernel may be shutting down
                self._output.update({"text/plain": self._text()}, raw=True)

    def _text(self) -> str:
        page = Console(file=io.StringIO(), width=_NOTEBOOK_WIDTH)
        page.print(self._rich.get_renderable())
        assert isinstance(page.file, io.StringIO)
        return "\n".join([*self._rows, page.file.getvalue().rstrip()])


@dataclass
class _Pace:
    """The times of the first and the last item: what precedes the first, such as compilation, happens only once."""

    done: int = 0
    first: float = field(default=0.0)
    last: float = field(default=0.0)

    def note(self) -> None:
        """Count one more item now."""
        self.done += 1
        self.last = monotonic()
        self.first = self.first if self.done > 1 else self.last

    def left_s(self, total: float | None) -> float | None:
        """The time for the remaining items [s]; None where it is unknown."""
        if total is None or self.done < 2:
            return None
        each = (self.last - self.first) / (self.done - 1)
        left_s = each * (total - self.done) - (monotonic() - self.last)
        return left_s if left_s > 0.0 else None


class _What(ProgressColumn):
    """A column that shows what is done, or what it currently waits for, such as the compiler."""

    def render(self, task: Task) -> RenderableType:
        return Text(DOING.now() or task.description)


class _Left(ProgressColumn):
    def render(self, task: Task) -> RenderableType:
        left_s = task.fields["pace"].left_s(task.total)
        if left_s is None or task.finished:
            return Text("")
        minutes, seconds = divmod(round(left_s), 60)
        return Text(f"{minutes}:{seconds:02d} left")


def _count(done: int, total: float | None) -> str:
    return f"{done}/{int(total)}" if total else str(done) if done else ""
