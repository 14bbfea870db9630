"""The quadratic problem of one segment, and its answer."""

from __future__ import annotations

from dataclasses import dataclass

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.collocation import BlockRows


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


@dataclass(frozen=True)
class Eliminated:
    """States and multipliers as affine functions of dp.

    dx = x[..., 0] + x[..., 1:] dp, likewise the multipliers.

    `x` and `multiplier` are (n, n_states, 1 + p). Where the recursion had them on the way, `residual`
    (n, n_outputs, 1 + p) is r + J dx + J_p dp, and `by_start` (n, n_outputs, free) the derivative of the residual
    by the free parts of the initial state.
    """

    x: FloatArray
    multiplier: FloatArray
    residual: FloatArray | None = None
    by_start: FloatArray | None = None
