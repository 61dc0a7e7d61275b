"""Which columns of a table fit a terminal, and how wide they are: rows that the terminal wraps cannot be read.

Cells go on to another line between words. A word that is too long, such as the name of a case, is shown by its two
ends; those of a column stay apart from each other, where that takes no more than half of a terminal.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from rich.cells import cell_len

from regents_cosim.plain_text import wrapped

GAP = 2  # blanks between two columns
_NARROWEST = 16  # words up to this are whole
_WIDEST = 40  # that words are given so that they stay apart
_LEFT_OUT = "…"
_MOST_LINES = 8  # that a cell is broken into


@dataclass(frozen=True)
class Column:
    """A heading, and the cells under it."""

    heading: str
    cells: Sequence[str]

    def width(self, lines: int) -> int:
        """Its width where a cell may take so many lines, or a few more: between words."""
        heading = max(map(cell_len, self.heading.split()), default=0)
        whole = max(map(cell_len, self.cells), default=0)
        word = max((cell_len(word) for cell in self.cells for word in cell.split()), default=0)
        broken = max(min(word, max(_NARROWEST, -(-whole // lines))), -(-whole // lines), _NARROWEST)
        return max(heading, min(whole, max(broken, self._apart)), 1)

    @cached_property
    def _apart(self) -> int:
        """The least width at which long words are not taken for each other."""
        words = {word for cell in self.cells for word in cell.split() if cell_len(word) > _NARROWEST}
        longest = max(map(cell_len, words), default=0)
        widths = range(_NARROWEST, min(longest, _WIDEST) + 1)
        return next((width for width in widths if len({ends(one, width) for one in words}) == len(words)), _NARROWEST)

    def within(self, width: int | None) -> "Column":
        """The same in lines of at most that width; None: in one."""
        if width is None:
            return self
        return Column(laid_out(self.heading, width), [laid_out(cell, width) for cell in self.cells])

    def is_shortened(self, width: int | None) -> bool:
        """Whether a word of it is shown by its ends alone."""
        return width is not None and any(cell_len(word) > width for cell in self.cells for word in cell.split())


def laid_out(cell: str, width: int) -> str:
    """A cell in lines of at most `width`: broken between words, words that are too long by their two ends."""
    return wrapped(" ".join(ends(word, width) for word in cell.split(" ")), width)


def ends(word: str, width: int) -> str:
    """A word, or as much of its beginning and of its end as there is room for."""
    if cell_len(word) <= width:
        return word
    kept = max(width - cell_len(_LEFT_OUT), 0)
    while True:
        shown = f"{word[: kept - kept // 2]}{_LEFT_OUT}{word[len(word) - kept // 2 :]}"
        if cell_len(shown) <= width or not kept:  # some characters are two columns wide
            return shown
        kept -= 1


def fit(columns: Mapping[str, Column], essential: Sequence[str], room: int) -> dict[str, int]:
    """The columns that fit into `room`, by their keys and in their order, with their widths.

    Cells take as few lines as the essential columns need (without any: the first one). These come first, by their
    order, then the others that have room in as many lines.
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
    """What room is left goes to the columns that are broken."""
    for key in widths:
        widths[key] += max(0, min(whole[key] - widths[key], room - _sum(widths.values())))
    return widths


def _sum(widths: Iterable[int]) -> int:
    each = list(widths)
    return sum(each) + GAP * (len(each) - 1)
