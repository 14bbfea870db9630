"""What every result can do for a reader: a short repr, an HTML view, a data frame. JSON is in `json_result`."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from brv_hypo.errors import UsageError

if TYPE_CHECKING:
    import pandas

MOST_ROWS = 60
"""Rows of an HTML view; a data frame has them all."""

Row = Mapping[str, Any]


class Tabular:
    """A result as a headline and rows; subclasses give both."""

    @abstractmethod
    def headline(self) -> str:
        """The result in a few words."""

    @abstractmethod
    def rows(self) -> Sequence[Row]:
        """The result as rows, each a mapping of column to value, all with the same columns."""

    def to_dataframe(self) -> pandas.DataFrame:
        """The rows as a pandas data frame.

        Raises UsageError with the remedy where pandas is not installed.
        """
        frame: pandas.DataFrame = _pandas().DataFrame.from_records(list(self.rows()))
        return frame

    def __repr__(self) -> str:
        """Short, whatever the result holds."""
        return f"<{type(self).__name__}: {self.headline()}>"

    def _repr_html_(self) -> str:
        """For notebooks: headline and table."""
        rows = list(self.rows())
        head = "".join(f"<th>{escape(str(name))}</th>" for name in (rows[0] if rows else ()))
        body = "".join(
            "<tr>" + "".join(f"<td>{escape(_told(value))}</td>" for value in row.values()) + "</tr>"
            for row in rows[:MOST_ROWS]
        )
        more = f"<p>and {len(rows) - MOST_ROWS} rows more</p>" if len(rows) > MOST_ROWS else ""
        return f"<p><b>{escape(self.headline())}</b></p><table><tr>{head}</tr>{body}</table>{more}"


class Histories(Tabular):
    """A result that is arrays over one axis: `columns` instead of rows."""

    @abstractmethod
    def columns(self) -> Mapping[str, Any]:
        """Column to values (n,), the axis first."""

    def rows(self) -> Sequence[Row]:
        """Every sample, as a row."""
        columns = self.columns()
        return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]

    def to_dataframe(self) -> pandas.DataFrame:
        """The columns as a pandas data frame whose index is the axis; `.to_xarray()` of it is a labelled data set.

        Raises UsageError with the remedy where pandas is not installed.
        """
        columns = dict(self.columns())
        frame: pandas.DataFrame = _pandas().DataFrame(columns).set_index(next(iter(columns)))
        return frame

    def _repr_html_(self) -> str:
        """For notebooks: the headline, and which columns there are."""
        names = ", ".join(self.columns())
        return f"<p><b>{escape(self.headline())}</b></p><p>to_dataframe(): {escape(names)}</p>"


def _told(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    return "" if value is None else str(value)


def _pandas() -> Any:
    try:
        import pandas
    except ImportError:
        message = "to_dataframe() needs pandas, which is not installed: pip install 'brv-hypo[tables]'."
        raise UsageError(message) from None
    return pandas
