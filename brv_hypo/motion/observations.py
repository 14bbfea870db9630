"""What ties the attitude to the wind: the normal force, and the static moment.

Both oppose the crossflow, with a slope that varies slowly and is not known beforehand. Each model is linear
in its unknowns, given the crossflow xi:

    force    f_y + i f_z = -(q_inf S / m) C_N(t) (alpha / sin alpha) xi
    moment   C_m + i C_n = -i C_m_alpha(t) (alpha / sin alpha) xi + C_mq omega d / 2V + trim

the force, where it bends, with C_N(t) + C_N3 alpha^2 for its slope; each with what the errors of the record add to it.
The moment's slope is complex, so that an out-of-plane moment does not turn the wind.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.constants import TIE_ENDS, TIE_MOST_STRETCH
from brv_hypo.motion.effect_responses import EffectResponses, Responses
from brv_hypo.motion.frames import effective
from brv_hypo.motion.inertial import InertialRecord


@dataclass(frozen=True)
class TieModel:
    """One kind of observation of the crossflow.

    `observed` (n,); `scale` (n,) complex, so that observed = scale * slope(t) * xi + nuisance;
    `slope_basis` (n, k); `nuisance` (n, m) complex columns with real coefficients; `effects` what
    errors of the record of one standard deviation add to the observation at the same crossflow, and `factors`
    what share they add to its scale, where they do; `sigma` (n,), inf where nothing is seen; `complex_slope`: whether
    the slope's coefficients are complex; `bends`: whether a real slope has a bend with the square of alpha, whose
    coefficient stands after those in time.
    """

    name: str
    observed: ComplexArray
    scale: ComplexArray
    slope_basis: FloatArray
    nuisance: ComplexArray
    effects: Responses[ComplexArray]
    factors: Responses[FloatArray] | None
    sigma: FloatArray
    complex_slope: bool
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

    def tied(self, xi: ComplexArray, coefficients: FloatArray) -> ComplexArray:
        """What the model makes of the crossflow alone (n,)."""
        return np.asarray(self.scale * self.ratio(xi, coefficients) * effective(xi))

    def gain(self, xi: ComplexArray, coefficients: FloatArray) -> ComplexArray:
        """Derivative of that by the crossflow, across it (n,); along it too, once it is seen through `stretch`."""
        stretched = np.abs(effective(xi)) / np.maximum(np.abs(xi), 1e-12)
        return np.asarray(self.scale * self.ratio(xi, coefficients) * stretched)

    def stretch(self, xi: ComplexArray, coefficients: FloatArray) -> Stretch | None:
        """What makes the gain along the crossflow, where the model bends, that across it; None where it does not."""
        if not self.bends:
            return None
        across = self.ratio(xi, coefficients).real
        along = across + 2.0 * self.bend(coefficients) * np.abs(effective(xi)) ** 2
        factor = across / np.where(along == 0.0, 1e-300, along)
        turn = xi / np.maximum(np.abs(xi), 1e-12)
        return Stretch(np.where(factor > 0.0, np.minimum(factor, TIE_MOST_STRETCH), TIE_MOST_STRETCH), turn**2)

    def add_effects(self, columns: ComplexArray, rows: slice, tied: ComplexArray) -> None:
        """Add to `columns` (rows, e) what errors of the record add to the observation less what the model makes of it.

        An error of the scale is at every crossflow what the slope would be: only its prior parts the two.
        """
        columns[:, self.effects.which] += self.effects.at(rows)
        if self.factors is not None:
            columns[:, self.factors.which] -= self.factors.at(rows) * tied[rows, np.newaxis]

    def with_slope_count(self, time: FloatArray, count: int) -> TieModel:
        """The same model with a slope of `count` coefficients in time."""
        return replace(self, slope_basis=slope_basis(time, count))


@dataclass(frozen=True)
class Stretch:
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


def force_tie(record: InertialRecord, responses: EffectResponses) -> TieModel:
    """The normal force as seen by the accelerometers."""
    return TieModel(
        name="force",
        observed=record.transverse_force,
        scale=-record.force_scale.astype(complex),
        slope_basis=slope_basis(record.time, 1),
        nuisance=np.zeros((record.time.size, 0), dtype=complex),
        effects=responses.force,
        factors=responses.pressure,
        sigma=np.where(_inside(record), record.force_sigma, np.inf),
        complex_slope=False,
    )


def moment_tie(record: InertialRecord, responses: EffectResponses) -> TieModel:
    """The static moment as seen by the differentiated gyros."""
    flight = record.flight
    rate = record.transverse_rate * flight.vehicle.reference_length / (2.0 * flight.velocity)
    ones = np.ones(record.time.size, dtype=complex)
    noise = record.rate_noise / record.moment_scale
    return TieModel(
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


def _inside(record: InertialRecord) -> BoolArray:
    """Where the instruments were read (n,), less the ends of the segments."""
    inside = np.zeros(record.time.size, dtype=bool)
    for start, stop in record.flight.segments:
        inside[start + TIE_ENDS : stop - TIE_ENDS] = True
    return inside
