"""Work on many items by the threads of this machine, in order, without taking all of them at once."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

_R = TypeVar("_R")
_AHEAD = 2  # items for each core that are begun before the first is handed on


def in_turn(function: Callable[..., _R], *columns: Iterable[Any]) -> Iterator[_R]:
    """As `map`, on all cores: results in order, items taken as their turn comes. Columns are equally long."""
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
            pool.shutdown(wait=False, cancel_futures=True)  # where no more is wanted
