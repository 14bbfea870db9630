"""A user's aerodynamic table: the static slope C_malpha by Mach number and angle of attack, with its uncertainty.

A CSV file, one line a place, angles in rad (`alpha`) or degrees (`alpha_deg`), or left out where nothing depends on it:

    mach,alpha_deg,slope,std_error
    2.0,0.0,-0.11,0.005
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.flight.record import Flight
from brv_hypo.io.files import read_text
from brv_hypo.io.text import one_line
from brv_hypo.mechanisms.contract import Term
from brv_hypo.model.baseline import DesignMoment
from brv_hypo.motion.motion import Motion
from brv_hypo.settings import problems_of

_EXPECTED = "an aerodynamic table: mach, alpha or alpha_deg (may be left out), slope (1/rad), std_error (1/rad)"
_CSV_BYTES = 1024 * 1024
_MOST_PLACES = 400  # every place is an unknown of the regression


class AeroTable(BaseModel):
    """C_malpha (1/rad) and its 1-sigma uncertainty by Mach number and alpha (rad), linear between, constant beyond."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    mach: tuple[float, ...] = Field(description="places, increasing")
    alpha: tuple[float, ...] = Field(default=(0.0,), description="places, rad")
    slope: tuple[tuple[float, ...], ...] = Field(description="C_malpha, 1/rad, by mach and alpha")
    std_error: tuple[tuple[float, ...], ...] = Field(description="1 sigma, 1/rad")

    @model_validator(mode="after")
    def _consistent(self) -> AeroTable:
        for name, places in (("mach", self.mach), ("alpha", self.alpha)):
            if not places or any(b <= a for a, b in pairwise(places)):
                raise ValueError(f"'{name}' must hold increasing values, got {list(places)[:6]}")
        if len(self.mach) * len(self.alpha) > _MOST_PLACES:
            raise ValueError(f"got {len(self.mach) * len(self.alpha)} places, expected at most {_MOST_PLACES}")
        for name, values in (("slope", self.slope), ("std_error", self.std_error)):
            if [len(row) for row in values] != [len(self.alpha)] * len(self.mach):
                raise ValueError(f"'{name}' must hold one value for each mach ({len(self.mach)}) and alpha")
        if any(error <= 0.0 for row in self.std_error for error in row):
            raise ValueError("'std_error' must be greater than zero: no table is exact")
        return self

    def weights(self, mach: FloatArray, alpha: FloatArray) -> FloatArray:
        """What each place counts at these motions (..., places), the alphas of each Mach number together."""
        by_mach, by_alpha = _hats(mach, self.mach), _hats(alpha, self.alpha)
        both = by_mach[..., :, np.newaxis] * by_alpha[..., np.newaxis, :]
        return np.asarray(both.reshape(*mach.shape, -1), dtype=float)

    def labels(self) -> tuple[str, ...]:
        """Where each place lies, in words."""
        if len(self.alpha) == 1:
            return tuple(f"at Mach {mach:g}" for mach in self.mach)
        return tuple(f"at Mach {mach:g}, alpha {alpha:.4g} rad" for mach in self.mach for alpha in self.alpha)


def _hats(values: FloatArray, places: Sequence[float]) -> FloatArray:
    """Linear B-splines at the places (..., places), the outer ones constant beyond."""
    inside = np.clip(values, places[0], places[-1])
    return np.stack([np.interp(inside, places, row) for row in np.eye(len(places))], axis=-1)


class TableSlope(DesignMoment):
    """The static moment that the table gives; its coefficient is 1 where the table is right on the whole."""

    name, title = "aero_table", "static moment by the aerodynamic table"
    claims, source = "the table's moment in the plane of the angle of attack", "the user's table"

    table: AeroTable

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term: the table's slope times alpha."""
        slope = self.table.weights(motion.mach, motion.alpha) @ np.ravel(self.table.slope)
        return (Term("C_malpha by the table", slope * motion.alpha, np.zeros_like(motion.alpha), "1"),)


class TableIncrements(DesignMoment):
    """What the slope is more at each place of the table, as far as its uncertainty allows."""

    name, title = "aero_increment", "increments to the aerodynamic table"
    claims, source = "the table is wrong by about its uncertainty", "the user's table"

    table: AeroTable

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One term a place: a linear spline around it, times alpha."""
        weights = self.table.weights(motion.mach, motion.alpha)
        return tuple(
            Term(f"C_malpha {label}", weight * motion.alpha, np.zeros_like(motion.alpha), "1/rad")
            for label, weight in zip(self.table.labels(), np.moveaxis(weights, -1, 0), strict=True)
        )

    def tolerance(self, flight: Flight) -> tuple[float, ...]:
        """The table's uncertainty at each place."""
        return tuple(np.ravel(self.table.std_error).tolist())


def read_aero_table(path: str | Path) -> AeroTable:
    """The table in a CSV file (see above); raises UsageError that says what is wrong and where."""
    import pandas as pd

    text = io.StringIO(read_text(path, _EXPECTED, _CSV_BYTES))
    try:
        rows = pd.read_csv(text, skipinitialspace=True, dtype=str)
    except ValueError as error:
        raise UsageError(f"{path} is not {_EXPECTED}: {error}.") from None
    angle = next((name for name in ("alpha", "alpha_deg") if name in rows), None)
    if {*rows} != {"mach", "slope", "std_error", *([angle] if angle else [])}:
        raise UsageError(f"{path} has the columns {[*rows]}, expected {_EXPECTED}. Correct its head.")
    numbers = rows.apply(pd.to_numeric, errors="coerce")
    wrong = np.flatnonzero(numbers.isna().any(axis=1))
    if wrong.size:
        found = one_line(repr([*rows.iloc[wrong[0]]]))
        raise UsageError(f"{path}, line {wrong[0] + 2}: got {found}, expected numbers in every column.")
    alpha = 0.0 if angle is None else numbers[angle]
    numbers["alpha"] = np.radians(alpha) if angle == "alpha_deg" else alpha
    twice = np.flatnonzero(numbers.duplicated(["mach", "alpha"]))
    if twice.size:
        place = f"Mach {numbers['mach'].iloc[twice[0]]:g}"
        raise UsageError(f"{path}, line {twice[0] + 2}: {place} and this alpha stand there twice.")
    tables = {name: numbers.pivot(index="mach", columns="alpha", values=name) for name in ("slope", "std_error")}
    places = tables["slope"]
    if places.isna().any(axis=None):
        expected = f"every alpha ({places.shape[1]}) at every Mach number ({places.shape[0]})"
        raise UsageError(f"{path} has {len(rows)} places, expected {expected}. Fill in what is missing.")
    content = {name: table.to_numpy().tolist() for name, table in tables.items()}
    try:
        return AeroTable.model_validate({"mach": [*places.index], "alpha": [*places.columns], **content})
    except ValidationError as wrong_table:
        raise UsageError(f"{path} is not {_EXPECTED}: {problems_of(wrong_table)}.") from None
