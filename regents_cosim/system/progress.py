"""How a long run tells where it is: on a terminal (`cli.terminal.Terminal`), or not at all."""

from collections.abc import Iterable, Iterator
from typing import Protocol, TypeVar, runtime_checkable

_Item = TypeVar("_Item")


@runtime_checkable
class Progress(Protocol):
    """What is told: one of many things done, or a line."""

    def each(self, items: Iterable[_Item], what: str, total: int) -> Iterator[_Item]:
        """Pass `items` on, and count them."""
        ...

    def say(self, text: str) -> None:
        """One line."""
        ...


class Silent:
    """Tells nothing."""

    def each(self, items: Iterable[_Item], what: str, total: int) -> Iterator[_Item]:
        """Pass `items` on."""
        yield from items

    def say(self, text: str) -> None:
        """Nothing."""


SILENT = Silent()
