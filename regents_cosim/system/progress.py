"""Progress reports of long runs: by a bar (`system.progress_bar`), by the command line, or not at all."""

import functools
import logging
import math
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from time import monotonic
from typing import Any, ParamSpec, Protocol, TypeVar, runtime_checkable

_Item = TypeVar("_Item")
_Given = ParamSpec("_Given")
_SHOWN_AFTER_S = 2.0  # shorter waits need no message, such as loading a cached program


@runtime_checkable
class Progress(Protocol):
    """Receives the progress of a run: items that are done, and messages. What a subclass leaves out shows nothing."""

    def each(
        self, items: Iterable[_Item], what: str, total: int | None, row: Callable[[_Item], str] | None = None
    ) -> Iterator[_Item]:
        """Pass `items` on, and count them; `row` describes each finished item in a line."""
        yield from items

    def waiting(self, what: str) -> AbstractContextManager[None]:
        """Show what is being done while the block runs."""
        return nullcontext()

    def say(self, text: str) -> None:
        """Show one line."""


class Silent(Progress):
    """Shows nothing."""


SILENT = Silent()

ShowProgress = bool | Progress  # True: a bar on terminals and in notebooks; False; or a Progress


def progress_for(progress: ShowProgress) -> Progress:
    """The progress to use: a bar on a terminal or in a notebook, `Silent` elsewhere, or the given one."""
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


class UncountedWork:
    """What threads are doing that takes long and is not counted by a bar."""

    def __init__(self) -> None:
        self._by_thread: dict[int, list[tuple[float, str]]] = {}
        self._tell: Callable[[str], None] | None = None
        self._told = False
        self._timer: threading.Timer | None = None

    def tell_once(self, tell: Callable[[str], None]) -> None:
        """Call `tell` once in this process, for the first such work that lasts long while no bar is shown."""
        if not self._told:
            self._tell = tell

    def begin(self, what: str) -> None:
        """Note that the calling thread begins something, until the matching `end`."""
        self._by_thread.setdefault(threading.get_ident(), []).append((monotonic(), what))
        if self._tell is not None and (self._timer is None or not self._timer.is_alive()):
            self._timer = threading.Timer(_SHOWN_AFTER_S + 0.1, self._tell_what_lasts)
            self._timer.daemon = True
            self._timer.start()

    def end(self) -> None:
        """Note that the calling thread has ended it."""
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

    def now(self, after_s: float = _SHOWN_AFTER_S) -> str:
        """What has lasted longest; empty where nothing has lasted longer than `after_s`."""
        begun_s, what = min((one for some in list(self._by_thread.values()) for one in some), default=(math.inf, ""))
        return what if monotonic() - begun_s > after_s else ""


DOING = UncountedWork()


def logs_items(
    describe: Callable[[Any], str],
) -> Callable[[Callable[_Given, Iterator[_Item]]], Callable[_Given, Iterator[_Item]]]:
    """Decorate a generator function: every item is logged at level INFO, in the words of `describe`."""

    def decorate(each: Callable[_Given, Iterator[_Item]]) -> Callable[_Given, Iterator[_Item]]:
        log = logging.getLogger(each.__module__)

        @functools.wraps(each)
        def telling(*args: _Given.args, **kwargs: _Given.kwargs) -> Iterator[_Item]:
            for item in each(*args, **kwargs):
                if log.isEnabledFor(logging.INFO):
                    log.info("%s", describe(item))
                yield item

        return telling

    return decorate
