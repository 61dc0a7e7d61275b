"""Logs the items that generators of results yield, so that users can follow a long run."""

import functools
import logging
from collections.abc import Callable, Iterator
from typing import ParamSpec, TypeVar

_Given = ParamSpec("_Given")
_Item = TypeVar("_Item")


def logs_items(
    describe: Callable[[_Item], str],
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
