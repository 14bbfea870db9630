"""The noise that every hypothesis is judged by: what the record itself says of it, never the candidates.

A free moment, smooth in time, takes up whatever moved the vehicle slowly; what is left is the instruments' noise with
its colour.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.interpolate import BSpline

from brv_hypo.arrays import FloatArray
from brv_hypo.mechanisms.contract import Mechanism, Term
from brv_hypo.model.columns import Column
from brv_hypo.model.time_variation import TimeFunction
from brv_hypo.motion.frames import plane_from_body
from brv_hypo.motion.motion import Motion
from brv_hypo.regression.channels import Noise, Part
from brv_hypo.regression.frame import RateFrame, remove_levels
from brv_hypo.regression.linear import lengths
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.response import LinearisedFlight
from brv_hypo.regression.whitening import fit_noise, taken_by, white

# Largest order of the autoregression of the noise.
_NOISE_ORDER = 12
# Rows up to which the fit that the noise is left by keeps them all; beyond, what it takes of the noise is nothing.
_MOST_UNTHINNED = 8000
# Splines in time of each shape of the free moment, and rows that each of its columns needs.
_SPLINES = 10
_ROWS_PER_COLUMN = 12
# Singular values of that fit that count, of the largest.
_CUTOFF = 1e-9
# Rows that a cycle of the fastest motion keeps where whitened rows are averaged.
_PER_CYCLE = 12


class FreeMoment(Mechanism):
    """In-plane and out-of-plane moments, with alpha and without, body-fixed ones and damping, splines in time.

    `theta` tells which of these shapes: all of them at once would be large.
    """

    name = "free_moment"
    title = "a moment that is free but smooth"
    claims = "nothing: it stands for whatever moved the vehicle, so that the noise is what is left"
    source = "nonparametric regression"
    time_variation = ("constant",)

    start: float
    stop: float
    splines: int

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One shape times each spline."""
        number = int(theta[_SHAPE])
        inside, outside = self._shape(motion, number)
        return tuple(
            Term(f"{number} {k}", inside * course, outside * course)
            for k, course in enumerate(self._courses(motion.time).T)
        )

    def _shape(self, motion: Motion, number: int) -> tuple[FloatArray, FloatArray]:
        """One shape (n,), in plane and out of plane."""
        nothing, one = np.zeros_like(motion.alpha), np.ones_like(motion.alpha)
        if number < 3:
            return ((one, nothing), (motion.alpha, nothing), (nothing, motion.alpha))[number]
        if number < 5:
            body = np.exp(1j * motion.windward_meridian)
            return (body.real, body.imag) if number == 3 else (-body.imag, body.real)
        rate = plane_from_body(
            np.asarray((motion.q + 1j * motion.r) * motion.rate_factor, dtype=complex), motion.windward_meridian
        )
        return rate.real, rate.imag

    def _courses(self, time: FloatArray) -> FloatArray:
        """Cubic B-splines (n, splines) over the span."""
        inner = np.linspace(self.start, self.stop, self.splines - 2)
        knots = np.concatenate([[inner[0]] * 3, inner, [inner[-1]] * 3])
        return np.asarray(BSpline.design_matrix(np.clip(time, self.start, self.stop), knots, 3).toarray())


_SHAPES = 6
_SHAPE = "shape"


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
    design = plain.whole_design(frame, columns)
    scale = lengths(design)
    orthonormal, triangle = np.linalg.qr(design / scale)
    left, singular, right = np.linalg.svd(triangle)
    kept = singular > _CUTOFF * singular[0]
    values = (right[kept].T / singular[kept]) @ (left[:, kept].T @ (orthonormal.T @ plain.raw_response)) / scale
    basis = orthonormal if np.all(kept) else orthonormal @ left[:, kept]
    count, constants = len(columns), 2 * len(part.levels)
    rest = plain.left(frame, columns, values[:count], values[count + constants :]).at(part.rows)
    force = [rest.force[a:b][part.seen[a:b]] for a, b in part.pieces]
    rates_taken, force_taken = (
        _taken(basis, part, plain.rows.rates) if thinning == 1 else (None, None)
    )
    return Noise(
        fit_noise(remove_levels(rest.rates, part.pieces, plain.rows.noise.rates), _NOISE_ORDER, rates_taken),
        fit_noise([piece for piece in force if piece.size], _NOISE_ORDER, force_taken),
        rows.noise.thinning,
    )


def _taken(basis: FloatArray, part: Part, rates: int) -> tuple[FloatArray, FloatArray]:
    """What a fit on this orthonormal basis takes of the autocorrelation of white noise in rates and force."""
    rows = part.rows.size
    return (
        taken_by(basis[:rates], part.pieces, rows, _NOISE_ORDER),
        taken_by(basis[rates : 2 * rates], part.pieces, rows, _NOISE_ORDER),
    )


def free_moment(problem: Problem) -> tuple[RateFrame, tuple[Column, ...]]:
    """The problem's frame with a free moment, and that moment's columns."""
    time = problem.frame.time
    rows = problem.frame.observed.size * 2
    count = int(np.clip(rows / (_ROWS_PER_COLUMN * _SHAPES), 4, _SPLINES))
    free = FreeMoment(start=float(time.min()), stop=float(time.max()), splines=count)
    frame = problem.frame.with_mechanisms([free])
    always = TimeFunction("constant")
    columns = tuple(
        Column(free.name, f"{number} {k}", ((_SHAPE, float(number)),), always, "1")
        for number in range(_SHAPES)
        for k in range(count)
    )
    return frame, columns
