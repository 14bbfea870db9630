"""Noise level, derivative and smoothing spline of a channel: `white_noise_level`, `differentiate`, `smoothed`.

What smoothing leaves of the noise are independent shapes in time of unit standard deviation: parameters with just that
prior, so that standard errors account for it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.polynomial.legendre import legder, legval, legvander
from scipy.linalg import solve_triangular
from scipy.signal import oaconvolve

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray, Values
from brv_hypo.flight.clock import sigma_of_differences
from brv_hypo.flight.record import Flight
from brv_hypo.motion.interpolation import time_splines

NOISE_STILL = 0.5  # share of a channel's steps that are none, from which its rounding is its noise
DERIVATIVE_ORDERS = (2, 4, 6)  # degrees of the local polynomials that are tried
DERIVATIVE_BIAS_COUNTS = 16.0  # times squared bias counts against variance: later statistics know the variance alone
DERIVATIVE_PAST_VALLEY = 3.0  # times the least error so far: wider windows of this degree only lose
DERIVATIVE_DOUBT = 4.0  # standard errors by which the bias against a noisy reference must show
DERIVATIVE_CORRELATED = 4.0  # samples over which its noise is correlated
DERIVATIVE_WIDENING = 1.25  # from one window that is tried to the next
DERIVATIVE_WINDOWS = 5  # of the widest window, that the longest stretch holds at least
_WIDE = 400  # weights from which on a filter is quicker by Fourier transforms
SMOOTH_INTERVALS = 64  # of a smoothing spline, at most: roll rate and density vary slowly
SMOOTH_PER_INTERVAL = 6  # samples at least, so that noise can be separated from the signal
SMOOTH_PENALTIES = (-14.0, 15.0, 117)  # powers of ten, four a decade, from none to a parabola
SMOOTH_ORDER = 3  # of the differences that are penalised: a parabola is smooth
_ROUGHNESS = np.logspace(*SMOOTH_PENALTIES)  # penalties tried
_RIDGE = 1e-14  # of the mean diagonal: keeps coefficients that no sample sees from being singular
_LEAST_ROUGHNESS = 1e-15  # of the roughest mode's: below is rounding


def rms(values: FloatArray | ComplexArray) -> float:
    """Root mean square, of the size where `values` (n, ...) are complex."""
    return float(np.sqrt(np.mean(np.abs(values) ** 2)))


# ---- White-noise level of a channel, from the record itself ----


@dataclass(frozen=True)
class ColouredNoise:
    """A first-order autoregression: sigma of its innovations, in the channel's units, correlation of neighbours."""

    innovation: float
    colour: float = 0.0

    def times(self, factor: float) -> ColouredNoise:
        """The noise so many times as large."""
        return ColouredNoise(factor * self.innovation, self.colour)

    def sigma_at(self, frequency: FloatArray | float) -> FloatArray:
        """Sigma of white noise as large as this is at frequencies in rad a sample."""
        return np.asarray(self.innovation / np.sqrt(inverse_spectrum(self.colour, frequency)), dtype=float)


def inverse_spectrum(colour: FloatArray | float, frequency: FloatArray | float) -> FloatArray:
    """One over the spectrum of a first-order autoregression of unit innovations, at frequencies in rad a sample."""
    return np.asarray(1.0 + colour**2 - 2.0 * colour * np.cos(frequency), dtype=float)


def white_noise_level(channel: FloatArray | ComplexArray, segments: tuple[tuple[int, int], ...]) -> float:
    """Standard deviation of the white noise of `channel` (n,), in its units; of either part where it is complex. A
    channel that is constant between its steps, or too short to judge, is credited with the noise of its quantisation.
    Two that body axes y and z share alike are y + i z: whichever way the axes are rolled, it is the same; and no finer
    than single precision, whatever a simulation wrote.
    """
    sigma = sigma_of_differences([channel[a:b] for a, b in segments])
    if not np.iscomplexobj(channel):
        return float(np.fmax(sigma, _quantisation(channel.real)))
    steps = np.hypot(_quantisation(channel.real), _quantisation(channel.imag)) / math.sqrt(2.0)
    return float(np.fmax.reduce([sigma, steps, np.finfo(np.float32).eps * np.max(np.abs(channel))]))


def _quantisation(channel: FloatArray) -> float:
    """Standard deviation of rounding to the channel's smallest step, or to double precision."""
    steps = np.abs(np.diff(channel))
    steps = steps[steps > 0.0]
    still = steps.size < NOISE_STILL * max(channel.size - 1, 1)
    smallest = float(steps.min()) if steps.size and still else 0.0
    return max(smallest / math.sqrt(12.0), 1e-12 * float(np.max(np.abs(channel), initial=1.0)))


