"""What a regression says beside its coefficients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.model.columns import Column
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.nuisance import Errors
from brv_hypo.regression.problem import Problem


@dataclass(frozen=True)
class Regressed:
    """Of every flight's errors what was `taken` out of its record before and what is `found` in all, one mapping each.

    `rates` (rows,) rad/s are the de-rolled rates as they follow from coefficients and errors; `free`, one a flight, are
    the errors that no tolerance bounds.
    """

    taken: tuple[Errors, ...]
    found: tuple[Errors, ...]
    rates: ComplexArray
    free: tuple[frozenset[tuple[str, str]], ...]

    @classmethod
    def of(
        cls, problem: Problem, frame: RateFrame, columns: Sequence[Column], values: FloatArray, others: FloatArray
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
        taken, found = (
            tuple({**own, **{key: own.get(key, 0.0) + value for key, value in more.items()}} for own, more in pairs)
            for pairs in (zip(each, held, strict=True) for each in (self.taken, self.found))
        )
        return replace(self, taken=taken, found=found, free=tuple(map(frozenset, held)))
