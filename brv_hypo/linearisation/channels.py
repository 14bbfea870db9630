"""The two channels that a residual has, the rates of Eq. 2.3 and the specific force across the axis, and their noise.

Moments show in the rates. Instruments and wind show in both, so both are regressed together; each is divided by its
noise. `ForceModel` is the normal force that a hypothesis is fitted with.

Residuals of gyro rates are white gyro noise plus a red part, from what the reconstruction of the motion leaves. An
autoregressive model fitted to them gives the prediction-error filter; applied to data and columns alike, it turns
generalised into ordinary least squares, so that F-values mean what they say. The first rows of a segment use the
predictors of lower order (Durbin-Levinson), so that the whitening is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.linalg import solve_toeplitz

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from brv_hypo.flight.clock import runs
from brv_hypo.linearisation.frame import Piece, RateFrame
from brv_hypo.linearisation.linear import solve_scaled
from brv_hypo.model.term import Regressor
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.interpolation import applied
from brv_hypo.motion.motion import effective
from brv_hypo.motion.signals import ColouredNoise, inverse_spectrum

DECIDING_OF, DECIDING_BLOCK = 4, 3  # blocks, of which one decides what is added, and which
REPORTED_OF, REPORTED_BLOCK = 8, 5  # blocks, of which one takes no part in any choice, and which
HELD_OUT_SHORTEST = 8  # rows of a stretch that is fitted or held out
# Held by `tests.studies.independent.study --coloured` and `tests/studies/independent/test_coloured_noise.py`.
NOISE_ORDER = 12  # largest of an autoregression
NOISE_SAMPLES_PER_ORDER = 20  # of the residuals
NOISE_STRETCHES = 16  # of time, that the spectrum is the median of
NOISE_SHORTEST_STRETCH = 32  # samples
NOISE_LONGEST_STRETCH = 256  # samples: the spectrum's lines are a 256th of the sample rate apart
NOISE_LEAKS = 2.0  # lines over which one of them leaks under a Hann window: half its main lobe
NOISE_COLOURS = np.linspace(0.0, 0.98, 99)  # correlations of neighbouring samples that are tried
NOISE_ALLOWED_FALL = 1.0  # of 2 ln L, that a correlation found elsewhere may bring: one sigma
NOISE_CORRELATED = 2.0  # sigmas of a correlation below which samples count as independent from there on
NOISE_MOST_LAG = 50  # samples to which that is looked for
# What a median knows of an exponential distribution's mean, over what all values know: ln(2)^2.
MEDIAN_EFFICIENCY = 0.48


@dataclass(frozen=True)
class NoiseModel:
    """Predictors of every order: `filters[k]` (k + 1,) is the prediction-error filter of order k, scaled to the
    innovation of the last one, whose standard deviation is `sigma`, rad/s.
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


