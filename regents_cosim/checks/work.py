"""Limit the work that one file can cause to a multiple of the file's size.

A few bytes can name a light for each of many lanes, a late instant, or a list that repeats another list a thousand
times. Code that makes one value for each pair of such things asks `Work` first.
"""

import math
from dataclasses import dataclass, field
from pathlib import Path

from regents_cosim.errors import InputError

_ALWAYS = 4_000_000  # values allowed for any file; as numbers they take 32 MB
_PER_BYTE = 16  # further values per byte on disk: gzip logs hold up to 6
STEPS = 10  # values of a NumPy array that take as long as one step of Python code
_KIB = 1024


@dataclass
class Work:
    """Count the values that one file of `size` bytes has asked for."""

    size: int
    _spent: int = field(default=0, init=False)

    @classmethod
    def of(cls, path: Path) -> "Work":
        """The account of a file on disk."""
        return cls(path.stat().st_size)

    @property
    def most(self) -> int:
        """The most values that this file may ask for."""
        return _ALWAYS + _PER_BYTE * self.size

    def spend(self, what: str, *counts: int) -> None:
        """Account for as many values as the product of `counts`; `what` names what they count.

        Raises InputError where the file asks for more than its size allows.
        """
        self._spent += math.prod(counts)
        if self._spent > self.most:
            product = " x ".join(f"{count:,}" for count in counts)
            size = f"{self.size / _KIB:,.0f} KiB" if self.size >= _KIB else f"{self.size} bytes"
            raise InputError(
                f"{what}: {product}, which makes more than {self.most:,} values of a file of {size} "
                "(give it in parts, or look for a number that is a mistake)"
            )
