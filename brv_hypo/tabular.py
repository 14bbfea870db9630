"""What every result can do for a reader: a short repr, an HTML view, a data frame; and JSON that comes back."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, get_args, get_origin

from pydantic import BaseModel, ConfigDict, model_validator

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


class NullIsNaN(BaseModel):
    """A part of a result: where a field is a number, or a mapping of names to numbers, null means not a number."""

    model_config = ConfigDict(frozen=True, populate_by_name=True)

    @model_validator(mode="before")
    @classmethod
    def _numbers(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        read = dict(data)
        for name, field in cls.model_fields.items():
            if name not in read:
                continue
            if field.annotation is float and read[name] is None:
                read[name] = float("nan")
            elif _is_mapping_of_numbers(field.annotation) and isinstance(read[name], dict):
                read[name] = {key: float("nan") if value is None else value for key, value in read[name].items()}
        return read


class Result(Tabular, NullIsNaN):
    """A result that survives JSON: what is not a number is written as null, and null is read as not a number."""

    def __repr__(self) -> str:
        """Short, whatever the result holds."""
        return Tabular.__repr__(self)

    __str__ = __repr__

    def to_json(self) -> str:
        """The JSON of the contract; histories for pictures are no part of it."""
        return self.model_dump_json(by_alias=True, indent=2) + "\n"

    @classmethod
    def from_json(cls, source: str | Path) -> Self:
        """The result that `to_json`, or a command with `--json`, wrote: its text, or the path of the file.

        Raises UsageError where it is not one.
        """
        text = source if isinstance(source, str) and source.lstrip().startswith("{") else _read(source)
        try:
            return cls.model_validate_json(text)
        except ValueError as error:
            raise UsageError(f"this is not the JSON of a {cls.__name__}: {_first(error)}.") from None


def _is_mapping_of_numbers(annotation: object) -> bool:
    return get_origin(annotation) is dict and get_args(annotation) == (str, float)


def _told(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    return "" if value is None else str(value)


def _first(error: ValueError) -> str:
    return str(error).splitlines()[0]


def _read(path: str | Path) -> str:
    try:
        return Path(path).read_text(encoding="utf-8")
    except OSError as error:
        reason = error.strerror or error
        raise UsageError(f"{path} cannot be read: {reason}. Give the file that --json wrote.") from None


def _pandas() -> Any:
    try:
        import pandas
    except ImportError:
        message = "to_dataframe() needs pandas, which is not installed: pip install 'brv-hypo[tables]'."
        raise UsageError(message) from None
    return pandas
