"""How much XML a small file may hold.

gzip packs XML a thousand to one. Real networks pack six to thirteen to one and need eight packed bytes or more for an
element; route files pack up to 33 to one and need two.
So what a file may hold grows with its size: a small one cannot fill the memory.
"""

_ALWAYS_BYTES = 16 << 20
_MOST_TIMES = 50  # what gzip makes of a file, besides
_DEEPEST = 100
_FEW_ELEMENTS = 20_000
_BYTES_PER_ELEMENT = 4  # on disk, of elements that are kept; of plain text one takes no fewer


def most_unpacked(packed_bytes: int, largest: int) -> int:
    """The most bytes that gzip data of that size may hold."""
    return min(largest, _ALWAYS_BYTES + _MOST_TIMES * packed_bytes)


class ElementCount:
    """How deep one is in a file, and how many elements it had; raises ValueError past what is sensible."""

    def __init__(self, size: int) -> None:
        self.depth = self._kept = self._all = 0
        self._most_kept, self._most = _FEW_ELEMENTS + size // _BYTES_PER_ELEMENT, _FEW_ELEMENTS + size

    def open(self) -> None:
        """An element begins."""
        self.depth += 1
        self._kept += 1
        self._all += 1
        if self.depth > _DEEPEST:
            raise ValueError(f"elements nested more than {_DEEPEST} deep")
        if self._kept > self._most_kept or self._all > self._most:
            raise ValueError(f"more than {self._all - 1} elements in so small a file (unpack it if it is your own)")

    def close(self) -> int:
        """An element ends; how deep one is behind it."""
        self.depth -= 1
        return self.depth

    def forget(self) -> None:
        """What was read so far is not kept."""
        self._kept = 0
