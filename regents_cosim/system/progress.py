"""How a long run tells where it is: by a bar (`system.progress_bar`), as a command line is asked, or not at all."""

import math
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from time import monotonic
from typing import Protocol, TypeVar, runtime_checkable

_Item = TypeVar("_Item")
_SHOWN_AFTER_S = 2.0  # what is over sooner need not be told: a kept program is loaded in a fraction of that


@runtime_checkable
class Progress(Protocol):
    """What is told: one of many things done, or a line."""

    def each(
        self, items: Iterable[_Item], what: str, total: int | None, row: Callable[[_Item], str] | None = None
    ) -> Iterator[_Item]:
        """Pass `items` on, and count them; `row` says in a line of its own what came of each."""
        ...

    def waiting(self, what: str) -> AbstractContextManager[None]:
        """Tell what is done while the block runs."""
        ...

    def say(self, text: str) -> None:
        """One line."""
        ...


class Silent:
    """Tells nothing."""

    def each(
        self, items: Iterable[_Item], what: str, total: int | None, row: Callable[[_Item], str] | None = None
    ) -> Iterator[_Item]:
        """Pass `items` on."""
        yield from items

    def waiting(self, what: str) -> AbstractContextManager[None]:
        """Nothing."""
        return nullcontext()

    def say(self, text: str) -> None:
        """Nothing."""


SILENT = Silent()

ShowProgress = bool | Progress  # what functions take: on a terminal and in notebooks, nowhere, or as one's own tells it


def shown(progress: ShowProgress) -> Progress:
    """Who tells: a bar on a terminal or in a notebook, nobody elsewhere or where it is turned off, or `progress`."""
    if not isinstance(progress, bool):
        return progress
    if not progress or not (in_notebook() or (sys.stderr is not None and sys.stderr.isatty())):
        return SILENT
    from regents_cosim.system.progress_bar import Bar

    return Bar()


def in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    ipython = sys.modules.get("IPython")
    shell = ipython and ipython.get_ipython()
    return type(shell).__name__ == "ZMQInteractiveShell"


class Doing:
    """What threads are at that takes long, and no bar counts."""

    def __init__(self) -> None:
        self._by_thread: dict[int, list[tuple[float, str]]] = {}
        self._tell: Callable[[str], None] | None = None
        self._told = False
        self._timer: threading.Timer | None = None

    def tell_once(self, tell: Callable[[str], None]) -> None:
        """Have `tell` told of what first lasts long, once in a process: for work that no bar is shown of."""
        if not self._told:
            self._tell = tell

    def begin(self, what: str) -> None:
        """The thread that calls is at something, until the `end` that belongs to it."""
        self._by_thread.setdefault(threading.get_ident(), []).append((monotonic(), what))
        if self._tell is not None and (self._timer is None or not self._timer.is_alive()):
            self._timer = threading.Timer(_SHOWN_AFTER_S + 0.1, self._tell_what_lasts)
            self._timer.daemon = True
            self._timer.start()

    def end(self) -> None:
        """It is not any more."""
        mine = self._by_thread.get(threading.get_ident(), [])
        if mine:
            mine.pop()
        if not mine:
            self._by_thread.pop(threading.get_ident(), None)

    def _tell_what_lasts(self) -> None:
        tell, what = self._tell, self.now(_SHOWN_AFTER_S)
        if what and tell is not None:
            self._tell, self._told = None, True
            tell(what)

    @contextmanager
    def during(self, what: str) -> Iterator[None]:
        """The thread that calls is at something while the block runs."""
        self.begin(what)
        try:
            yield
        finally:
            self.end()

    def now(self, after_s: float = _SHOWN_AFTER_S) -> str:
        """What lasts longest; empty where nothing lasts longer than `after_s`."""
        begun_s, what = min((one for some in list(self._by_thread.values()) for one in some), default=(math.inf, ""))
        return what if monotonic() - begun_s > after_s else ""


DOING = Doing()
