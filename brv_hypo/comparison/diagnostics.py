"""What the leader says beside its coefficients: errors, collinearity, residual, the moment as functions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.comparison.judgement import Judged
from brv_hypo.comparison.result import Comparison, RecordError, SizedModel
from brv_hypo.comparison.summary import drawn
from brv_hypo.inference.derivatives import along_flights, damping, slope, value
from brv_hypo.inference.evidence import Evidence
from brv_hypo.inference.fit import HypothesisFit, likeliest
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.search import on_grid
from brv_hypo.inference.uncertainty import residual_moments
from brv_hypo.mechanisms.contract import Process, rms_of_shapes
from brv_hypo.mechanisms.registry import moment_processes, record_processes
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.motion.interpolation import time_splines
from brv_hypo.motion.motion import plane_from_body
from brv_hypo.subset.criteria import Criteria

_CHANNELS = ("q", "r", "ay", "az")  # in the order of the rows of a residual
_TIMES = 100  # at which histories of processes are evaluated: three for each spline of the fastest
INFLATED, COLLINEAR = 10.0, 0.9  # convention: Belsley, Kuh and Welsch, Regression Diagnostics, 1980, 3.2


def diagnostics(judged: Judged, found: Comparison) -> dict[str, Any]:
    """Fields of a comparison: what is known of its leader, and how each hypothesis predicts what was held out."""
    own, fit = judged.evidences[judged.leader], judged.fits[judged.leader]
    gains = {each.name: _held_out(judged, k) for k, each in enumerate(judged.fits)}
    functions, frame = {"C_m0": value, "C_malpha": slope, "C_mq": damping}, own.rows.frame_of(fit)
    moments = _of_leader(judged) if fit.selected else ()
    return {
        "ranking": tuple(row.model_copy(update=gains[row.mechanism]) for row in found.ranking),
        "record_errors": record_errors(own, judged.weight),
        "collinear": collinear(fit.columns, fit.covariance),
        "functions": {
            name: along_flights(own, fit.columns, frame, by, judged.weight) for name, by in functions.items()
        },
        "series": tuple(each.model_copy(update=_channels(judged, k, moments)) for k, each in enumerate(found.series)),
    }


def _held_out(judged: Judged, place: int) -> dict[str, float]:
    """The gain over the baseline only on stretches of time given the others, and its standard error over these."""
    gains = judged.weight * (judged.evidences[place].held_out - judged.evidences[judged.null].held_out)
    error = float(np.sqrt(gains.size * np.var(gains, ddof=1))) if gains.size > 1 else float("nan")
    return {"held_out_gain": float(np.sum(gains)), "held_out_gain_std_error": error}


def record_errors(own: Evidence, weight: float = 1.0) -> tuple[RecordError, ...]:
    """Errors within stated tolerances, the largest in tolerances first; `weight`: what a nat counts."""
    items, values = own.rows.problem.rows.nuisances.items, own.errors.tolist()
    sigmas = np.minimum(own.error_sigmas / np.sqrt(weight), 1.0).tolist()
    several = len(own.rows.blocks) > 1
    found = [
        RecordError(
            name=items[k].plain_label + (f", flight {flight + 1}" if several else ""),
            value=items[k].whole(values[k]),
            std_error=items[k].size * sigmas[k],
            units=items[k].units,
            tolerance=items[k].size,
        )
        for flight, block in enumerate(own.rows.blocks)
        for k in block.items
        if items[k].stated
    ]
    return tuple(sorted(found, key=lambda each: -abs(each.tolerances)))


def collinear(columns: Sequence[Regressor], covariance: FloatArray) -> tuple[str, ...]:
    """Pairs of coefficients with a correlation above `COLLINEAR`, or one with a variance inflation above `INFLATED`."""
    sigma = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = covariance / np.outer(sigma, sigma)
    inflation = np.diag(np.linalg.pinv(correlation, hermitian=True))
    others = correlation - np.diag(np.diag(correlation))
    starts = [each.time_basis.start for each in columns]
    labels = [
        each.label + (f" at {at:.2f} s" if np.isfinite(at) else "") for each, at in zip(columns, starts, strict=True)
    ]
    pairs = {
        frozenset((j, k)): f"{labels[j]}, {labels[k]}: {others[j, k]:.3f} ({inflation[j]:.3g}, {inflation[k]:.3g})"
        for j, k in enumerate(np.argmax(np.abs(others), axis=1).tolist())
        if inflation[j] > INFLATED or abs(others[j, k]) > COLLINEAR
    }
    return tuple(pairs.values())


def best_by_size(problem: Problem, fits: Sequence[HypothesisFit], none: Criteria) -> tuple[SizedModel, ...]:
    """The best subsets, on the grid of knots and delays, of the likeliest hypothesis that has a mechanism.

    `none`: criteria of the baseline alone, by which C_p has its variance.
    """
    searched = [fit for fit in fits if fit.mechanisms]
    if not searched:
        return ()
    best, n = on_grid(problem, likeliest(searched).mechanisms, 1).best, problem.response.size
    forced = round(n * none.expected_variance / none.adjusted_rss)  # the baseline's p, by (b) and (f)
    variance = none.rss / (none.cp + n - 2 * forced)
    sized = [(0, none.rss, ()), *((size, *found[0]) for size, found in sorted(best.items()))]
    return tuple(
        SizedModel(n_terms=size, n_coefficients=p, cp=rss / variance - n + 2 * p, terms=tuple(c.label for c in columns))
        for size, rss, columns in sized
        for p in (forced + size,)
    )


def _of_leader(judged: Judged) -> tuple[ComplexArray, ...]:
    """C_m + i C_n (frame rows,): measured less the leader's baseline, processes and errors of the record; and of the
    leader's mechanisms. Both by the filter that differentiates rates; NaN where these cannot be differentiated.
    """
    own, fit = judged.evidences[judged.leader], judged.fits[judged.leader]
    problem, frame, places = own.rows.problem, own.rows.frame_of(fit), [group.name for group in own.rows.groups]
    columns, values, always = list(fit.columns), [fit.values], TimeBasis("constant")
    for process in moment_processes():
        coefficients = np.split(own.spline_coefficients(places.index(process.name))[0], len(frame.motions))
        for flight, motion in enumerate(frame.motions):
            span = {"start": float(motion.time[0]), "stop": float(motion.time[-1])}
            here = process.model_copy(update={"name": f"{process.name} {flight}", **span})
            frame, terms = frame.with_mechanisms([here]), here.terms(motion, {})
            columns += [Regressor(here.name, term.name, (), always, "1", flight=flight) for term in terms]
            values.append(coefficients[flight] / max(rms_of_shapes(process, motion), 1e-300))
    known = np.concatenate(values)
    rest = problem.left(frame, columns, known, problem.others_beside(frame, columns, known)).rates
    made = frame.columns(fit.selected) @ fit.values[fit.baseline_size :]
    each = (residual_moments(frame, problem.records, rates) for rates in (rest + made, made))
    return tuple(np.where(found.usable, found.body, np.nan) for found in each)


def _channels(judged: Judged, flight: int, moments: Sequence[ComplexArray]) -> dict[str, Any]:
    """Histories of one flight for `Series`: measured and modelled rates and forces, the residual at unit noise, and
    the leader's `moments` (frame rows,) in the plane of alpha and across it.
    """
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
            motion = frame.motions[flight]
            planes = [plane_from_body(each[a:b], motion.windward_meridian[segment.rows]) for each in moments]
            parts += [part(each) for each in planes for part in (np.real, np.imag)]
            found.append(np.stack([motion.dynamic_pressure[segment.rows], *parts])[:, drawn(b - a)])
    air, *histories = (tuple(each) for each in np.concatenate(found, axis=1).tolist())
    count = 2 * len(_CHANNELS)
    return {
        "dynamic_pressure_pa": air,
        "leader": tuple(zip(histories[count::2], histories[count + 1 :: 2], strict=True)),
        "channels": dict(zip(_CHANNELS, zip(histories[:count:2], histories[1:count:2], strict=True), strict=True)),
        "whitened": whitened(own, flight),
        "histories": _histories(own, flight),
    }


def _histories(own: Evidence, flight: int) -> dict[str, Any]:
    """Of each process by name, at even times of a flight."""
    processes: tuple[Process, ...] = (*record_processes(), *moment_processes())
    splines, found = {each.name: each.splines for each in processes}, {}
    for place, group in enumerate(own.rows.groups):
        known = process_history(own, place, splines[group.name], flight, np.linspace(0.0, 1.0, _TIMES))
        pairs = zip(*(each.tolist() for each in known), strict=True)
        found[group.name] = tuple((tuple(each), tuple(error)) for each, error in pairs)
    return found


def process_history(
    own: Evidence, place: int, splines: int, flight: int, shares: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """A process of so many splines at shares of a flight's time: each shape or channel (kinds, times), and errors."""
    known = time_splines(shares, 0.0, 1.0, splines).T
    values, sigmas = (
        np.split(each, len(own.rows.blocks))[flight].reshape(-1, splines) for each in own.spline_coefficients(place)
    )
    return values @ known, np.sqrt(sigmas**2 @ known**2)


def whitened(own: Evidence, flight: int) -> dict[str, tuple[float, ...]]:
    """The residual beside all processes at unit noise, by channel, in axes that do not roll."""
    rows = own.rows.blocks[flight].rows
    residual, counted = (each[rows].reshape(len(_CHANNELS), -1) for each in (own.residual, own.rows.counted))
    parts = (residual[:, counted[0]] / own.noise).tolist()
    return {name: tuple(part) for name, part in zip(_CHANNELS, parts, strict=True)}
