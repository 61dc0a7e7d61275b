"""Processes many items with the threads of this machine, in order, without reading all items at once."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

_R = TypeVar("_R")
_AHEAD = 2  # items per core that are begun ahead of the result that is due


def in_turn(function: Callable[..., _R], *columns: Iterable[Any]) -> Iterator[_R]:
    """Like `map`, but on all cores: results in order, items read when their turn comes. Columns are equally long."""
    cores = os.cpu_count() or 1
    with ThreadPoolExecutor(cores) as pool:
        begun: deque[Future[_R]] = deque()
        try:
            for items in zip(*columns, strict=True):
                begun.append(pool.submit(function, *items))
                if len(begun) >= _AHEAD * cores:
                    yield begun.popleft().result()
            while begun:
                yield begun.popleft().result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)  # when the caller stops early
