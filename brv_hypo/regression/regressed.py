"""What a regression says beside its coefficients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.model.term import Regressor
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.nuisance import Errors
from brv_hypo.regression.problem import Problem


@dataclass(frozen=True)
class Regressed:
    """Errors of every flight: `applied` as corrections of its record before, `found` in all; one mapping each.

    `rates` (rows,) rad/s are the de-rolled rates as they follow from coefficients and errors; `free`, one a flight, are
    the errors that no tolerance bounds.
    """

    applied: tuple[Errors, ...]
    found: tuple[Errors, ...]
    rates: ComplexArray
    free: tuple[frozenset[tuple[str, str]], ...]

    @classmethod
    def of(
        cls, problem: Problem, frame: RateFrame, columns: Sequence[Regressor], values: FloatArray, others: FloatArray
    ) -> Regressed:
        """What a fit of these columns with `values` and nuisances `others` (unknowns,) says."""
        nuisances, flights = problem.rows.nuisances, len(problem.records)
        return cls(
            nuisances.values(np.zeros(others.size), flights),
            nuisances.values(others, flights),
            problem.frame.observed - problem.left(frame, columns, values, others).rates,
            (frozenset(),) * flights,
        )

    def beside(self, held: Sequence[Errors]) -> Regressed:
        """With errors, one mapping a flight, that a model holds: its records are without them, and they are free."""
        applied, found = (
            tuple({**own, **{key: own.get(key, 0.0) + value for key, value in more.items()}} for own, more in pairs)
            for pairs in (zip(each, held, strict=True) for each in (self.applied, self.found))
        )
        return replace(self, applied=applied, found=found, free=tuple(map(frozenset, held)))
