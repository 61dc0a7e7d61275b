"""Keeps the process of a command as it is while a user's module is imported in it.

What a module sets for its whole process, it sets again in the process of its planner, where it stays.
"""

import faulthandler
import gc
import locale
import logging
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from functools import partial
from importlib.machinery import PathFinder
from types import ModuleType
from typing import Any

from regents_cosim.system.user_code import home_of

_TIMER = signal.ITIMER_REAL
_SETTINGS: tuple[tuple[Callable[[], Any], Callable[[Any], object]], ...] = (  # each with what sets it
    (sys.getrecursionlimit, sys.setrecursionlimit),
    (threading.gettrace, threading.settrace),
    (threading.getprofile, threading.setprofile),
    (gc.isenabled, lambda on: gc.enable() if on else gc.disable()),
    (partial(signal.getitimer, _TIMER), lambda times: signal.setitimer(_TIMER, *times)),
    (partial(locale.setlocale, locale.LC_ALL), partial(locale.setlocale, locale.LC_ALL)),
    (lambda: logging.root.manager.disable, logging.disable),
)
_ENDING = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def process_kept() -> Iterator[None]:
    """A block after which the process is what it was before.

    That is: its working directory, standard streams, handlers of Ctrl-C and SIGTERM, timer, limits and other settings
    of Python and NumPy. What modules are searched in stays behind what was searched before, and a module that hides one
    from there is forgotten.
    """
    import numpy as np  # which `--help` does not need

    here = os.open(".", os.O_PATH)
    numbers = _ENDING if threading.current_thread() is threading.main_thread() else ()
    handlers = {number: handler for number in numbers if (handler := signal.getsignal(number)) is not None}
    before = [(write, read()) for read, write in _SETTINGS]
    places, known = list(sys.path), set(sys.modules)
    try:
        with redirect_stdout(sys.stdout), redirect_stderr(sys.stderr), warnings.catch_warnings(), np.errstate():
            yield
    finally:
        for write, value in before:
            write(value)
        faulthandler.cancel_dump_traceback_later()
        os.fchdir(here)
        os.close(here)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        sys.path[:] = [*places, *(place for place in sys.path if place not in places)]
        _forget_hiding(known, places)


def _forget_hiding(known: set[str], places: list[str]) -> None:
    """Forget modules that are not `known`, lie elsewhere than in `places`, and hide others of their names there."""
    new = [name for name in sys.modules if name not in known]
    hiding = {name for name in new if "." not in name and _hides(sys.modules[name], places)}
    for name in [name for name in new if name.partition(".")[0] in hiding]:
        del sys.modules[name]


def _hides(module: ModuleType, places: list[str]) -> bool:
    home, spec = home_of(module), module.__spec__
    if spec is None or home is None or str(home) in places:
        return False
    hidden = PathFinder.find_spec(spec.name, places)
    return hidden is not None and hidden.origin not in (None, spec.origin)
