"""Measurements of the crossflow, and the random walk with global parameters that they determine.

The normal force by the accelerometers, and the static moment by the gyros: both oppose the crossflow, with a slope that
varies slowly and is not known beforehand. Each measurement model is linear in its unknowns, given the crossflow xi:

    force    f_y + i f_z = -(q_inf S / m) C_N(t) (alpha / sin alpha) xi
    moment   C_m + i C_n = -i C_m_alpha(t) (alpha / sin alpha) xi + C_mq omega d / 2V + trim

the force, where it is not linear in alpha, with the slope C_N(t) + C_N3 alpha^2; each plus the errors of the record.
The slope of the moment is complex, so that an out-of-plane moment does not turn the wind.

Linearised, measurement k is   y = h_k z_k + A_k theta + noise,   z_k = z_(k-1) + step,

with noise and steps Gaussian and alike in both parts of the complex numbers. Given the globals theta the walk has a
tridiagonal information matrix, so that solution and covariance cost a time linear in n: the fixed-interval smoother
(Rauch, Tung and Striebel, AIAA J. 3:1445, 1965) in information form, `walk_equations`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import cholesky_banded
from scipy.linalg.lapack import dtbtrs

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.interpolation import DecimatedGrid, blocks
from brv_hypo.motion.motion import effective, unit
from brv_hypo.motion.responses import EffectResponses

# What bends may be as large at this angle of attack (rad, about ten degrees) as what is in proportion (1 sigma).
BENT = 0.2
# Samples at the ends of a segment that are not used: what a late clock makes of them is outside the record.
SEGMENT_ENDS = 4
LEAST_COSINE = 0.1  # of alpha, in the derivative of alpha by its sine
_RIDGE = 1e-11  # keeps unknowns that the data do not see from making the normal equations singular; they stay at zero
# All steps together vary by this share at least of the variance that the measurements leave of one level, which changes
# no answer: steps without noise, of rates that were computed, make the information singular in double precision.
_LEAST_STEP_VARIANCE = 1e-4
Columns = Callable[[slice], ComplexArray]  # makes rows of columns (n, k), which need not all exist at once


@dataclass(frozen=True)
class MeasurementModel:
    """One kind of observation of the crossflow xi: observed = scale * slope(t) * xi + nuisance + errors."""

    observed: ComplexArray  # (n,)
    scale: ComplexArray  # (n,)
    slope_basis: FloatArray  # the slope's time bases (n, k)
    nuisance: ComplexArray  # columns (n, m) with real coefficients
    kept: DecimatedGrid  # the samples of the next two
    # what errors of the record of one standard deviation add to the observation at the same crossflow (kept, e)
    effects: ComplexArray
    factors: FloatArray | None  # the share that they add to its scale (kept, e); None where they add none
    sigma: FloatArray  # noise (n,) of either part; inf where nothing is measured
    complex_slope: bool  # whether the slope's coefficients are complex
    # whether a real slope has a bend with the square of alpha; its coefficient is after those in time
    bends: bool = False

    @property
    def unknowns(self) -> int:
        """How many real coefficients the model has."""
        slopes = int(self.slope_basis.shape[1]) * (2 if self.complex_slope else 1)
        return slopes + self.bends + int(self.nuisance.shape[1])

    def slope(self, coefficients: FloatArray) -> ComplexArray:
        """Slope (n,) at alpha = 0, of the first coefficients."""
        k = self.slope_basis.shape[1]
        real = self.slope_basis @ coefficients[:k]
        if not self.complex_slope:
            return real.astype(complex)
        return np.asarray(real + 1j * (self.slope_basis @ coefficients[k : 2 * k]))

    def bend(self, coefficients: FloatArray) -> float:
        """What the slope gains with the square of alpha, 1/rad^2 of its units."""
        return float(coefficients[self.slope_basis.shape[1]]) if self.bends else 0.0

    def ratio(self, xi: ComplexArray, coefficients: FloatArray) -> ComplexArray:
        """Slope (n,) at the crossflow as it is, with its bend."""
        return np.asarray(self.slope(coefficients) + self.bend(coefficients) * np.abs(effective(xi)) ** 2)

    def columns(self, xi: ComplexArray) -> ComplexArray:
        """Derivative of the observation with respect to the coefficients, (n, unknowns)."""
        slopes = (self.scale * effective(xi))[:, None] * self.slope_basis
        parts = [slopes, 1j * slopes] if self.complex_slope else [slopes]
        if self.bends:
            parts.append((self.scale * effective(xi) * np.abs(effective(xi)) ** 2)[:, None])
        return np.concatenate([*parts, self.nuisance], axis=1)

    def modelled(self, xi: ComplexArray, coefficients: FloatArray) -> ComplexArray:
        """What the model makes of the crossflow alone (n,)."""
        return np.asarray(self.scale * self.ratio(xi, coefficients) * effective(xi))

    def gain(self, xi: ComplexArray, coefficients: FloatArray, turn: ComplexArray) -> ComplexArray:
        """Derivative of that by the two parts of a shift of the crossflow (n, 2), which `turn` (n,) turns to the body.
        Along the crossflow a slope that bends, and alpha over its sine, gain more than across it.
        """
        size = np.abs(xi)
        alpha = np.arcsin(np.minimum(size, 1.0))
        across = self.ratio(xi, coefficients) * alpha / np.maximum(size, 1e-12)
        along = self.slope(coefficients) + 3.0 * self.bend(coefficients) * alpha**2
        along = np.where(size < 1e-12, across, along / np.maximum(np.cos(alpha), LEAST_COSINE))
        same, mirrored = 0.5 * (along + across) * turn, 0.5 * (along - across) * unit(xi) ** 2 * np.conj(turn)
        return np.asarray(self.scale[:, np.newaxis] * np.stack([same + mirrored, 1j * (same - mirrored)], axis=1))

    def with_errors(self, errors: FloatArray) -> MeasurementModel:
        """The same model with the scale that it has under errors of the record (e,)."""
        if self.factors is None:
            return self
        return replace(self, scale=self.scale * (1.0 - self.kept.all_of(np.asarray(self.factors @ errors))))

    def by_errors(self, modelled: ComplexArray, rows: slice) -> ComplexArray:
        """What errors of the record add to the observation less what the model makes of it (rows, e) at one crossflow.
        An error of the scale is at every crossflow what the slope would be: only its prior parts the two.
        """
        added = self.kept.all_of(self.effects, rows)
        return added if self.factors is None else added - self.kept.all_of(self.factors, rows) * modelled[rows, None]

    def with_slope_count(self, time: FloatArray, count: int) -> MeasurementModel:
        """The same model with a slope of `count` coefficients in time."""
        return replace(self, slope_basis=slope_basis(time, count))


def slope_basis(time: FloatArray, count: int) -> FloatArray:
    """B-splines (n, count) in time: a constant, a line, a parabola, then cubics with even knots."""
    degree = min(count - 1, 3)
    inner = np.linspace(time[0], time[-1], count - degree + 1)
    knots = np.concatenate([[inner[0]] * degree, inner, [inner[-1]] * degree])
    return np.asarray(BSpline.design_matrix(time, knots, degree).toarray())


def force_measurement(record: InertialRecord, responses: EffectResponses) -> MeasurementModel:
    """The normal force as the accelerometers measure it."""
    return MeasurementModel(
        observed=record.transverse_force,
        scale=-record.force_scale.astype(complex),
        slope_basis=slope_basis(record.time, 1),
        nuisance=np.zeros((record.time.size, 0), dtype=complex),
        kept=responses.rows,
        effects=responses.force,
        factors=responses.pressure,
        sigma=np.where(record.flight.measured(SEGMENT_ENDS), record.force_sigma, np.inf),
        complex_slope=False,
    )


def moment_measurement(record: InertialRecord, responses: EffectResponses) -> MeasurementModel:
    """The static moment as the differentiated gyros measure it."""
    flight = record.flight
    rate = record.transverse_rate * flight.vehicle.reference_length / (2.0 * flight.velocity)
    ones = np.ones(record.time.size, dtype=complex)
    noise = record.rate_noise / record.moment_scale
    return MeasurementModel(
        observed=record.moment,
        scale=np.full(record.time.size, -1j),
        slope_basis=slope_basis(record.time, 1),
        nuisance=np.stack([ones, 1j * ones, rate], axis=1),
        kept=responses.rows,
        effects=responses.turning,  # an error of pressure or inertia is one of the slope, and hides no moment
        factors=None,
        sigma=np.where(record.measured & record.spin_rate.interior, noise, np.inf),
        complex_slope=True,
    )


# ---- The random walk, and the globals that measurements share ----


@dataclass(frozen=True)
class LinearMeasurement:
    """One observation at each of n samples."""

    residual: ComplexArray  # (n,)
    gain: ComplexArray  # change by the real and by the imaginary part of the walk (n, 2)
    columns: Columns  # A (n, k)
    sigma: FloatArray  # standard deviation (n,) of each part of the complex noise; inf where nothing is measured


@dataclass(frozen=True)
class WalkEquations:
    """The problem once the walk is eliminated: normal equations of the globals."""

    # the walk at theta = 0 and less its change per unit of each global, real and imaginary parts by turns (2 n, k + 1)
    answer: FloatArray
    walk_covariance: FloatArray  # of both parts, given the globals (n, 2, 2)
    step_information: FloatArray  # of the walk's steps from 0, per part (n,)
    gram: FloatArray  # inner products of residual (first) and columns, whitened (k + 1, k + 1)

    def sensitivity(self, rows: slice = slice(None)) -> ComplexArray:
        """Change of the walk per unit of each global (rows, k)."""
        first, last, _ = rows.indices(self.walk_covariance.shape[0])
        answer = self.answer[2 * first : 2 * last, 1:]
        return np.asarray(-(answer[0::2] + 1j * answer[1::2]))

    def solve(self, mean: FloatArray, information: FloatArray, damping: float = 0.0) -> WalkSolution:
        """Walk and globals with Gaussian priors of the globals: mean (k,), information (k, k), 0 where free. The
        globals are kept near 0 by a share `damping` of what the measurements say of each.
        """
        normal = self.gram[1:, 1:] + information + damping * np.diag(np.diag(self.gram)[1:])
        scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
        inverse = np.linalg.inv(normal * scale[:, None] * scale + _RIDGE * np.eye(mean.size))
        covariance = inverse * scale[:, None] * scale
        theta = covariance @ (self.gram[1:, 0] + information @ mean)
        cost = self.gram[0, 0] - 2.0 * theta @ self.gram[1:, 0] + theta @ self.gram[1:, 1:] @ theta
        cost += float((theta - mean) @ information @ (theta - mean))
        walk = self.answer @ np.append(1.0, -theta)
        return WalkSolution(walk[0::2] + 1j * walk[1::2], theta, covariance, float(cost))


@dataclass(frozen=True)
class WalkSolution:
    """Walk (n,), globals (k,), their covariance (k, k), and minus twice the log of likelihood times prior."""

    walk: ComplexArray
    theta: FloatArray
    covariance: FloatArray
    cost: float


def walk_equations(measurements: Sequence[LinearMeasurement], step_variance: FloatArray) -> WalkEquations:
    """Eliminate the walk, which starts from 0; `step_variance` (n,) per part, of the first step too."""
    n = measurements[0].residual.size
    # Upper bands of the information: real and imaginary parts by turns, steps two above the diagonal.
    information = np.zeros((3, 2 * n))
    for measurement in measurements:
        white = measurement.gain / measurement.sigma[:, np.newaxis]
        information[2] += (np.abs(white) ** 2).ravel()
        information[1, 1::2] += (np.conj(white[:, 0]) * white[:, 1]).real
    known = 0.5 * n * float(information[2].sum())
    steps = 1.0 / np.maximum(step_variance, _LEAST_STEP_VARIANCE / known if known > 0.0 else 0.0)
    information[2] += np.repeat(steps, 2)
    information[2, :-2] += np.repeat(steps[1:], 2)
    information[0, 2:] = -np.repeat(steps[1:], 2)
    # Inner products of whitened residual and columns, and their projection on the walk.
    count = measurements[0].columns(slice(1)).shape[1] + 1
    gram, projected = np.zeros((count, count)), np.zeros((2 * n, count), order="F")
    for measurement in measurements:
        gain = np.conj(measurement.gain) / measurement.sigma[:, np.newaxis]
        for rows in blocks(n):
            white = np.column_stack([measurement.residual[rows], measurement.columns(rows)])
            white /= measurement.sigma[rows, np.newaxis]
            both = np.concatenate([white.real, white.imag])
            gram += both.T @ both
            for part in (0, 1):
                projected[2 * rows.start + part : 2 * rows.stop : 2] += (gain[rows, part, np.newaxis] * white).real
    factor = cholesky_banded(information)
    half, _ = dtbtrs(factor, projected, uplo="U", trans="T", overwrite_b=True)
    gram -= half.T @ half
    answer, _ = dtbtrs(factor, half, uplo="U", overwrite_b=True)
    # The diagonal of the inverse of a block-tridiagonal matrix: its pivots from both ends meet at each sample.
    reverse = np.zeros_like(information)
    reverse[2], reverse[1, 1:], reverse[0, 2:] = information[2, ::-1], information[1, :0:-1], information[0, :1:-1]
    downward = _pivots(cholesky_banded(reverse))[::-1, ::-1, ::-1]
    between = information[1, 1::2]
    own = np.array([[information[2, 0::2], between], [between, information[2, 1::2]]]).transpose(2, 0, 1)
    return WalkEquations(answer, np.asarray(np.linalg.inv(_pivots(factor) + downward - own)), steps, gram)


def _pivots(factor: FloatArray) -> FloatArray:
    """Block pivots (n, 2, 2) of a matrix by the bands of its Cholesky factor (3, 2 n)."""
    corner = np.zeros((factor.shape[1] // 2, 2, 2))
    corner[:, 0, 0], corner[:, 0, 1], corner[:, 1, 1] = factor[2, 0::2], factor[1, 1::2], factor[2, 1::2]
    return np.asarray(np.swapaxes(corner, 1, 2) @ corner)
