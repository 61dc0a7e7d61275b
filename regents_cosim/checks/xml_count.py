"""Limit how much XML a small file may hold.

gzip can pack XML a thousand to one. Real networks pack six to thirteen to one and need at least eight packed bytes for
an element; route files pack up to 33 to one and need two. So the allowed content grows with the file's size, and a
small file cannot fill the memory.
"""

_ALWAYS_BYTES = 16 << 20
_MOST_TIMES = 50  # further bytes per packed byte
_DEEPEST = 100
_FEW_ELEMENTS = 20_000
_BYTES_PER_ELEMENT = 4  # on disk, for elements that are kept; in plain text an element takes at least as many


def most_unpacked(packed_bytes: int, largest: int) -> int:
    """The most bytes that gzip data of `packed_bytes` may unpack to."""
    return min(largest, _ALWAYS_BYTES + _MOST_TIMES * packed_bytes)


class ElementCount:
    """Count the depth and the number of elements of an XML file; raises ValueError beyond sensible numbers."""

    def __init__(self, size: int) -> None:
        self.depth = self._kept = self._all = 0
        self._most_kept, self._most = _FEW_ELEMENTS + size // _BYTES_PER_ELEMENT, _FEW_ELEMENTS + size

    def open(self) -> None:
        """Note the begin of an element."""
        self.depth += 1
        self._kept += 1
        self._all += 1
        if self.depth > _DEEPEST:
            raise ValueError(f"elements nested more than {_DEEPEST} deep")
        if self._kept > self._most_kept or self._all > self._most:
            raise ValueError(f"more than {self._all - 1} elements in so small a file (unpack it if it is your own)")

    def close(self) -> int:
        """Note the end of an element, and return the depth behind it."""
        self.depth -= 1
        return self.depth

    def forget(self) -> None:
        """Note that the elements so far are no longer in memory."""
        self._kept = 0
