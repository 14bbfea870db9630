"""Smoothing and differentiation of noisy samples by Savitzky-Golay filters of the least mean-square error."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

import numpy as np
from numpy.polynomial.legendre import legder, legval, legvander
from scipy.signal import oaconvolve, savgol_filter

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.constants import (
    DERIVATIVE_BIAS_COUNTS,
    DERIVATIVE_CORRELATED,
    DERIVATIVE_DOUBT,
    DERIVATIVE_ORDERS,
    DERIVATIVE_PAST_VALLEY,
    DERIVATIVE_WIDENING,
    DERIVATIVE_WINDOWS,
)

Values = TypeVar("Values", FloatArray, ComplexArray)

# Weights from which on a filter is quicker by Fourier transforms.
_WIDE = 400


@dataclass(frozen=True)
class Derivative:
    """First derivative of a sampled signal, and what the filter does to white noise.

    `signal` (n,) as it was, `value`, `rate` (n,): smoothed signal and its derivative; `rate_gain` (n,):
    standard deviation of the rate per unit of white noise, 1/s; `value_gain` the same of the value;
    `interior` (n,): where the filter is centred, so that `noise_correlation` (2 half_width + 1,) holds;
    `rate_bias` rms bias of each part of the rate, as estimated.
    """

    signal: ComplexArray
    value: ComplexArray
    rate: ComplexArray
    value_gain: FloatArray
    rate_gain: FloatArray
    interior: BoolArray
    order: int
    half_width: int
    noise_correlation: FloatArray
    rate_bias: float


def differentiate(
    signal: ComplexArray, step: float, sigma: float, segments: tuple[tuple[int, int], ...]
) -> Derivative:
    """Derivative of `signal` (n,), each part of which carries white noise of `sigma`, sampled each `step` s.

    Order and width are those of the least mean-square error of the derivative. Its bias is judged by what the
    next even order finds in the same window, less the noise in that (Mallows, Technometrics 15:661, 1973).
    Each segment [start, stop) is filtered by itself; its ends by the outermost polynomial.
    """
    pieces = [signal[a:b] for a, b in segments]
    order, half_width, squared_bias = _best_filter(pieces, sigma)
    n = signal.size
    value: ComplexArray = signal.astype(complex)
    rate: ComplexArray = np.zeros(n, dtype=complex)
    value_gain, rate_gain, interior = np.ones(n), np.full(n, np.inf), np.zeros(n, dtype=bool)
    for (a, b), piece in zip(segments, pieces, strict=True):
        if b - a < 2 * half_width + 1:
            continue
        value[a:b], value_gain[a:b] = _filter(order, half_width, 0)(piece)
        rate[a:b], rate_gain[a:b] = _filter(order, half_width, 1)(piece)
        interior[a + half_width : b - half_width] = True
    weights = middle_weights(order, half_width)
    correlation = np.asarray(np.correlate(weights, weights, "full")[2 * half_width :], dtype=float)
    return Derivative(
        signal=signal,
        value=value,
        rate=rate / step,
        value_gain=value_gain,
        rate_gain=rate_gain / step,
        interior=interior,
        order=order,
        half_width=half_width,
        noise_correlation=correlation / correlation[0],
        rate_bias=float(np.sqrt(0.5 * squared_bias)) / step,
    )


@dataclass(frozen=True)
class _Filter:
    """Weights on a window: those of its middle (2 half_width + 1,), and those of each place before it.

    The latter are `places` (half_width, order + 1) times the transpose of `basis` (2 half_width + 1, order + 1), which
    is orthonormal: the matrix itself would be as large as the window squared.
    """

    middle: FloatArray
    places: FloatArray
    basis: FloatArray

    def __call__(self, piece: ComplexArray) -> tuple[ComplexArray, FloatArray]:
        """`piece` (n,) filtered, and the gain (n,) on white noise; the far end mirrors the near one."""
        width, half_width = self.middle.size, self.middle.size // 2
        first, last = (self.places @ (self.basis.T @ end) for end in (piece[:width], piece[: -width - 1 : -1]))
        mirrored = last[::-1] * np.sign(self.middle @ self.middle[::-1])
        answer = np.concatenate([first, _correlated(piece, self.middle), mirrored])
        ends = np.linalg.norm(self.places, axis=1)
        inside = np.full(piece.size - 2 * half_width, np.linalg.norm(self.middle))
        return answer, np.concatenate([ends, inside, ends[::-1]])


@lru_cache(maxsize=16)
def _filter(order: int, half_width: int, derivative: int) -> _Filter:
    """Filter of the value (`derivative` 0) or of its derivative per sample (1).

    The polynomials are Legendre's: raw powers lose all digits on wide windows.
    """
    window = np.arange(-half_width, half_width + 1) / half_width
    basis, triangle = np.linalg.qr(legvander(window, order))
    wanted = legval(window[: half_width + 1], legder(np.eye(order + 1), derivative)) / half_width**derivative
    places = np.linalg.solve(triangle.T, wanted).T
    return _Filter(basis @ places[half_width], places[:half_width], basis)


@lru_cache(maxsize=256)
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
    width = 2 * half_width + 1
    if width < _WIDE:
        return np.asarray(savgol_filter(rows, width, order, 1, step))
    weights = middle_weights(order, half_width).reshape((1,) * (rows.ndim - 1) + (-1,))
    out = np.empty_like(rows)
    out[..., half_width:-half_width] = oaconvolve(rows, weights[..., ::-1], mode="valid", axes=-1) / step
    for end, own in ((slice(width), slice(half_width)), (slice(-width, None), slice(-half_width, None))):
        out[..., own] = savgol_filter(rows[..., end], width, order, 1, step)[..., own]
    return out


def _best_filter(pieces: list[ComplexArray], sigma: float) -> tuple[int, int, float]:
    """Order, half-width and squared bias, per sample squared, of the filter of least mean-square error.

    Bias is judged against the next even order in the same window, and against the narrowest filter of all:
    windows of many cycles smooth everything away whatever their order, and only the second sees it.
    """
    longest = max(piece.size for piece in pieces)
    parts = [_real_parts(piece) for piece in pieces]
    best, choice = np.inf, (DERIVATIVE_ORDERS[0], 1, 0.0)
    for order in DERIVATIVE_ORDERS:
        valley = np.inf
        for half_width in _half_widths(order // 2 + 1, longest):
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


def _real_parts(piece: ComplexArray) -> tuple[FloatArray, FloatArray | None]:
    """Real and imaginary part (n,); None for a signal that has none."""
    imaginary = np.ascontiguousarray(piece.imag)
    return np.ascontiguousarray(piece.real), imaginary if np.any(imaginary) else None


def _half_widths(smallest: int, longest: int) -> list[int]:
    """Half-widths in steps of about a quarter, the window at most a fifth of the longest piece."""
    widths, width = [smallest], float(smallest)
    while 2 * int(width := max(width + 1.0, DERIVATIVE_WIDENING * width)) + 1 <= longest // DERIVATIVE_WINDOWS:
        widths.append(int(width))
    return widths


@lru_cache(maxsize=256)
def _differences(order: int, half_width: int) -> tuple[FloatArray, FloatArray]:
    """Weights of a derivative's filter less those of the next even order, and less those of the narrowest of all."""
    weights = middle_weights(order, half_width)
    narrowest = middle_weights(DERIVATIVE_ORDERS[-1], DERIVATIVE_ORDERS[-1] // 2)
    found = []
    for reference in (middle_weights(order + 2, half_width), narrowest):
        widest = max(weights.size, reference.size)
        wide = [np.pad(each, (widest - each.size) // 2) for each in (weights, reference)]
        found.append(wide[0] - wide[1])
    return found[0], found[1]


def _squared_bias(
    pieces: list[tuple[FloatArray, FloatArray | None]], difference: FloatArray, sigma: float, margin: float
) -> float:
    """Mean squared bias of a filter by its `difference` from one of less bias; below `margin` standard errors none."""
    power, count = 0.0, 0
    for parts in pieces:
        if parts[0].size >= difference.size:
            count += parts[0].size - difference.size + 1
            gaps = [_correlated(part, difference) for part in parts if part is not None]
            power += sum(float(gap @ gap) for gap in gaps)
    noise = 2.0 * sigma**2 * float(difference @ difference)
    excess = power / count - noise
    return excess if excess > margin * noise * np.sqrt(DERIVATIVE_CORRELATED / count) else 0.0
