"""Show values of any size in one line of a console, or in one table of a notebook."""

from collections.abc import Mapping, Sequence, Set
from dataclasses import MISSING, Field, fields
from html import escape
from pathlib import Path
from typing import Any

from regents_cosim.plain_text import printable

LINE, _PART = 300, 80  # most characters of a value, and of each part of it
_FEW = 8  # the most items that are shown one by one


class ShortRepr:
    """Give a dataclass (declared with `repr=False`) a `repr` of one short line without fields of default value."""

    def __repr__(self) -> str:
        parts = [f"{name}={value}" for name, value in self.in_short().items()]
        return printable(f"{type(self).__name__}({', '.join(parts)})", LINE)

    def _repr_html_(self) -> str:
        return html_table([self.in_short()], upright=True)

    def in_short(self) -> dict[str, str]:
        """The fields by name, each value in a few words."""
        own = [field for field in fields(self) if field.repr]  # type: ignore[arg-type]
        values = {field.name: (field, getattr(self, field.name)) for field in own}
        return {name: in_short(value) for name, (field, value) in values.items() if not _as_by_default(field, value)}


def in_short(value: object) -> str:
    """A value in one line: numbers and text in full, arrays by dtype and shape, long collections by their length."""
    if isinstance(value, Path):
        value = str(value)
    if isinstance(value, str):
        return repr(printable(value, _PART))
    if isinstance(value, bytes):
        return f"<{len(value)} bytes>"
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple) and shape:
        return f"{getattr(value, 'dtype', '')}{list(shape)}"
    if isinstance(value, Mapping | Sequence | Set):
        said = repr(value) if len(value) <= _FEW and all(map(_plain, value)) else ""
        return said if 0 < len(said) <= _PART else f"<{len(value)}>"
    said = printable(repr(value), None)
    return said if len(said) <= _PART else f"{type(value).__name__}(...)"


def html_table(rows: Sequence[Mapping[str, object]], upright: bool = False) -> str:
    """Rows as an HTML table for a notebook, names at the top; `upright`: a single row, one field a line."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    head = {name: f"<th>{escape(name)}</th>" for name in names}
    if upright:
        lines = [head[name] + _td(row[name]) for row in rows for name in names]
    else:
        lines = ["".join(head.values()), *("".join(_td(row.get(name)) for name in names) for row in rows)]
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"


def _td(value: object) -> str:
    return f"<td>{'' if value is None else escape(printable(str(value)))}</td>"


def _plain(value: object) -> bool:
    return value is None or isinstance(value, int | float | str)


def _as_by_default(field: Field[Any], value: object) -> bool:
    if field.default_factory is not MISSING:
        return field.default_factory() == value
    comparable = _plain(field.default) or isinstance(field.default, tuple | ShortRepr)
    return comparable and type(value) is type(field.default) and value == field.default
