"""What every result can do for a reader: a short repr, an HTML view, a data frame, a labelled data set, charts.

A `Tabular` result is a headline and rows; `Histories` are arrays over one axis; `HasCharts` adds `plot`. Two results
are equal where they are of one type and hold the same values, arrays element by element, NaN equal to NaN.

Needs NumPy alone: the subset search and the likelihood use it without the rest of the package. Results that
are written as JSON add `json_result`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from html import escape
from importlib import import_module
from importlib.metadata import entry_points
from inspect import isclass, isroutine
from typing import TYPE_CHECKING, Any

import numpy as np

from brv_hypo.errors import UsageError, missing_package

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure

MOST_ROWS = 60  # of an HTML view; a data frame has them all
Row = Mapping[str, Any]
RENDERERS = "brv_hypo.renderers"
"""Group of entry points of what draws results, as pandas finds its plotting back ends: results need not import it."""
_STYLE = (
    "<style>.brv-hypo table {border-collapse: collapse; font-variant-numeric: tabular-nums} "
    ".brv-hypo :is(td, th) {text-align: right; padding: .2em .7em; white-space: nowrap} "
    ".brv-hypo :is(td, th):first-child {text-align: left} .brv-hypo th {border-bottom: 1px solid} "
    ".brv-hypo p {white-space: pre-line}</style>"
)


def equal_values(one: Any, other: Any) -> bool:
    """True where both are of one type and hold the same, whatever depth it lies at."""
    if one is other:
        return True
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=one.dtype.kind in "fc")
    if isinstance(one, float):
        return bool(one == other or (np.isnan(one) and np.isnan(other)))
    if isinstance(one, Mapping):
        return one.keys() == other.keys() and all(equal_values(value, other[key]) for key, value in one.items())
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(equal_values, one, other))
    if is_dataclass(one):
        return all(equal_values(getattr(one, field.name), getattr(other, field.name)) for field in fields(one))
    if hasattr(one, "__dict__") and not (isroutine(one) or isclass(one)):
        # Settings and splines, whose own definitions stop at arrays; what states how it is pickled, as that has it.
        state = (lambda each: each.__reduce__()) if "__reduce__" in vars(type(one)) else vars
        return equal_values(state(one), state(other))
    return bool(one == other)


class Tabular:
    """A result as a headline and rows; subclasses give both."""

    @abstractmethod
    def headline(self) -> str:
        """The result in a few words."""

    def conclusion(self) -> str:
        """What follows from it, in a sentence or two; empty where none is needed."""
        return ""

    @abstractmethod
    def rows(self) -> Sequence[Row]:
        """The result as rows, each a mapping of column to value, all with the same columns."""

    def to_dataframe(self) -> pandas.DataFrame:
        """The rows as a pandas data frame; UsageError with the remedy where pandas is not installed."""
        of_pandas = _needed("pandas", "to_dataframe()", "tables").DataFrame
        rows = self.rows()
        frame: pandas.DataFrame = of_pandas.from_records(list(rows))
        lacking = [name for name in frame if {type(row[str(name)]) for row in rows} == {int, type(None)}]
        return frame.astype(dict.fromkeys(lacking, "Int64"))

    def to_xarray(self) -> xarray.Dataset:
        """The rows as a labelled data set with units, over "row" or the frame's index; UsageError without xarray."""
        _needed("xarray", "to_xarray()", "xarray")
        frame = self.to_dataframe()
        frame = frame.astype(dict.fromkeys(frame.select_dtypes("Int64"), float))  # files have no missing integers
        data = frame.to_xarray() if frame.index.name else frame.rename_axis("row").to_xarray().drop_vars("row")
        for name, units in self.units().items():
            data[name].attrs["units"] = units
        return data.assign_attrs(title=self.headline())

    def units(self) -> Mapping[str, str]:
        """Units of the columns that have any, SI."""
        return {}

    def __eq__(self, other: object) -> bool:
        """The same type and the same values, where what is not a number equals itself."""
        return equal_values(self, other)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.headline()}>"

    def _repr_html_(self) -> str:
        """For notebooks: headline, conclusion and table."""
        return _html(self.headline(), list(self.rows()), self.conclusion())


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
        """The columns as a pandas data frame whose index is the axis; UsageError where pandas is not installed."""
        columns = dict(self.columns())
        of_pandas = _needed("pandas", "to_dataframe()", "tables").DataFrame
        frame: pandas.DataFrame = of_pandas(columns).set_index(next(iter(columns)))
        return frame

    def _repr_html_(self) -> str:
        """For notebooks: the headline, and the columns with their units and ranges."""
        units = self.units()
        lines = [
            {"column": name, "unit": units.get(name), "least": np.nanmin(values), "greatest": np.nanmax(values)}
            for name, values in self.columns().items()
        ]
        return _html(self.headline(), lines)


class HasCharts:
    """A result with charts: those of its page and of `--figures`."""

    def plot(self, chart: str = "") -> Figure:
        """One chart as a matplotlib figure.

        Parameters
        ----------
        chart : str
            The name that its picture file has; "" for the principal one.

        Returns
        -------
        matplotlib.figure.Figure
            Shown by notebooks; its axes may be changed before it is saved.

        Raises
        ------
        UsageError
            The result has no such chart (those that it has are named), or matplotlib is not installed.

        Examples
        --------
        >>> import brv_hypo
        >>> flown = brv_hypo.simulate("research_cone", seed=1, duration=1.0)
        >>> flown.flight.plot("rates").axes[-1].get_xlabel()
        'time, s'
        """
        for found in entry_points(group=RENDERERS):
            figure: Figure = found.load()(self, chart)
            return figure
        raise UsageError(f"plot() needs a renderer, and none is installed in the group {RENDERERS}: install brv-hypo.")


def _html(headline: str, rows: Sequence[Row], conclusion: str = "") -> str:
    head = "".join(f"<th>{escape(str(name))}</th>" for name in (rows[0] if rows else ()))
    cells = ("".join(f"<td>{escape(_text(value))}</td>" for value in row.values()) for row in rows[:MOST_ROWS])
    table = f"<table>{''.join(f'<tr>{each}</tr>' for each in (head, *cells))}</table>"
    more = f"<p>and {len(rows) - MOST_ROWS} rows more</p>" if len(rows) > MOST_ROWS else ""
    said = f"<p>{escape(conclusion)}</p>" if conclusion else ""
    return f'{_STYLE}<div class="brv-hypo"><p><b>{escape(headline)}</b></p>{said}{table}{more}</div>'


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else "" if value is None else str(value)


def _needed(module: str, call: str, extra: str) -> Any:
    """A library that `call` needs; UsageError with the extra that has it where it is not installed."""
    try:
        return import_module(module)
    except ImportError:
        raise missing_package(call, module, extra) from None
