"""The noise of the rate equation, and the filter that makes it white.

Residuals of gyro rates are white gyro noise plus a red part, from what the reconstruction of the motion
leaves. An autoregressive model fitted to them gives the prediction-error filter; applied to data and columns
alike, it turns generalised into ordinary least squares, so that F-values mean what they say. The first rows
of a segment use the predictors of lower order (Durbin-Levinson), so that the whitening is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.linalg import solve_toeplitz

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.motion.signals import ColouredNoise, inverse_spectrum

# Held by `tests.studies.independent.study --coloured` and `tests/studies/independent/test_coloured_noise.py`.
NOISE_SAMPLES_PER_ORDER = 20  # of the residuals
NOISE_STRETCHES = 16  # of time, that the spectrum is the median of
NOISE_SHORTEST_STRETCH = 32  # samples
NOISE_LONGEST_STRETCH = 256  # samples: the spectrum's lines are a 256th of the sample rate apart
NOISE_LEAKS = 2.0  # lines over which one of them leaks under a Hann window: half its main lobe
NOISE_COLOURS = (0.0, 0.98, 99)  # correlations of neighbouring samples that are tried
NOISE_ALLOWED_FALL = 1.0  # of 2 ln L, that a correlation seen elsewhere may bring: one sigma
NOISE_CORRELATED = 2.0  # sigmas of a correlation below which samples count as independent from there on
NOISE_MOST_LAG = 50  # samples to which that is looked for
# What a median knows of an exponential distribution's mean, over what all values know: ln(2)^2.
MEDIAN_EFFICIENCY = 0.48
# Correlations of neighbouring samples that are tried.
_COLOURS = np.linspace(*NOISE_COLOURS)


@dataclass(frozen=True)
class NoiseModel:
    """Predictors of every order: `filters[k]` (k + 1,) is the scaled prediction-error filter of order k.

    `scales` are their innovation standard deviations relative to the last one, which is `sigma`, rad/s.
    """

    filters: tuple[FloatArray, ...]
    sigma: float

    @property
    def order(self) -> int:
        """Order of the autoregression."""
        return len(self.filters) - 1

    def operator(self, samples: int) -> sparse.csr_array:
        """The filter of a segment of so many samples, banded (samples, samples); the innovation keeps its size."""
        order = min(self.order, samples - 1)
        band = [np.full(samples - lag, weight) for lag, weight in enumerate(self.filters[self.order][: order + 1])]
        for k in range(min(self.order, samples)):
            for lag, weight in enumerate(self.filters[k]):
                band[lag][k - lag] = weight
        return sparse.diags_array(band, offsets=[-lag for lag in range(order + 1)], format="csr")


def white(sigma: float = 1.0) -> NoiseModel:
    """White noise: the filter that changes nothing."""
    return NoiseModel((np.ones(1),), sigma)


def difference() -> NoiseModel:
    """A random walk: the starting point where nothing is known of the noise."""
    return NoiseModel((np.array([1e-3]), np.array([1.0, -1.0])), 1.0)


def fit_noise(residuals: Sequence[ComplexArray], max_order: int = 24, fitted: FloatArray | None = None) -> NoiseModel:
    """The autoregression of the residuals, one (m,) array a segment, its order chosen by BIC.

    Real and imaginary parts share one model (the two transverse gyros are alike). Yule-Walker on the autocovariance
    that `lasting_autocovariance` gives, which keeps the filter stable. `fitted` (max_order + 1,) is what the fit
    explains of white noise's autocorrelation (`fitted_by`): many fitted columns would pose as colour.
    """
    total = sum(part.size for part in residuals)
    top = int(min(max_order, max(1, total // NOISE_SAMPLES_PER_ORDER)))
    covariance = lasting_autocovariance(residuals, top)
    if covariance[0] <= 0.0:
        return white(0.0)
    if fitted is not None:
        covariance += covariance[0] / (1.0 - fitted[0]) * fitted[: top + 1]
    covariance[0] *= 1.0 + 1e-9
    predictors = [solve_toeplitz(covariance[:k], covariance[1 : k + 1]) if k else np.zeros(0) for k in range(top + 1)]
    variances = np.array([covariance[0] - a @ covariance[1 : a.size + 1] for a in predictors])
    variances = np.maximum(variances, 1e-12 * covariance[0])
    values = 2.0 * total * MEDIAN_EFFICIENCY
    bic = values * np.log(variances) + np.arange(top + 1) * np.log(values)
    order = int(np.argmin(bic))
    sigma = float(np.sqrt(variances[order]))
    filters = tuple(np.concatenate(([1.0], -predictors[k])) * sigma / np.sqrt(variances[k]) for k in range(order + 1))
    return NoiseModel(filters, sigma)


def lasting_autocovariance(residuals: Sequence[ComplexArray], lags: int) -> FloatArray:
    """Autocovariance (lags + 1,) of one component of what lasts through the residuals, one (m,) array a segment.

    From the median over short stretches of time of their spectra (Allen et al. 2012, FINDCHIRP, Appendix B), positive
    and negative frequencies together: a moment that nothing explains acts for some of the time, at the frequency of
    the motion and of one sense of turning, and is no noise.
    """
    lasting = _lasting_spectrum(residuals)
    found = np.fft.ifft(lasting).real / 2.0
    return np.asarray(np.concatenate([found, np.zeros(lags)])[: lags + 1], dtype=float)


def lasting_noise(residuals: Sequence[ComplexArray], above: float, motion: float) -> ColouredNoise:
    """The noise of one component of what lasts through the residuals, of the colour that it has beyond the motion.

    `motion`, the motion's frequency, and `above`, from which there is noise alone, in rad a sample. What a fit leaves
    of the motion is in the spectrum too, so that there it is taken for that of a first-order autoregression (Whittle
    1953) whose colour is what all frequencies beyond the motion's show, as far as those `above` alone allow.
    """
    lasting = _lasting_spectrum(residuals)
    line = 2.0 * np.pi / lasting.size
    frequency = np.abs(2.0 * np.pi * np.fft.fftfreq(lasting.size))
    values = MEDIAN_EFFICIENCY * 2.0 * sum(part.size for part in residuals)

    def colours_from(lowest: float) -> tuple[FloatArray, FloatArray]:
        """Level and -2 ln L of each colour, frequencies from this one."""
        noisy = frequency >= min(lowest, 0.5 * np.pi)
        shapes = inverse_spectrum(_COLOURS[:, np.newaxis], frequency[noisy])
        levels = np.mean(lasting[noisy] * shapes, axis=1)
        return levels, values * np.mean(noisy) * (np.log(levels) - np.mean(np.log(shapes), axis=1))

    levels, fall = colours_from(above + NOISE_LEAKS * line)
    allowed = np.flatnonzero(fall <= np.min(fall) + NOISE_ALLOWED_FALL)
    shown = int(np.argmin(colours_from(motion + NOISE_LEAKS * line)[1]))
    chosen = int(np.clip(shown, allowed[0], allowed[-1]))
    return ColouredNoise(float(np.sqrt(0.5 * levels[chosen])), float(_COLOURS[chosen]))


def _lasting_spectrum(residuals: Sequence[ComplexArray]) -> FloatArray:
    """Median power over stretches of time (frequencies,), positive and negative frequencies alike, of both parts."""
    total = sum(part.size for part in residuals)
    wanted = np.clip(total / NOISE_STRETCHES, NOISE_SHORTEST_STRETCH, NOISE_LONGEST_STRETCH)
    length = min(int(2 ** np.round(np.log2(wanted))), max(part.size for part in residuals))
    power = np.concatenate([_spectra(part, length) for part in residuals if part.size >= length])
    power = np.concatenate([power, np.roll(power[:, ::-1], 1, axis=1)])
    count = power.shape[0]
    odd = 2.0 * np.arange(1, (count - 1) // 2 + 1)
    bias = 1.0 + float(np.sum(1.0 / (odd + 1.0) - 1.0 / odd))
    return np.asarray(np.median(power, axis=0) / bias, dtype=float)


def _spectra(part: ComplexArray, length: int) -> FloatArray:
    """Periodograms (stretches, length) of half-overlapping stretches under a Hann window, of unit mean square."""
    window = np.hanning(length + 2)[1:-1]
    window = window / np.sqrt(np.sum(window**2))
    stretches = np.lib.stride_tricks.sliding_window_view(part, length)[:: max(length // 2, 1)]
    return np.asarray(np.abs(np.fft.fft(stretches * window, axis=1)) ** 2, dtype=float)


def fitted_by(basis: FloatArray, pieces: Sequence[tuple[int, int]], rows: int, max_order: int) -> FloatArray:
    """Autocorrelation (max_order + 1,) of white noise that a fit takes out of a complex history of `rows` rows.

    `basis` (2 rows, columns) is orthonormal over all that was fitted, real rows before imaginary: the residual of white
    noise has the covariance I - basis basis'.
    """
    out = np.zeros(max_order + 1)
    for part in (basis[:rows], basis[rows : 2 * rows]):
        for a, b in pieces:
            for lag in range(min(max_order, b - a - 1) + 1):
                out[lag] += float(np.vdot(part[a : b - lag], part[a + lag : b]))
    return out / (2.0 * rows)


def effective_samples(innovations: list[FloatArray], max_lag: int = NOISE_MOST_LAG) -> float:
    """Effective number of independent samples of whitened residuals, one (m,) array a segment and channel.

    n / (1 + 2 sum rho_k), summed to the first lag whose correlation is within its own noise (Bayley and
    Hammersley 1946 with a cut-off); never more than n.
    """
    n = sum(part.size for part in innovations)
    power = sum(float(part @ part) for part in innovations)
    if power == 0.0:
        return float(n)
    inflation = 1.0
    for lag in range(1, max_lag + 1):
        rho = sum(float(part[:-lag] @ part[lag:]) for part in innovations if part.size > lag) / power
        if abs(rho) < NOISE_CORRELATED / np.sqrt(n):
            break
        inflation += 2.0 * rho
    return float(n / max(inflation, 1.0))