def fit_noise(residuals: Sequence[ComplexArray], fitted: FloatArray | None = None) -> NoiseModel:
    """The autoregression of the residuals, one (m,) array a segment, its order chosen by BIC. Real and imaginary parts
    share one model (the two transverse gyros are alike). Yule-Walker on the autocovariance that
    `lasting_autocovariance` gives, which keeps the filter stable. `fitted` (NOISE_ORDER + 1,) is what the fit explains
    of white noise's autocorrelation (`fitted_by`): many fitted columns would pose as colour.
    """
    total = sum(part.size for part in residuals)
    top = int(min(NOISE_ORDER, max(1, total // NOISE_SAMPLES_PER_ORDER)))
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
    """Autocovariance (lags + 1,) of one component of what lasts through the residuals, one (m,) array a segment. From
    the median over short stretches of time of their spectra (Allen et al. 2012, FINDCHIRP, Appendix B), positive and
    negative frequencies together: a moment that nothing explains acts for some of the time, at the frequency of the
    motion and of one sense of turning, and is no noise.
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
        shapes = inverse_spectrum(NOISE_COLOURS[:, np.newaxis], frequency[noisy])
        levels = np.mean(lasting[noisy] * shapes, axis=1)
        return levels, values * np.mean(noisy) * (np.log(levels) - np.mean(np.log(shapes), axis=1))

    levels, fall = colours_from(above + NOISE_LEAKS * line)
    allowed = np.flatnonzero(fall <= np.min(fall) + NOISE_ALLOWED_FALL)
    shown = int(np.argmin(colours_from(motion + NOISE_LEAKS * line)[1]))
    chosen = int(np.clip(shown, allowed[0], allowed[-1]))
    return ColouredNoise(float(np.sqrt(0.5 * levels[chosen])), float(NOISE_COLOURS[chosen]))


def _lasting_spectrum(residuals: Sequence[ComplexArray]) -> FloatArray:
    """Median power over stretches of time (frequencies,), positive and negative frequencies alike, of both parts."""
    total = sum(part.size for part in residuals)
    wanted = np.clip(total / NOISE_STRETCHES, NOISE_SHORTEST_STRETCH, NOISE_LONGEST_STRETCH)
    length = min(int(2 ** np.round(np.log2(wanted))), max(part.size for part in residuals))
    window, spectra = np.hanning(length + 2)[1:-1], []
    window /= np.sqrt(np.sum(window**2))
    for part in (each for each in residuals if each.size >= length):  # stretches that overlap by half
        stretches = np.lib.stride_tricks.sliding_window_view(part, length)[:: max(length // 2, 1)]
        spectra.append(np.abs(np.fft.fft(stretches * window, axis=1)) ** 2)
    power = np.concatenate(spectra)
    power = np.concatenate([power, np.roll(power[:, ::-1], 1, axis=1)])
    count = power.shape[0]
    odd = 2.0 * np.arange(1, (count - 1) // 2 + 1)
    bias = 1.0 + float(np.sum(1.0 / (odd + 1.0) - 1.0 / odd))
    return np.asarray(np.median(power, axis=0) / bias, dtype=float)


def fitted_by(basis: FloatArray, pieces: Sequence[tuple[int, int]], rows: int) -> FloatArray:
    """Autocorrelation (NOISE_ORDER + 1,) of white noise that a fit takes out of a complex history of `rows` rows.
    `basis` (2 rows, columns) is orthonormal, real rows before imaginary: the covariance is I - basis basis'.
    """
    out = np.zeros(NOISE_ORDER + 1)
    for part in (basis[:rows], basis[rows : 2 * rows]):
        for a, b in pieces:
            for lag in range(min(NOISE_ORDER, b - a - 1) + 1):
                out[lag] += float(np.vdot(part[a : b - lag], part[a + lag : b]))
    return out / (2.0 * rows)


def effective_samples(innovations: list[FloatArray]) -> float:
    """Effective number of independent samples of whitened residuals, one (m,) array a segment and channel. n / (1 + 2
    sum rho_k), summed to the first lag within its own noise (Bayley and Hammersley 1946); at most n.
    """
    n = sum(part.size for part in innovations)
    power = sum(float(part @ part) for part in innovations)
    if power == 0.0:
        return float(n)
    inflation = 1.0
    for lag in range(1, NOISE_MOST_LAG + 1):
        rho = sum(float(part[:-lag] @ part[lag:]) for part in innovations if part.size > lag) / power
        if abs(rho) < NOISE_CORRELATED / np.sqrt(n):
            break
        inflation += 2.0 * rho
    return float(n / max(inflation, 1.0))


# ---- Histories in both channels, and parts of a record ----


@dataclass(frozen=True)
class Lasting:
    """Noise of rates and force as it is beyond the motion, and the motion's frequency, rad a sample."""

    rates: ColouredNoise
    force: ColouredNoise
    motion: float


@dataclass(frozen=True)
class Noise:
    """Noise models of the two channels: rates (rad/s) and force (m/s^2). `thinning`: whitened rows that are averaged
    into one, for the columns are slow and the noise is white. `lasting` is None where the noise was not measured.
    """

    rates: NoiseModel
    force: NoiseModel
    thinning: int = 1
    lasting: Lasting | None = None


@dataclass(frozen=True)
class Channels:
    """One history in both channels (rows,) or (rows, columns): derolled rates rad/s, transverse force m/s^2."""

    rates: ComplexArray
    force: ComplexArray

    def __sub__(self, other: Channels) -> Channels:
        return Channels(self.rates - other.rates, self.force - other.force)

    def times(self, factor: float) -> Channels:
        """The history `factor` times as large."""
        return Channels(factor * self.rates, factor * self.force)

    def at(self, samples: IntArray | slice) -> Channels:
        """The rows of these samples."""
        return Channels(self.rates[samples], self.force[samples])

    def of(self, chosen: IntArray | BoolArray | slice) -> Channels:
        """Some of the columns."""
        return Channels(self.rates[:, chosen], self.force[:, chosen])


@dataclass(frozen=True)
class Part:
    """Some stretches of the flights of a frame. `rows` are indices into the frame's rows, `valid` where the force may
    be used. `pieces` are the ranges that are contiguous in time, `flights` which flight each is of; `levels`: ranges
    that share a constant of integration.
    """

    rows: IntArray
    valid: BoolArray
    pieces: tuple[Piece, ...]
    levels: tuple[Piece, ...]
    flights: tuple[int, ...]

    def of_flight(self, flight: int) -> Part:
        """What of it is of one flight."""
        own = [piece for piece, number in zip(self.pieces, self.flights, strict=True) if number == flight]
        first, last = (own[0][0], own[-1][1]) if own else (0, 0)
        pieces, levels = (
            tuple((a - first, b - first) for a, b in each if first <= a and b <= last) for each in (own, self.levels)
        )
        mine = slice(first, last)
        return Part(self.rows[mine], self.valid[mine], pieces, levels, (flight,) * len(pieces))

    def constants(self) -> ComplexArray:
        """The constants of integration as histories of the rates (rows, 2 levels)."""
        out = np.zeros((self.rows.size, 2 * len(self.levels)), dtype=complex)
        for k, (a, b) in enumerate(self.levels):
            out[a:b, 2 * k], out[a:b, 2 * k + 1] = 1.0, 1j
        return out

    def thinned_pieces(self, noise: Noise) -> tuple[Piece, ...]:
        """Row range of each stretch of time among the thinned rows of one channel."""
        sizes = [len(range(a, b, noise.thinning)) for a, b in self.pieces]
        ends = np.cumsum(sizes)
        return tuple((int(end) - size, int(end)) for end, size in zip(ends, sizes, strict=True))

    def thinned_rows(self, noise: Noise) -> int:
        """Thinned rows of one channel."""
        return self.thinned_pieces(noise)[-1][1] if self.pieces else 0


@dataclass(frozen=True)
class Whitening:
    """Filter, unit noise and thinning of a part's two channels, each as one banded operator."""

    part: Part
    noise: Noise

    def rates(self, rates: ComplexArray) -> FloatArray:
        """The rates (rows, columns), filtered, at unit noise (2 thinned rows, columns); real before imaginary."""
        return _white(self._operators[0], rates)

    def both(self, rows: Channels) -> FloatArray:
        """Both channels: (4 thinned rows, columns), rates first, then force."""
        usable = rows.force * self.part.valid[:, np.newaxis]
        return np.concatenate([self.rates(rows.rates), _white(self._operators[1], usable)])

    @cached_property
    def _operators(self) -> list[sparse.csr_array]:
        """Of rates and force: filter and sums of neighbours over the root of their number, within each stretch."""
        found = []
        for model in (self.noise.rates, self.noise.force):
            blocks = []
            for a, b in self.part.pieces:
                starts = np.append(np.arange(0, b - a, self.noise.thinning), b - a)
                sizes = np.diff(starts)
                sums = sparse.csr_array((np.repeat(1.0 / np.sqrt(sizes), sizes), np.arange(b - a), starts))
                blocks.append(sums @ (model.operator(b - a) / model.sigma))
            found.append(sparse.csr_array(sparse.block_diag(blocks, format="csr")))
        return found


def _white(operator: sparse.csr_array, rows: ComplexArray) -> FloatArray:
    white = applied(operator, rows)
    return np.concatenate([white.real, white.imag])


def first_values(frame: RateFrame, part: Part, columns: Sequence[Regressor]) -> FloatArray:
    """Coefficients (columns,) of moments on a part by plain least squares of the rates' differences."""
    whitening = Whitening(part, Noise(difference(), difference()))
    design = whitening.rates(np.column_stack([frame.columns(columns)[part.rows], part.constants()]))
    return solve_scaled(design, whitening.rates(frame.observed[part.rows, np.newaxis])[:, 0])[: len(columns)]


def side_by_side(rows: Sequence[Channels]) -> Channels:
    """Histories, or columns of them, as columns."""
    return Channels(np.column_stack([r.rates for r in rows]), np.column_stack([r.force for r in rows]))


def whole(frame: RateFrame, valid: BoolArray) -> Part:
    """All rows of a frame; `valid` (rows,) where the force may be used."""
    return part(frame, valid, np.ones(frame.observed.size, dtype=bool), shared=True)


def split(frame: RateFrame, valid: BoolArray, blocks: int) -> tuple[Part, Part, Part]:
    """The part that is fitted, and of `blocks` even stretches of each flight every fourth, by which it is decided what
    is added, and every eighth, midway between two of these, which takes no part in any choice. The rates on both sides
    of a held-out stretch share a constant of integration: what the model says of the moments between counts, the
    samples between are not. Held-out stretches have a constant each.
    """
    number = np.zeros(frame.observed.size, dtype=int)
    for flight in range(len(frame.reconstructions)):
        own = frame.flight_of_row == flight
        time = frame.time[own]
        if time.size:
            edges = np.linspace(time.min(), time.max(), blocks + 1)
            number[own] = np.searchsorted(edges, time, side="right").clip(1, blocks)
    deciding, reported = number % DECIDING_OF == DECIDING_BLOCK, number % REPORTED_OF == REPORTED_BLOCK
    fitted = part(frame, valid, ~(deciding | reported), shared=True)
    return fitted, part(frame, valid, deciding, shared=False), part(frame, valid, reported, shared=False)


def part(frame: RateFrame, valid: BoolArray, chosen: BoolArray, *, shared: bool) -> Part:
    """The part whose rows are chosen, short stretches left out; `shared`: one constant of integration a segment."""
    rows: list[IntArray] = []
    pieces: list[Piece] = []
    levels: list[Piece] = []
    flights: list[int] = []
    size = 0
    for segment, (first, last) in zip(frame.segments, frame.pieces, strict=True):
        begin = size
        for a, b in (run for run in runs(chosen[first:last]) if run[1] - run[0] >= HELD_OUT_SHORTEST):
            rows.append(np.arange(first + a, first + b))
            pieces.append((size, size + b - a))
            flights.append(segment.flight)
            size += b - a
        if size > begin:
            levels.append((begin, size))
    indices = np.concatenate(rows)
    ends = (tuple(pieces), tuple(levels if shared else pieces), tuple(flights))
    return Part(indices, valid[indices], *ends)


@dataclass(frozen=True)
class ForceModel:
    """The normal force: f_y + i f_z = sum of coefficients times columns (CONVENTIONS, normal force). The
    reconstruction's `slope` (n,) 1/rad at alpha = 0 and its `bend` 1/rad^3, with a parabola in time for their errors.
    """

    slope: FloatArray
    bend: float = 0.0

    @cached_property
    def _parabola(self) -> FloatArray:
        return np.vander(np.linspace(-1.0, 1.0, self.slope.size), 3, increasing=True)

    def columns(self, record: InertialRecord, xi: ComplexArray) -> ComplexArray:
        """Columns (n, 4) at the crossflow xi (n,)."""
        return np.stack([self.at(record.force_scale, xi, each) for each in np.eye(4)], axis=1)

    def at(self, scale: FloatArray, xi: ComplexArray, values: FloatArray) -> ComplexArray:
        """The force (n, ...) m/s^2 with these coefficients (4,) at crossflows xi (n, ...), q_inf S / m = `scale`."""
        own, parabola = effective(xi).T, self._parabola @ values[:3]
        slope = parabola * self.slope + (parabola * self.bend + values[3] * self.slope) * np.abs(own) ** 2
        return np.asarray(-scale * (own * slope).T)
