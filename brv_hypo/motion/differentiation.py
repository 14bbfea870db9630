"""Smoothing and differentiation of noisy samples by Savitzky-Golay filters of the least mean-square error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legder, legval, legvander

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray

_ORDERS = (2, 4, 6)
_MINIMUM_HALF_WIDTH = {2: 1, 4: 2, 6: 4}


@dataclass(frozen=True)
class Derivative:
    """First derivative of a sampled signal, and what the filter does to white noise.

    `value`, `rate` (n,): smoothed signal and its derivative; `rate_gain` (n,): standard deviation of the rate per
    unit of white noise, 1/s; `value_gain` the same of the value; `interior` (n,): where the filter is centred, so that
    `noise_correlation` (2 half_width + 1,) holds; `bias_share`: estimated share of bias in the mean-square error.
    """

    value: ComplexArray
    rate: ComplexArray
    value_gain: FloatArray
    rate_gain: FloatArray
    interior: BoolArray
    order: int
    half_width: int
    noise_correlation: FloatArray
    bias_share: float


def differentiate(
    signal: ComplexArray, step: float, sigma: float, segments: tuple[tuple[int, int], ...]
) -> Derivative:
    """Derivative of `signal` (n,), each part of which carries white noise of `sigma`, sampled each `step` s.

    Order and width are those of the least mean-square error of the derivative. Its bias is judged, without bias,
    by comparison with a filter too narrow to have any (Stein's unbiased risk; Efron, JASA 99:619, 2004).
    Each segment [start, stop) is filtered by itself; its ends by the outermost polynomial.
    """
    pieces = [signal[a:b] for a, b in segments]
    order, half_width, bias_share = _best_filter(pieces, step, sigma)
    n = signal.size
    value, rate = signal.astype(complex), np.zeros(n, dtype=complex)
    value_gain, rate_gain, interior = np.ones(n), np.full(n, np.inf), np.zeros(n, dtype=bool)
    for (a, b), piece in zip(segments, pieces, strict=True):
        if b - a < 2 * half_width + 1:
            continue
        value[a:b], rate[a:b], value_gain[a:b], rate_gain[a:b] = _filter(piece, order, half_width, step)
        interior[a + half_width : b - half_width] = True
    weights = _weights(order, half_width, half_width)[1]
    correlation = np.correlate(weights, weights, "full")[2 * half_width :]
    return Derivative(
        value, rate, value_gain, rate_gain, interior, order, half_width, correlation / correlation[0], bias_share
    )


def _weights(order: int, half_width: int, at: int) -> tuple[FloatArray, FloatArray]:
    """Filter weights (2 half_width + 1,) for value and derivative per sample, at index `at` of the window.

    The polynomials are Legendre's: raw powers lose all digits on wide windows.
    """
    centred = np.arange(-half_width, half_width + 1) / half_width
    orthogonal, triangle = np.linalg.qr(legvander(centred, order))
    slopes = legval(centred[at], legder(np.eye(order + 1)))
    coefficients = np.linalg.solve(triangle.T, np.column_stack([legvander(centred[at], order).ravel(), slopes]))
    value, derivative = (orthogonal @ coefficients).T
    return value, derivative / half_width


def _centred(piece: ComplexArray, order: int, half_width: int) -> ComplexArray:
    """Derivative per sample where the window fits: (n - 2 half_width,)."""
    return np.asarray(np.correlate(piece, _weights(order, half_width, half_width)[1], "valid"))


def _filter(
    piece: ComplexArray, order: int, half_width: int, step: float
) -> tuple[ComplexArray, ComplexArray, FloatArray, FloatArray]:
    n, m = piece.size, half_width
    value, rate = np.empty(n, dtype=complex), np.empty(n, dtype=complex)
    value_gain, rate_gain = np.empty(n), np.empty(n)
    smooth, slope = _weights(order, m, m)
    inner = slice(m, n - m)
    value[inner], rate[inner] = np.correlate(piece, smooth, "valid"), np.correlate(piece, slope, "valid")
    value_gain[inner], rate_gain[inner] = np.linalg.norm(smooth), np.linalg.norm(slope)
    for at in range(m):
        for index, window, place in ((at, piece[: 2 * m + 1], at), (n - 1 - at, piece[-2 * m - 1 :], 2 * m - at)):
            smooth, slope = _weights(order, m, place)
            value[index], rate[index] = smooth @ window, slope @ window
            value_gain[index], rate_gain[index] = np.linalg.norm(smooth), np.linalg.norm(slope)
    return value, rate / step, value_gain, rate_gain / step


def _best_filter(pieces: list[ComplexArray], step: float, sigma: float) -> tuple[int, int, float]:
    """Order, half-width and share of bias of the filter of least estimated mean-square error."""
    longest = max(piece.size for piece in pieces)
    reference_order = next((k for k in reversed(_ORDERS) if 2 * _MINIMUM_HALF_WIDTH[k] + 1 <= longest), 2)
    reference_width = _MINIMUM_HALF_WIDTH[reference_order]
    reference_weights = _weights(reference_order, reference_width, reference_width)[1]
    references = [_centred(piece, reference_order, reference_width) for piece in pieces
                  if piece.size > 2 * reference_width]
    best = (np.inf, reference_order, reference_width, 0.0)
    for order in _ORDERS:
        for half_width in _half_widths(_MINIMUM_HALF_WIDTH[order], longest):
            long_enough = [(piece, ref) for piece, ref in
                           zip([p for p in pieces if p.size > 2 * reference_width], references, strict=True)
                           if piece.size > 2 * max(half_width, reference_width)]
            if not long_enough or order > reference_order:
                continue
            bias = _squared_bias(long_enough, order, half_width, reference_weights, sigma)
            variance = 2.0 * sigma**2 * float(np.sum(_weights(order, half_width, half_width)[1] ** 2))
            error = max(bias, 0.0) + variance
            if error < best[0]:
                best = (error, order, half_width, max(bias, 0.0) / max(error, 1e-300))
    return best[1], best[2], best[3]


def _half_widths(smallest: int, longest: int) -> list[int]:
    """Half-widths in steps of about a quarter, the window at most a fifth of the record."""
    widths, width = [], float(smallest)
    while 2 * int(width) + 1 <= max(longest // 5, 2 * smallest + 1) and 2 * int(width) + 1 <= longest:
        widths.append(int(width))
        width = max(width + 1.0, 1.25 * width)
    return widths


def _squared_bias(
    pieces: list[tuple[ComplexArray, ComplexArray]],
    order: int, half_width: int, reference_weights: FloatArray, sigma: float,
) -> float:
    """Mean squared bias of a filter, as seen against the reference; unbiased, so it may be below zero."""
    reference_width = reference_weights.size // 2
    weights = _weights(order, half_width, half_width)[1]
    widest = max(half_width, reference_width)
    difference = np.pad(weights, widest - half_width) - np.pad(reference_weights, widest - reference_width)
    total, count = 0.0, 0
    for piece, reference in pieces:
        ours = _centred(piece, order, half_width)
        trim_ours, trim_reference = widest - half_width, widest - reference_width
        gap = ours[trim_ours : ours.size - trim_ours] - reference[trim_reference : reference.size - trim_reference]
        total += float(np.sum(np.abs(gap) ** 2))
        count += gap.size
    return total / count - 2.0 * sigma**2 * float(np.sum(difference**2))
