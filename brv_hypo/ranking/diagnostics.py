"""What the leader says beside its coefficients: errors, collinearity, residual, the static moment as a function."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.inference.evidence import Evidence
from brv_hypo.mechanisms.contract import MomentProcess, rms_of_shapes
from brv_hypo.mechanisms.registry import moment_processes
from brv_hypo.model.term import Theta
from brv_hypo.motion.interpolation import time_splines
from brv_hypo.motion.motion import Motion
from brv_hypo.ranking.histories import drawn
from brv_hypo.ranking.judgement import Judged
from brv_hypo.ranking.result import Collinearity, Comparison, RecordError, StaticMoment
from brv_hypo.regression.fit import HypothesisFit

_PLACES, _CURVES, _ANGLES = 24, 3, 13
"""Places along a flight at which the static moment is given, those with a curve by alpha, and angles of a curve."""
_STEP = 1e-4  # of the angle of attack, rad: the moment of a power of it is linear over less than 1e-7 of itself
_CHANNELS = ("q", "r", "ay", "az")  # in the order of the rows of a residual


def diagnostics(judged: Judged, found: Comparison) -> dict[str, Any]:
    """Fields of a comparison: what is known of its leader, and how each hypothesis predicts what was held out."""
    own, fit = judged.evidences[judged.leader], judged.fits[judged.leader]
    gains = {each.name: _held_out(judged, k) for k, each in enumerate(judged.fits)}
    ranking = tuple(row.model_copy(update=gains[row.mechanism]) for row in found.ranking)
    series = tuple(each.model_copy(update=_channels(judged, flight)) for flight, each in enumerate(found.series))
    return {
        "ranking": ranking,
        "record_errors": record_errors(own),
        "collinearity": collinearity(fit),
        "static_moment": tuple(_static(own, fit, *each) for each in enumerate(own.rows.frame.motions)),
        "series": series,
    }


def _held_out(judged: Judged, place: int) -> dict[str, float]:
    """The gain over the baseline only on stretches of time given the others, and its standard error over these."""
    gains = judged.weight * (judged.evidences[place].held_out - judged.evidences[judged.null].held_out)
    error = float(np.sqrt(gains.size * np.var(gains, ddof=1))) if gains.size > 1 else float("nan")
    return {"held_out_gain": float(np.sum(gains)), "held_out_gain_std_error": error}


def record_errors(own: Evidence) -> tuple[RecordError, ...]:
    """Errors within stated tolerances, the largest in tolerances first."""
    items, values, sigmas = own.rows.problem.rows.nuisances.items, own.errors, own.error_sigmas
    several = len(own.rows.blocks) > 1
    found = [
        RecordError(
            name=items[k].plain_label,
            flight=items[k].flight if several else None,
            value=items[k].whole(float(values[k])),
            std_error=float(items[k].size * sigmas[k]),
            units=items[k].units,
            tolerance=items[k].size,
        )
        for block in own.rows.blocks
        for k in block.items
        if items[k].stated
    ]
    return tuple(sorted(found, key=lambda each: -abs(each.tolerances)))


def collinearity(fit: HypothesisFit) -> tuple[Collinearity, ...]:
    """Variance inflation of every coefficient (Belsley, Kuh and Welsch, Regression Diagnostics, 1980, 3.2)."""
    sigma = np.sqrt(np.maximum(np.diag(fit.covariance), 1e-300))
    correlation = fit.covariance / np.outer(sigma, sigma)
    inflation = np.diag(np.linalg.pinv(correlation, hermitian=True))
    others = correlation - np.diag(np.diag(correlation))
    closest = np.argmax(np.abs(others), axis=1).tolist()
    labels = [
        c.label if c.time_basis.kind == "constant" else f"{c.label} at {c.time_basis.start:.2f} s" for c in fit.columns
    ]
    return tuple(
        Collinearity(
            term=labels[j], variance_inflation=float(inflation[j]), other=labels[k], correlation=float(others[j, k])
        )
        for j, k in enumerate(closest)
    )


def _channels(judged: Judged, flight: int) -> dict[str, Any]:
    """Histories of one flight for `Series`: measured and modelled rates and forces, and the residual at unit noise."""
    own, fit, problem = judged.evidences[judged.leader], judged.fits[judged.leader], judged.problem
    frame, rest = problem.frame, problem.left(fit.frame, fit.columns, *problem.solution(fit.frame, fit.columns))
    found: list[FloatArray] = []  # a segment each: dynamic pressure, then every channel as measured and as modelled
    for segment, (a, b) in zip(frame.segments, frame.pieces, strict=True):
        if segment.flight == flight:
            turn = np.exp(-1j * problem.records[flight].spin_angle[segment.rows])
            rates, force = frame.observed[a:b] * turn, problem.force[a:b]
            modelled = (rates - (rest.rates[a:b] - np.mean(rest.rates[a:b])) * turn, force - rest.force[a:b])
            pairs = zip((rates, force), modelled, strict=True)
            parts = [part(each) for pair in pairs for part in (np.real, np.imag) for each in pair]
            pressure = frame.motions[flight].dynamic_pressure[segment.rows]
            found.append(np.stack([pressure, *parts])[:, drawn(b - a)])
    air, *histories = (tuple(each) for each in np.concatenate(found, axis=1).tolist())
    rows = own.rows.blocks[flight].rows
    residual, counted = ((each[rows]).reshape(len(_CHANNELS), -1) for each in (own.residual, own.rows.counted))
    residual = residual[:, counted[0]] / own.noise
    return {
        "dynamic_pressure_pa": air,
        "channels": dict(zip(_CHANNELS, zip(histories[::2], histories[1::2], strict=True), strict=True)),
        "whitened": dict(zip(_CHANNELS, map(tuple, residual.tolist()), strict=True)),
    }


def _stiffness(own: Evidence) -> dict[int, MomentProcess]:
    """The processes of the static moment, by their place among all."""
    known = {each.name: each for each in moment_processes() if each.family == "stiffness"}
    return {k: known[group.name] for k, group in enumerate(own.rows.groups) if group.name in known}


def _in_plane(own: Evidence, fit: HypothesisFit, flight: int, angle: float) -> list[FloatArray]:
    """C_m,in (n, columns) at one angle of attack (rad): per coefficient, per tolerance of what all flights share, and
    per spline of each process of the static moment.
    """
    frame, nuisances = own.rows.frame_of(fit), own.rows.problem.rows.nuisances
    flown = frame.motions[flight]
    time, still = flown.time, np.zeros_like(flown.alpha)
    motion = replace(flown, alpha=still + angle, alpha_rate=still, q=still, r=still, history=None)
    values = np.zeros((time.size, own.values.size))

    def made(name: str, term: str, theta: Theta = ()) -> FloatArray | float:
        mechanism = frame.mechanisms.get(name)
        if mechanism is None or mechanism.parameters():
            return 0.0
        acting = next(each for each in mechanism.terms(motion, dict(theta)) if each.name == term)
        return 0.0 if np.any(acting.out_of_plane) else acting.in_plane

    for j, column in enumerate(fit.columns):
        if column.acts_on(flight):
            basis = column.time_basis(motion.coefficient_time)
            values[:, j] = made(column.mechanism, column.term, column.theta) * basis
    shared = [nuisances.items[k] for k in nuisances.bounded.tolist() if nuisances.items[k].flight is None]
    allowed = np.zeros((time.size, len(shared)))
    for j, item in enumerate(shared):
        allowed[:, j] = item.size * made(item.name, item.component)
    splines = []
    for process in _stiffness(own).values():
        histories = time_splines(time, float(time[0]), float(time[-1]), process.splines)
        unit = rms_of_shapes(process, flown)
        splines.append(np.hstack([shape.real[:, np.newaxis] * histories / unit for shape in process.shapes(motion)]))
    return [values, allowed, *splines]


def _static(own: Evidence, fit: HypothesisFit, flight: int, motion: Motion) -> StaticMoment:
    """What terms in the plane of alpha without a delay, and processes of the stiffness, make of C_m,in at rest."""
    stretches = np.array_split(np.arange(motion.time.size), _PLACES)
    places = np.array([stretch[stretch.size // 2] for stretch in stretches if stretch.size])
    chosen = np.unique(np.linspace(0, places.size - 1, 2 * _CURVES + 1).round().astype(int)[1::2])

    def at(*weighted: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
        """The sum of the function at angles of attack (rad), each times its weight, and its standard errors."""
        parts = [[weight * each for each in _in_plane(own, fit, flight, angle)] for weight, angle in weighted]
        values, allowed, *splines = (np.sum(each, axis=0)[places] for each in zip(*parts, strict=True))
        return own.along(flight, values, dict(zip(_stiffness(own), splines, strict=True)), allowed)

    zero, slope = at((1.0, 0.0)), at((1.0 / _STEP, _STEP), (-1.0 / _STEP, 0.0))
    angles = np.linspace(0.0, float(np.max(motion.alpha)), _ANGLES)
    curves = np.array([at((1.0, float(angle))) for angle in angles])[:, :, chosen]
    return StaticMoment(
        flight=flight,
        time_s=tuple(motion.time[places].tolist()),
        mach=tuple(motion.mach[places].tolist()),
        c_m0=tuple(zero[0].tolist()),
        c_m0_std_error=tuple(zero[1].tolist()),
        c_malpha=tuple(slope[0].tolist()),
        c_malpha_std_error=tuple(slope[1].tolist()),
        alpha_rad=tuple(angles.tolist()),
        curves_at=tuple(chosen.tolist()),
        curves=tuple(tuple(each) for each in curves[:, 0].T.tolist()),
        curves_std_error=tuple(tuple(each) for each in curves[:, 1].T.tolist()),
    )
