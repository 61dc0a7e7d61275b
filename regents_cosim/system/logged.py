"""What generators of results yield, told to the logger of their module: who asks for it sees how a long run goes on."""

import functools
import logging
from collections.abc import Callable, Iterator
from typing import ParamSpec, TypeVar

_Given = ParamSpec("_Given")
_Item = TypeVar("_Item")


def logged(
    describe: Callable[[_Item], str],
) -> Callable[[Callable[_Given, Iterator[_Item]]], Callable[_Given, Iterator[_Item]]]:
    """Decorate a generator function: every item it yields is logged, as `describe` says it, at level INFO."""

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
