"""`find`: tests of a residual: whiteness, size, where it is largest, its frequency."""

from __future__ import annotations

import numpy as np
from scipy import stats
from statsmodels.stats.diagnostic import acorr_ljungbox

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.constants import (
    REPORTED_FREQUENCY_LINES,
    REPORTED_FREQUENCY_WITHIN,
    REPORTED_REGION_SHARE,
    REPORTED_REGIONS,
    WHITE_CHANCE,
    WHITE_LAGS,
)
from brv_hypo.motion.kinematics import plane_from_body
from brv_hypo.motion.motion import Motion
from brv_hypo.regression.frame import remove_levels
from brv_hypo.regression.uncertainty import ResidualMoments
from brv_hypo.regression.whitening import white
from brv_hypo.residuals.candidates_at_step import Analysis
from brv_hypo.residuals.linearisation import Corrected
from brv_hypo.residuals.problem import left_by
from brv_hypo.residuals.result import Residual
from brv_hypo.thresholds import NOISE_EXCESS


def find(analysis: Analysis, left: ResidualMoments) -> Residual:
    """Test what the model of `analysis` leaves; `left` are its residual moments. White is only what is no larger than
    noise.

    Of several flights, size and place are told of the one where most is left against its noise.
    """
    several = len(analysis.data.records) > 1
    number = max(range(len(analysis.data.records)), key=lambda k: _noise_ratio(analysis.data, left, k))
    rows, samples = analysis.data.rows_of(number), analysis.data.samples_of(number)
    reconstruction = analysis.data.reconstructions[number]
    motion = reconstruction.motion
    usable = left.usable[rows]
    time = motion.time[samples]
    sigma = left.noise[rows]
    body = np.where(usable, left.body[rows], 0.0)
    p_value, size = _whiteness(analysis), _noise_ratio(analysis.data, left, number)
    channels = _channels(body, motion.windward_meridian[samples])
    worst = max(channels, key=lambda name: _excess(channels[name][usable], sigma[usable]))
    frequency = _dominant(body, usable, float(np.median(np.diff(time))))
    return Residual(
        flight=number if several else None,
        rms=float(np.sqrt(np.mean(np.abs(body[usable]) ** 2) / 2.0)),
        white=p_value > WHITE_CHANCE and size < NOISE_EXCESS,
        p_value=p_value,
        noise_ratio=size,
        worst_channel=worst,
        worst_region_s=_worst_region(time, _by_region(time, body, usable)),
        dominant_frequency_hz=frequency,
        dominant_frequency_is=_name_frequency(motion, frequency),
    )


def _noise_ratio(data: Corrected, left: ResidualMoments, number: int) -> float:
    """Mean square of what is left on one flight over that of its noise."""
    rows = data.rows_of(number)
    usable = left.usable[rows]
    body, sigma = left.body[rows][usable], left.noise[rows][usable]
    return _excess(np.concatenate([body.real, body.imag]), np.tile(sigma, 2)) if body.size else 0.0


def _whiteness(analysis: Analysis) -> float:
    """Of the rates' residual: the smaller p-value of Ljung-Box and of its size against the gyros' noise, doubled."""
    fitted = analysis.data.fitted
    left = left_by(analysis.problem, analysis.null).rates[fitted.rows]
    pieces = remove_levels(left, fitted.pieces, white())
    flights = analysis.data.frame.flight_of_row[fitted.rows]
    sigmas = [analysis.data.records[int(flights[a])].gyro_sigma for a, _ in fitted.pieces]
    parts = [
        channel / sigma for piece, sigma in zip(pieces, sigmas, strict=True) for channel in (piece.real, piece.imag)
    ]
    chances = [
        float(acorr_ljungbox(part, lags=[min(WHITE_LAGS, part.size // 4)])["lb_pvalue"].iloc[0]) for part in parts
    ]
    together = float(stats.combine_pvalues(np.clip(chances, 1e-300, 1.0)).pvalue)
    total = sum(float(part @ part) for part in parts)
    free = sum(part.size - 1 for part in parts)
    # The noise level is itself estimated, to about one part in the root of the samples.
    spread = np.sqrt(2.0 * free) * np.sqrt(3.0)
    return min(1.0, 2.0 * min(together, float(stats.norm.sf((total - free) / spread))))


def _channels(body: ComplexArray, meridian: FloatArray) -> dict[str, FloatArray]:
    """The residual by pitch and yaw, and in and out of plane."""
    plane = plane_from_body(body, meridian)
    return {"C_m": body.real, "C_n": body.imag, "C_m,in": plane.real, "C_n,side": plane.imag}


def _excess(values: FloatArray, sigma: FloatArray) -> float:
    return float(np.mean(values**2) / np.mean(sigma**2))


def _by_region(time: FloatArray, body: ComplexArray, usable: BoolArray) -> FloatArray:
    """Mean square in each sixteenth of the record."""
    which = np.clip(((time - time[0]) / (time[-1] - time[0]) * REPORTED_REGIONS).astype(int), 0, REPORTED_REGIONS - 1)
    return np.array(
        [
            np.mean(np.abs(body[inside]) ** 2) if (inside := (which == k) & usable).any() else 0.0
            for k in range(REPORTED_REGIONS)
        ]
    )


def _worst_region(time: FloatArray, size: FloatArray) -> tuple[float, float]:
    """The stretch around the largest of the regions' sizes in which they stay above that share of it."""
    edges = np.linspace(time[0], time[-1], REPORTED_REGIONS + 1)
    worst = int(np.argmax(size))
    first = last = worst
    while first > 0 and size[first - 1] > REPORTED_REGION_SHARE * size[worst]:
        first -= 1
    while last < REPORTED_REGIONS - 1 and size[last + 1] > REPORTED_REGION_SHARE * size[worst]:
        last += 1
    return float(edges[first]), float(edges[last + 1])


def _dominant(body: ComplexArray, usable: BoolArray, step: float) -> float:
    """Frequency (Hz) of the largest line in the residual; negative where it turns from z to y."""
    values = body[usable] - body[usable].mean()
    spectrum = np.abs(np.fft.fft(values * np.hanning(values.size)))
    return float(np.fft.fftfreq(values.size, step)[int(np.argmax(spectrum))])


def _name_frequency(motion: Motion, frequency: float) -> str:
    """What the frequency is near: a small multiple of the roll rate or of the meridian's."""
    resolution = REPORTED_FREQUENCY_LINES / float(motion.time[-1] - motion.time[0])
    rates = {
        "roll rate": float(np.mean(motion.p)),
        "windward-meridian rate": float(np.mean(motion.windward_meridian_rate)),
    }
    found = [
        (abs(abs(frequency) - multiple * abs(rate) / (2.0 * np.pi)), f"{multiple} x {name}" if multiple > 1 else name)
        for name, rate in rates.items()
        for multiple in (1, 2, 3)
    ]
    away, name = min(found)
    near = away < max(resolution, REPORTED_FREQUENCY_WITHIN * abs(frequency))
    return name if near else "not a multiple of the roll or meridian rate"