# ---- The first derivative: the local polynomial of the least mean-square error ----


@dataclass(frozen=True)
class Filtered:
    """First derivative of a sampled signal, and what the filter does to white noise."""

    signal: ComplexArray  # as it was (n,)
    value: ComplexArray  # smoothed (n,)
    rate: ComplexArray  # its derivative (n,), per s
    rate_gain: FloatArray  # standard deviation (n,) of the rate per unit of white noise, 1/s; inf where it is not found
    interior: BoolArray  # where the filter is centred (n,), so that `noise_correlation` holds
    order: int  # degree of the local polynomials
    half_width: int  # samples on either side of the middle of the window
    noise_correlation: FloatArray  # that of the rate's noise at lags of 0, 1, ... samples (2 half_width + 1,)
    rate_bias: float  # estimated rms bias of each part of the rate, per s


def differentiate(signal: ComplexArray, step: float, sigma: float, segments: tuple[tuple[int, int], ...]) -> Filtered:
    """Derivative of `signal` (n,) by a Savitzky-Golay filter; `sigma` is its parts' white noise, `step` in s. Order and
    width are those of the least mean-square error of the derivative. Its bias is judged by what the next even order
    finds in the same window, less the noise in that (Mallows, Technometrics 15:661, 1973). Each segment [start, stop)
    is filtered by itself; its ends by the outermost polynomial.
    """
    pieces = [signal[a:b] for a, b in segments]
    order, half_width, squared_bias = _best_filter(pieces, sigma)
    n = signal.size
    value: ComplexArray = signal.astype(complex)
    rate: ComplexArray = np.zeros(n, dtype=complex)
    rate_gain, interior = np.full(n, np.inf), np.zeros(n, dtype=bool)
    for (a, b), piece in zip(segments, pieces, strict=True):
        if b - a < 2 * half_width + 1:
            continue
        value[a:b] = _filter(order, half_width, 0)(piece)
        slope = _filter(order, half_width, 1)
        rate[a:b], rate_gain[a:b] = slope(piece), slope.gain(b - a)
        interior[a + half_width : b - half_width] = True
    weights = middle_weights(order, half_width)
    correlation = np.asarray(np.correlate(weights, weights, "full")[2 * half_width :], dtype=float)
    return Filtered(
        signal=signal,
        value=value,
        rate=rate / step,
        rate_gain=rate_gain / step,
        interior=interior,
        order=order,
        half_width=half_width,
        noise_correlation=correlation / correlation[0],
        rate_bias=float(np.sqrt(0.5 * squared_bias)) / step,
    )


def differentiated(flight: Flight, channel: FloatArray, least: float = 0.0) -> Filtered:
    """A channel (n,) of a flight through that filter; its white noise is taken for `least` at least."""
    sigma = max(white_noise_level(channel, flight.segments), least)
    return differentiate(channel.astype(complex), flight.step, sigma, flight.segments)


def smooth_channel(flight: Flight, channel: FloatArray) -> FloatArray:
    """A channel (n,) of a flight, freed of noise."""
    return differentiated(flight, channel, 1e-9 * float(np.max(np.abs(channel))) + 1e-300).value.real


def with_smooth_air(flight: Flight) -> Flight:
    """The flight with speed and dynamic pressure freed of noise: it would add up in the integrated moments. The density
    is far smoother than the pressure, which follows drag and lift through the speed.
    """
    speed = smooth_channel(flight, flight.velocity)
    density = flight.dynamic_pressure / speed**2
    least = 1e-6 * float(np.max(density))
    logarithm = smooth_channel(flight, np.log(np.maximum(density, least)))
    return replace(flight, velocity=speed, dynamic_pressure=np.exp(logarithm) * speed**2)


@dataclass(frozen=True)
class _Filter:
    """Weights on a window: those of its middle (2 half_width + 1,), and those of each place before it. The latter are
    `places` (half_width, order + 1) times the transpose of `basis` (2 half_width + 1, order + 1), which is orthonormal:
    the matrix itself would be as large as the window squared.
    """

    middle: FloatArray
    places: FloatArray
    basis: FloatArray

    def __call__(self, piece: Values) -> Values:
        """`piece` (n,) filtered; the far end mirrors the near one."""
        width = self.middle.size
        first, last = (self.places @ (self.basis.T @ end) for end in (piece[:width], piece[: -width - 1 : -1]))
        mirrored = last[::-1] * np.sign(self.middle @ self.middle[::-1])
        return np.concatenate([first, _correlated(piece, self.middle), mirrored])

    def gain(self, count: int) -> FloatArray:
        """On white noise (count,)."""
        ends = np.linalg.norm(self.places, axis=1)
        return np.concatenate([ends, np.full(count - 2 * ends.size, np.linalg.norm(self.middle)), ends[::-1]])


