"""Measurements of the crossflow: the normal force by the accelerometers, and the static moment by the gyros.

Both oppose the crossflow, with a slope that varies slowly and is not known beforehand. Each measurement model is
linear in its unknowns, given the crossflow xi:

    force    f_y + i f_z = -(q_inf S / m) C_N(t) (alpha / sin alpha) xi
    moment   C_m + i C_n = -i C_m_alpha(t) (alpha / sin alpha) xi + C_mq omega d / 2V + trim

the force, where it is not linear in alpha, with the slope C_N(t) + C_N3 alpha^2; each plus the errors of the record.
The slope of the moment is complex, so that an out-of-plane moment does not turn the wind.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.motion import effective, unit
from brv_hypo.motion.responses import EffectResponses, Responses

# What bends may be as large at this angle of attack (rad, about ten degrees) as what is in proportion (1 sigma).
BENT = 0.2
# Samples at the ends of a segment that are not used: what a late clock makes of them is outside the record.
SEGMENT_ENDS = 4
LARGEST_LOCAL_SCALING = 4.0  # of an observation that hardly changes along the crossflow: it says little there


@dataclass(frozen=True)
class MeasurementModel:
    """One kind of observation of the crossflow xi: observed = scale * slope(t) * xi + nuisance + errors."""

    name: str
    """force or moment."""
    observed: ComplexArray
    """(n,)"""
    scale: ComplexArray
    """(n,)"""
    slope_basis: FloatArray
    """The slope's time bases (n, k)."""
    nuisance: ComplexArray
    """Columns (n, m) with real coefficients."""
    effects: Responses[ComplexArray]
    """What errors of the record of one standard deviation add to the observation at the same crossflow."""
    factors: Responses[FloatArray] | None
    """The share that they add to its scale; None where they add none."""
    sigma: FloatArray
    """Noise (n,) of either part; inf where nothing is measured."""
    complex_slope: bool
    """Whether the slope's coefficients are complex."""
    bends: bool = False
    """Whether a real slope has a bend with the square of alpha; its coefficient stands after those in time."""

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

    def gain(self, xi: ComplexArray, coefficients: FloatArray) -> ComplexArray:
        """Derivative of that by the crossflow, across it (n,); along it too, once it is scaled by `local_scaling`."""
        stretched = np.abs(effective(xi)) / np.maximum(np.abs(xi), 1e-12)
        return np.asarray(self.scale * self.ratio(xi, coefficients) * stretched)

    def local_scaling(self, xi: ComplexArray, coefficients: FloatArray) -> LocalScaling | None:
        """What makes the gain along the crossflow, where the model bends, that across it; None where it does not."""
        if not self.bends:
            return None
        across = self.ratio(xi, coefficients).real
        along = across + 2.0 * self.bend(coefficients) * np.abs(effective(xi)) ** 2
        factor = across / np.where(along == 0.0, 1e-300, along)
        bounded = np.where(factor > 0.0, np.minimum(factor, LARGEST_LOCAL_SCALING), LARGEST_LOCAL_SCALING)
        return LocalScaling(bounded, unit(xi) ** 2)

    def add_effects(self, columns: ComplexArray, rows: slice, modelled: ComplexArray) -> None:
        """Add to `columns` (rows, e) what errors of the record add to the observation less what the model makes of it.

        An error of the scale is at every crossflow what the slope would be: only its prior parts the two.
        """
        columns[:, self.effects.which] += self.effects.at(rows)
        if self.factors is not None:
            columns[:, self.factors.which] -= self.factors.at(rows) * modelled[rows, np.newaxis]

    def with_slope_count(self, time: FloatArray, count: int) -> MeasurementModel:
        """The same model with a slope of `count` coefficients in time."""
        return replace(self, slope_basis=slope_basis(time, count))


@dataclass(frozen=True)
class LocalScaling:
    """Observations (n,) stretched by `factor` along the crossflow, whose direction squared is `turn`."""

    factor: FloatArray
    turn: ComplexArray

    def of(self, values: ComplexArray, rows: slice = slice(None)) -> ComplexArray:
        """Values (rows, ...) stretched."""
        return self._by(self.factor[rows], values, rows)

    def back(self, values: ComplexArray) -> ComplexArray:
        """Values (n,) as they were before."""
        return self._by(1.0 / self.factor, values, slice(None))

    @property
    def noise(self) -> FloatArray:
        """What the noise of both parts is, on the average, over what it was (n,)."""
        return np.sqrt(0.5 * (1.0 + self.factor**2))

    def _by(self, factor: FloatArray, values: ComplexArray, rows: slice) -> ComplexArray:
        shape = (-1, *(1,) * (values.ndim - 1))
        same, turned = (0.5 * (factor + 1.0)).reshape(shape), (0.5 * (factor - 1.0) * self.turn[rows]).reshape(shape)
        return np.asarray(same * values + turned * np.conj(values))


def slope_basis(time: FloatArray, count: int) -> FloatArray:
    """B-splines (n, count) in time: a constant, a line, a parabola, then cubics with even knots."""
    degree = min(count - 1, 3)
    inner = np.linspace(time[0], time[-1], count - degree + 1)
    knots = np.concatenate([[inner[0]] * degree, inner, [inner[-1]] * degree])
    return np.asarray(BSpline.design_matrix(time, knots, degree).toarray())


def force_measurement(record: InertialRecord, responses: EffectResponses) -> MeasurementModel:
    """The normal force as the accelerometers measure it."""
    return MeasurementModel(
        name="force",
        observed=record.transverse_force,
        scale=-record.force_scale.astype(complex),
        slope_basis=slope_basis(record.time, 1),
        nuisance=np.zeros((record.time.size, 0), dtype=complex),
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
        name="moment",
        observed=record.moment,
        scale=np.full(record.time.size, -1j),
        slope_basis=slope_basis(record.time, 1),
        nuisance=np.stack([ones, 1j * ones, rate], axis=1),
        effects=responses.moment,
        factors=None,
        sigma=np.where(record.measured & record.spin_rate.interior, noise, np.inf),
        complex_slope=True,
    )
