"""The noise that every hypothesis is judged by: what the record itself says of it, never the candidates.

A free moment, smooth in time, takes up whatever moved the vehicle slowly; what is left is the instruments' noise with
its colour.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray, IntArray
from brv_hypo.motion.kept_rows import turning
from brv_hypo.regression.channels import Lasting, Noise, Part
from brv_hypo.regression.frame import remove_levels
from brv_hypo.regression.free_moment import free_moment
from brv_hypo.regression.linear import orthonormal
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.response import LinearisedFlight
from brv_hypo.regression.whitening import LastingSpectrum, fit_noise, white

# Largest order of the autoregression of the noise.
_NOISE_ORDER = 12
# Rows up to which the fit that the noise is left by keeps them all; beyond, what it takes of the noise is nothing.
_MOST_UNTHINNED = 8000
# Rows that a cycle of the fastest motion keeps where whitened rows are averaged.
_PER_CYCLE = 12


def first_noise(flights: Sequence[LinearisedFlight]) -> Noise:
    """White noise of the level that the records themselves show, and how many rows may be averaged."""
    return Noise(
        white(float(np.median([each.record.gyro_sigma for each in flights]))),
        white(float(np.median([np.median(each.record.force_sigma) for each in flights]))),
        min(each.spacing(_PER_CYCLE) for each in flights),
    )


def settled_noise(problem: Problem) -> Noise:
    """The noise with its colour, from what a free, smooth moment leaves."""
    frame, free = free_moment(problem)
    columns = (*problem.baseline, *free)
    rows, part = problem.rows, problem.rows.part
    thinning = 1 if part.rows.size <= _MOST_UNTHINNED else rows.noise.thinning
    plain = problem.under(Noise(white(rows.noise.rates.sigma), white(rows.noise.force.sigma), thinning))
    basis, coefficients = orthonormal(plain.whole_design(frame, columns))
    values = coefficients @ (basis.T @ plain.raw_response)
    count, constants = len(columns), 2 * len(part.levels)
    rest = plain.left(frame, columns, values[:count], values[count + constants :]).at(part.rows)
    rates = remove_levels(rest.rates, part.pieces, plain.rows.noise.rates)
    seen = [samples for a, b in part.pieces if (samples := a + np.flatnonzero(part.seen[a:b])).size]
    force = [rest.force[samples] for samples in seen]
    of_rates, of_force = _fitted(basis, part, seen) if thinning == 1 else ((), ())
    lasting_rates, lasting_force = LastingSpectrum.of(rates, of_rates), LastingSpectrum.of(force, of_force)
    return Noise(
        fit_noise(lasting_rates, _NOISE_ORDER),
        fit_noise(lasting_force, _NOISE_ORDER),
        rows.noise.thinning,
        Lasting(lasting_rates.noise, lasting_force.noise, _turning(problem)),
    )


def _turning(problem: Problem) -> float:
    """Frequency of the fastest motion of any flight in axes that do not roll, rad a sample."""
    motions = [each.motion for each in problem.frame.reconstructions]
    return max(
        turning(motion.windward_meridian_rate, motion.p, record.flight.step)
        for motion, record in zip(motions, problem.records, strict=True)
    )


def _fitted(
    basis: FloatArray, part: Part, seen: Sequence[IntArray]
) -> tuple[Sequence[ComplexArray], Sequence[ComplexArray]]:
    """The orthonormal basis of a fit as complex histories in rates and force, those of each stretch by themselves."""
    rows = part.rows.size
    rates, force = (
        basis[first : first + rows] + 1j * basis[first + rows : first + 2 * rows] for first in (0, 2 * rows)
    )
    return [rates[a:b] for a, b in part.pieces], [force[samples] for samples in seen]