@lru_cache(maxsize=256)
def _filter(order: int, half_width: int, derivative: int) -> _Filter:
    """Filter of the value (`derivative` 0) or its derivative per sample (1), by Legendre's: powers lose digits."""
    window = np.arange(-half_width, half_width + 1) / half_width
    basis, triangle = np.linalg.qr(legvander(window, order))
    wanted = legval(window[: half_width + 1], legder(np.eye(order + 1), derivative)) / half_width**derivative
    places = np.linalg.solve(triangle.T, wanted).T
    return _Filter(basis @ places[half_width], places[:half_width], basis)


def middle_weights(order: int, half_width: int) -> FloatArray:
    """Weights (2 half_width + 1,) of the derivative per sample in the middle of the window."""
    return _filter(order, half_width, 1).middle


def _correlated(values: Values, weights: FloatArray) -> Values:
    """Sums of `values` (n,) under `weights` (m,), wherever all weights lie within (n - m + 1,)."""
    if weights.size < _WIDE:
        return np.correlate(values, weights, "valid")
    return np.asarray(oaconvolve(values, weights[::-1], mode="valid"))


def derivatives(rows: FloatArray, order: int, half_width: int, step: float) -> FloatArray:
    """First derivatives of `rows` (..., n) by the filter of this order and width, as `differentiate` finds them."""
    found = [_filter(order, half_width, 1)(row) for row in rows.reshape(-1, rows.shape[-1])]
    return np.asarray(found).reshape(rows.shape) / step


