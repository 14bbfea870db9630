"""The quadratic problem of one segment, and what its answer can be asked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.blocks import BlockRows


@dataclass(frozen=True)
class Quadratic:
    """The quadratic problem of one segment: n samples, p parameters.

    Attributes:
        residual: r, (n, n_outputs), whitened. by_state: J. by_parameter: J_p, (n, n_outputs, p).
        defect: c, (n, n_states); row 0 is that of the initial state. defect_by_state: D without row 0, which
            is the unit matrix.
        defect_by_parameter: C, (n, n_states, p).
        variance: diagonal of Q, (n, n_states); row 0 infinite where the initial state is free.
    """

    residual: FloatArray
    by_state: BlockRows
    by_parameter: FloatArray
    defect: FloatArray
    defect_by_state: BlockRows
    defect_by_parameter: FloatArray
    variance: FloatArray

    @property
    def exact(self) -> bool:
        """Whether no noise drives the states."""
        return not np.any(self.variance[1:])

    def direct(self, part: slice = slice(None)) -> FloatArray:
        """[r J_p] of some samples, (samples, n_outputs, 1 + p)."""
        return np.concatenate([self.residual[part, :, None], self.by_parameter[part]], axis=2)

    def defects(self, part: slice = slice(None)) -> FloatArray:
        """[c C] of some samples, (samples, n_states, 1 + p); zero where the initial state is free."""
        found = np.concatenate([self.defect[part, :, None], self.defect_by_parameter[part]], axis=2)
        found[np.isinf(self.variance[part])] = 0.0
        return found


class Eliminated(Protocol):
    """The states as affine functions of the parameter step dp.

    `weights` (1 + p,) are 1 and dp, or a derivative's 0 and direction.
    """

    @property
    def problem(self) -> Quadratic:
        """What was eliminated from."""

    def states(self, weights: FloatArray) -> FloatArray:
        """dx, (n, n_states)."""

    def step(self, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """dx and the multipliers of the dynamics, (n, n_states) each; row 0 of these is the initial state's."""

    def at_start(self) -> FloatArray:
        """dx of the first sample, (n_states, 1 + p)."""

    def rows(self) -> tuple[FloatArray, FloatArray | None]:
        """r + J dx + J_p dp, (n, n_outputs, 1 + p), and the whitened process noise (n, n_states, 1 + p), None
        where there is none: of both the constant part and the derivative by dp.
        """

    def triangle(self) -> FloatArray:
        """Upper triangle of the same rows, the constant part as last column, (1 + p, 1 + p)."""
