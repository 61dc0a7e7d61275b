"""Which columns of a table fit a terminal, and how wide they are: rows that the terminal wraps cannot be read."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from rich.cells import cell_len

GAP = 2  # blanks between two columns
_NARROWEST = 16  # cells are broken into lines no shorter than that
_MOST_LINES = 8  # that a cell is broken into


@dataclass(frozen=True)
class Column:
    """A heading, which breaks between words, and the cells under it, which break only where there is no room."""

    heading: str
    cells: Sequence[str]

    def width(self, lines: int) -> int:
        """Its width where a cell may take so many lines."""
        heading = max(map(cell_len, self.heading.split()), default=0)
        whole = max(map(cell_len, self.cells), default=0)
        return max(heading, min(whole, max(_NARROWEST, -(-whole // lines))), 1)


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