def _best_filter(pieces: list[ComplexArray], sigma: float) -> tuple[int, int, float]:
    """Order, half-width and squared bias, per sample squared, of the filter of least mean-square error. Bias is judged
    against the next even order in the same window, and against the narrowest filter of all: windows of many cycles
    smooth everything away whatever their order, and only the second sees it.
    """
    widest = max(piece.size for piece in pieces) // DERIVATIVE_WINDOWS
    both = ([np.ascontiguousarray(each.real), np.ascontiguousarray(each.imag)] for each in pieces)
    parts = [[real, imaginary] if np.any(imaginary) else [real] for real, imaginary in both]
    best, choice = np.inf, (DERIVATIVE_ORDERS[0], 1, 0.0)
    for order in DERIVATIVE_ORDERS:
        valley = np.inf
        for half_width in _half_widths(order // 2 + 1, widest):
            against = _differences(order, half_width)
            bias = max(
                _squared_bias(parts, difference, sigma, margin)
                for difference, margin in zip(against, (0.0, DERIVATIVE_DOUBT), strict=True)
            )
            weights = middle_weights(order, half_width)
            error = DERIVATIVE_BIAS_COUNTS * bias + 2.0 * sigma**2 * float(weights @ weights)
            if error < best:
                best, choice = error, (order, half_width, bias)
            if error > DERIVATIVE_PAST_VALLEY * (valley := min(valley, error)):
                break
    return choice


def _half_widths(smallest: int, widest: int) -> list[int]:
    """Half-widths in steps of about a quarter, the window at most `widest`."""
    widths, width = [smallest], float(smallest)
    while 2 * int(width := max(width + 1.0, DERIVATIVE_WIDENING * width)) + 1 <= widest:
        widths.append(int(width))
    return widths


@lru_cache(maxsize=256)
def _differences(order: int, half_width: int) -> tuple[FloatArray, FloatArray]:
    """Weights of a derivative's filter less those of the next even order, and less those of the narrowest of all."""
    weights = middle_weights(order, half_width)
    narrowest = middle_weights(DERIVATIVE_ORDERS[-1], DERIVATIVE_ORDERS[-1] // 2)

    def less(reference: FloatArray) -> FloatArray:
        widest = max(weights.size, reference.size)
        return np.asarray(np.subtract(*(np.pad(each, (widest - each.size) // 2) for each in (weights, reference))))

    return less(middle_weights(order + 2, half_width)), less(narrowest)


def _squared_bias(pieces: list[list[FloatArray]], difference: FloatArray, sigma: float, margin: float) -> float:
    """Mean squared bias by the `difference` from a filter of less bias; below `margin` sigmas none."""
    long = [parts for parts in pieces if parts[0].size >= difference.size]
    count = sum(parts[0].size - difference.size + 1 for parts in long)
    power = 0.0
    for parts in long:
        gaps = [_correlated(part, difference) for part in parts]
        power += sum(float(gap @ gap) for gap in gaps)
    noise = 2.0 * sigma**2 * float(difference @ difference)
    excess = power / count - noise
    return excess if excess > margin * noise * np.sqrt(DERIVATIVE_CORRELATED / count) else 0.0


# ---- Cubic smoothing splines, and what they leave of the noise as a few independent shapes in time ----


@dataclass(frozen=True)
class Smooth:
    """A smoothed signal: `values` (n,), and the independent shapes of its error as coefficients of a spline. `scale`
    (coefficients, shapes) has shapes of unit standard deviation, the smoothest first.
    """

    values: FloatArray
    scale: FloatArray


@dataclass(frozen=True)
class InputError:
    """What smoothing leaves of an input's noise, as independent shapes in time of unit standard deviation."""

    name: str  # of the input: errors of the roll rate are in rad/s, those of the pressure a fraction of it
    span: tuple[float, float]  # first and last time of the record, s
    scale: FloatArray  # the shapes (coefficients, shapes) by the coefficients of a cubic spline over the span

    @property
    def count(self) -> int:
        """Number of shapes."""
        return int(self.scale.shape[1])

    def shapes(self, time: FloatArray) -> FloatArray:
        """The shapes (count, n) at times (n,) s."""
        return np.asarray((time_splines(time, *self.span, self.scale.shape[0]) @ self.scale).T, dtype=float)


def smoothed(values: FloatArray, weight: FloatArray | None = None) -> Smooth:
    """Cubic smoothing spline through evenly spaced samples whose noise is as one over the weight, each (n,). Roughness
    (third differences of the coefficients) and noise are those of greatest likelihood (Wahba, Ann. Statist. 13:1378,
    1985): error bands then hold on average, the bias of smoothing included. Faster is noise.
    """
    n = values.size
    basis = _splines_through(n)
    weight = np.ones(n) if weight is None else weight / np.sqrt(np.mean(weight**2))
    weighted = weight[:, None] * basis
    rough, modes = _modes(weighted)
    relative = np.maximum(rough / rough[-1], _LEAST_ROUGHNESS)
    relative[:SMOOTH_ORDER] = 0.0
    level = float(np.mean(values))
    whitened = weight * (values - level)
    size = modes.T @ (weighted.T @ whitened)
    rest = max(float(whitened @ whitened - size @ size), 0.0)
    shrink = 1.0 / (1.0 + _ROUGHNESS[:, None] * relative)
    power = (rest + (1.0 - shrink[:, SMOOTH_ORDER:]) @ size[SMOOTH_ORDER:] ** 2) / (n - SMOOTH_ORDER)
    power = np.maximum(power, 1e-28 * float(np.mean((weight * values) ** 2)) + 1e-300)
    freedom = np.log1p(1.0 / (_ROUGHNESS[:, None] * relative[SMOOTH_ORDER:]))
    misfit = (n - SMOOTH_ORDER) * np.log(power) + np.sum(freedom, axis=1)
    best = int(np.argmin(misfit))
    scale = modes * np.sqrt(power[best] * shrink[best])
    return Smooth(np.asarray(level + basis @ (modes @ (shrink[best] * size))), scale)


def unsmoothed(n: int, sigma: float) -> FloatArray:
    """The shapes, as `Smooth.scale` has them, of white noise of n evenly spaced samples that was left as it is."""
    return _modes(_splines_through(n))[1] * sigma


def _splines_through(n: int) -> FloatArray:
    """Cubic splines (n, coefficients) that can follow what is smooth in n samples."""
    intervals = min(SMOOTH_INTERVALS, max(n // SMOOTH_PER_INTERVAL, 1))
    return time_splines(np.linspace(0.0, 1.0, n), 0.0, 1.0, intervals + 3)


def _modes(weighted: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Roughness (count,) and coefficients (count, count) of orthonormal combinations of the columns (n, count). From
    singular values: the smoothest's roughness is 1e-11 of the roughest's, of which squares keep five digits.
    """
    count = weighted.shape[1]
    normal = weighted.T @ weighted
    normal += _RIDGE * float(np.trace(normal)) / count * np.eye(count)
    triangle = np.linalg.cholesky(normal)
    penalty = np.diff(np.eye(count), SMOOTH_ORDER, axis=0)
    _, size, turned = np.linalg.svd(solve_triangular(triangle, penalty.T, lower=True).T)
    rough = np.concatenate([np.zeros(SMOOTH_ORDER), size[::-1] ** 2])
    return rough, np.asarray(solve_triangular(triangle, turned[::-1].T, lower=True, trans="T"), dtype=float)
