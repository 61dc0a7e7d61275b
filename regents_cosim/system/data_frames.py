"""Results that are tables: plain values, data frames of pandas or polars, and tables in notebooks."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from importlib import import_module
from typing import Any, Literal, Self, SupportsIndex, TypeVar, overload

from regents_cosim.errors import MissingDependencyError
from regents_cosim.plain_text import printable
from regents_cosim.short_repr import LINE, html_table

_Row = TypeVar("_Row")


class Tabular:
    """A result that is also a table."""

    def to_dict(self) -> Any:
        """The plain values, as the command prints them with --json: by default a list of the rows of the table."""
        raise NotImplementedError

    def to_frame(self, package: Literal["pandas", "polars"] | None = None) -> Any:
        """The table as a data frame of `package`; by default of pandas, or of polars where only that is installed.

        Raises MissingDependencyError where neither is.
        """
        packages = (package,) if package else ("pandas", "polars")
        for name in packages:
            with suppress(ImportError):
                options = {"infer_schema_length": None} if name == "polars" else {}
                return import_module(name).DataFrame(list(self._rows()), **options)
        raise MissingDependencyError(f"to_frame() needs {' or '.join(packages)}: pip install {packages[0]}")

    def _rows(self) -> Sequence[Mapping[str, object]]:
        return self.to_dict()

    def _repr_html_(self) -> str:
        return html_table(self._rows())


class Rows(list[_Row], Tabular):
    """A list of results that is also a table, with a row for each; a slice of it is one too."""

    @overload
    def __getitem__(self, at: SupportsIndex) -> _Row: ...
    @overload
    def __getitem__(self, at: slice) -> Self: ...
    def __getitem__(self, at: SupportsIndex | slice) -> "_Row | Self":
        """One result, or a slice with its own table."""
        return type(self)(super().__getitem__(at)) if isinstance(at, slice) else super().__getitem__(at)

    def __repr__(self) -> str:
        few = ", ".join(map(repr, self[:3]))
        return printable(f"{type(self).__name__} of {len(self)}{few and f': {few}'}", LINE)

    def to_dict(self) -> list[dict[str, Any]]:
        """A row for each result, by the names of its fields."""
        return [asdict(row) for row in self]  # pyright: ignore[reportArgumentType]
