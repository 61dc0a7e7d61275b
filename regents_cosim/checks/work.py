"""How much a file may ask for: products of counts grow with its size, never with what it says.

A few bytes name a light for each of many lanes, a late instant, a list that holds another one a thousand times. Whoever
makes a value for each pair of such things asks here first.
"""

import math
from dataclasses import dataclass, field
from pathlib import Path

from regents_cosim.errors import InputError

_ALWAYS = 4_000_000  # values; as numbers they take 32 MB
_PER_BYTE = 16  # of the file as it lies on disk: logs of gzip hold up to 6
STEPS = 10  # values that an array makes while Python looks at one thing
_KIB = 1024


@dataclass
class Work:
    """What one file of `size` bytes has asked for so far, in values."""

    size: int
    _spent: int = field(default=0, init=False)

    @classmethod
    def of(cls, path: Path) -> "Work":
        """For a file on disk."""
        return cls(path.stat().st_size)

    @property
    def most(self) -> int:
        """The most values that are made of it."""
        return _ALWAYS + _PER_BYTE * self.size

    def spend(self, what: str, *counts: int) -> None:
        """Ask for as many values as the product of `counts`, of which `what` says what they count.

        Raises InputError where they are more than a file of this size may ask for.
        """
        self._spent += math.prod(counts)
        if self._spent > self.most:
            product = " x ".join(f"{count:,}" for count in counts)
            raise InputError(
                f"{what}: {product}, which makes more than {self.most:,} values of a file of {_size(self.size)} "
                "(give it in parts, or look for a number that is a mistake)"
            )


def _size(size: int) -> str:
    return f"{size / _KIB:,.0f} KiB" if size >= _KIB else f"{size} bytes"
