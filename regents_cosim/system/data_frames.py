"""Converts results to data frames of pandas or polars, if installed, and to tables in notebooks."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from regents_cosim.errors import MissingDependencyError, install_hint
from regents_cosim.short_repr import html_table

if TYPE_CHECKING:
    import pandas
    import polars


class Tabular:
    """A result that is also a table: `table` returns its rows, by the names of the columns."""

    def table(self) -> Sequence[Mapping[str, object]]:
        """The rows of the table."""
        raise NotImplementedError

    def to_pandas(self) -> "pandas.DataFrame":
        """The rows of `table` as a data frame. Raises MissingDependencyError where pandas is not installed."""
        try:
            import pandas
        except ImportError as error:
            raise MissingDependencyError("to_pandas() needs pandas: pip install pandas") from error
        return pandas.DataFrame(list(self.table()))

    def to_polars(self) -> "polars.DataFrame":
        """The rows of `table` as a data frame. Raises MissingDependencyError where polars is not installed."""
        try:
            import polars
        except ImportError as error:
            raise MissingDependencyError(f"to_polars() needs polars: {install_hint('logs')}") from error
        return polars.DataFrame(list(self.table()), infer_schema_length=None)

    def _repr_html_(self) -> str:
        return html_table(self.table())
