"""Chooses the columns of a table that fit a terminal, and their widths, since wrapped rows cannot be read.

Cells are broken between words. A word that is too long, such as the name of a case, is shown by its two ends; words of
a column stay distinguishable if that takes at most half of a terminal.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from rich.cells import cell_len

from regents_cosim.plain_text import wrapped

GAP = 2  # blanks between two columns
_NARROWEST = 16  # shorter words are always whole
_WIDEST = 40  # most width given to words to keep them distinguishable
_LEFT_OUT = "…"
_MOST_LINES = 8  # most lines of a cell


@dataclass(frozen=True)
class Column:
    """A heading, and the cells under it."""

    heading: str
    cells: Sequence[str]

    def width(self, lines: int) -> int:
        """The width at which cells, broken between words, take at most `lines` lines, or a few more."""
        heading = max(map(cell_len, self.heading.split()), default=0)
        whole = max(map(cell_len, self.cells), default=0)
        word = max((cell_len(word) for cell in self.cells for word in cell.split()), default=0)
        broken = max(min(word, max(_NARROWEST, -(-whole // lines))), -(-whole // lines), _NARROWEST)
        return max(heading, min(whole, max(broken, self._apart)), 1)

    @cached_property
    def _apart(self) -> int:
        """The least width at which shortened words remain distinguishable."""
        words = {word for cell in self.cells for word in cell.split() if cell_len(word) > _NARROWEST}
        longest = max(map(cell_len, words), default=0)
        widths = range(_NARROWEST, min(longest, _WIDEST) + 1)
        return next((width for width in widths if len({ends(one, width) for one in words}) == len(words)), _NARROWEST)

    def within(self, width: int | None) -> "Column":
        """The column broken into lines of at most `width`; None: a single line."""
        if width is None:
            return self
        return Column(laid_out(self.heading, width), [laid_out(cell, width) for cell in self.cells])

    def is_shortened(self, width: int | None) -> bool:
        """Whether a word is shortened to its two ends."""
        return width is not None and any(cell_len(word) > width for cell in self.cells for word in cell.split())


def laid_out(cell: str, width: int) -> str:
    """A cell in lines of at most `width`, broken between words; a longer word is shown by its two ends."""
    return wrapped(" ".join(ends(word, width) for word in cell.split(" ")), width)


def ends(word: str, width: int) -> str:
    """A word, shortened to its begin and its end if it is too long."""
    if cell_len(word) <= width:
        return word
    kept = max(width - cell_len(_LEFT_OUT), 0)
    while True:
        shown = f"{word[: kept - kept // 2]}{_LEFT_OUT}{word[len(word) - kept // 2 :]}"
        if cell_len(shown) <= width or not kept:  # some characters are two columns wide
            return shown
        kept -= 1


def fit(columns: Mapping[str, Column], essential: Sequence[str], room: int) -> dict[str, int]:
    """The columns that fit into `room`, by key in their order, with their widths.

    Essential columns are added first, in the given order, then others that fit without more lines. Cells take as few
    lines as the essential columns need (the first column if there are none).
    """
    first = [key for key in essential if key in columns] or list(columns)[:1]
    widths = [{key: column.width(lines) for key, column in columns.items()} for lines in range(1, _MOST_LINES + 1)]
    within = next((some for some in widths if _sum(some[key] for key in first) <= room), widths[-1])
    chosen: list[str] = []
    for key in (*first, *(key for key in columns if key not in first)):
        if not chosen or _sum(within[one] for one in (*chosen, key)) <= room:
            chosen.append(key)
    return _filled({key: within[key] for key in columns if key in chosen}, widths[0], room)


def _filled(widths: dict[str, int], whole: Mapping[str, int], room: int) -> dict[str, int]:
    """Give the remaining room to the columns that are broken into lines."""
    for key in widths:
        widths[key] += max(0, min(whole[key] - widths[key], room - _sum(widths.values())))
    return widths


def _sum(widths: Iterable[int]) -> int:
    each = list(widths)
    return sum(each) + GAP * (len(each) - 1)
