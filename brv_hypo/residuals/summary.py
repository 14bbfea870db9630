"""Gathers the result of a trace: the model on the whole record, what is left, and its caveats."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import REPORTED_DRAG, REPORTED_MERIDIAN, REPORTED_PER_CYCLE
from brv_hypo.flight.record import Flight
from brv_hypo.inference.derivatives import along_flights, damping
from brv_hypo.inference.evidence import Evidence
from brv_hypo.mechanisms.yaml_mechanism import MechanismFile, YamlMechanism
from brv_hypo.model.baseline import KnownSlopeSchedule, PitchDamping, SlopeSchedule, StaticBend, StaticMoment
from brv_hypo.model.term import BASELINE, Regressor
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.ranking.diagnostics import collinear, record_errors, whitened
from brv_hypo.ranking.result import TermEstimate
from brv_hypo.ranking.summary import flight_summary
from brv_hypo.regression.uncertainty import ResidualMoments, residual_moments
from brv_hypo.residuals.candidates_at_step import GENERIC, Analysis, baseline_analysis
from brv_hypo.residuals.config import TraceConfig
from brv_hypo.residuals.diagnostics import find
from brv_hypo.residuals.discover import Discovery, as_terms
from brv_hypo.residuals.families import beside_processes
from brv_hypo.residuals.fitted_model import State, converged_state
from brv_hypo.residuals.judge import noise_floor
from brv_hypo.residuals.linearisation import Corrected, Model
from brv_hypo.residuals.prediction_interval import lasting, model_error, pair
from brv_hypo.residuals.restore import Found, saved
from brv_hypo.residuals.result import ModelSummary, Picture, Residual, Standing, Step, Stop, Trace, lasting_steps
from brv_hypo.residuals.static_slope import (
    Coefficients,
    coefficients_of,
    placed_by_the_whole,
    stability_in_words,
    static_slopes,
    whole_fit,
)

_OF_THE_BASELINE = (StaticMoment.name, PitchDamping.name, StaticBend.name, SlopeSchedule.name, KnownSlopeSchedule.name)


@dataclass(frozen=True)
class LoopEnd:
    """Where the loop ended."""

    config: TraceConfig
    state: State
    steps: tuple[Step, ...]
    stopped: Stop
    discovery: Discovery | None


def summary(flights: Sequence[Flight], before: ResidualMoments, end: LoopEnd) -> Trace:
    """The result of the contract; `before` are the residual moments that the first model left."""
    state, last = end.state, end.state.data
    here = baseline_analysis(last, state.model, state.linear, end.config, state.problem.rows.noise)
    final = find(here, state.left)
    here = placed_by_the_whole(here)
    model = replace(state.model, columns=here.null.columns)
    moments = coefficients_of(here)
    elsewhere = _elsewhere(flights, end, model, moments)
    findings = _added(end.steps, "finding")
    definition = saved(
        replace(model, columns=moments.columns),
        Found(
            moments.values,
            moments.covariance,
            elsewhere.values,
            elsewhere.covariance,
            model_error(last, state.left, elsewhere.left),
            tuple(flight.path or flight.title for flight in flights),
            tuple((float(flight.time[0]), float(flight.time[-1])) for flight in flights),
            flown(last),
        ),
    )
    terms = (*term_estimates(last, moments.columns, moments.values, moments.covariance), *_record_terms(here, model))
    own = beside_processes(state, state.model, end.config).null
    slopes = static_slopes(last, moments)
    damped = along_flights(own, own.rows.problem.baseline, own.rows.frame, damping)
    return Trace(
        flight=flight_summary(flights[0]),
        flights=tuple(flight_summary(flight) for flight in flights),
        steps=end.steps,
        findings=findings,
        hints=tuple(name for name in _added(end.steps, "hint") if name not in findings),
        model=ModelSummary(terms=terms, definition=definition),
        record_errors=record_errors(own),
        collinear=collinear(moments.columns, moments.covariance),
        static_slopes=slopes,
        static_stability=stability_in_words(slopes),
        damping=damped,
        dynamic_stability=stability_in_words(damped, "damping moment", doubt=False),
        stopped=end.stopped,
        unexplained=_unexplained(final),
        caveats=_caveats(flights, last),
        noise=noise_floor(last.held_out, state.left),
        final_residual=final,
        discovered=_described(end, moments),
        picture=_picture(before, end, final.flight or 0, own),
    )


def _added(steps: Sequence[Step], standing: Standing) -> tuple[str, ...]:
    """What was added with this standing and stays, in order; once, though it was added in parts."""
    own = (step for step in lasting_steps(steps) if step.standing == standing)
    return tuple(dict.fromkeys(step.added for step in own if step.added))


def flown(data: Corrected) -> dict[str, tuple[float, float]]:
    """The ends of the Mach numbers and angles of attack (rad) that the flights ran through, where they are known.

    The model knows small angles of attack, where its moment is nothing, as well as those that it was found at.
    """
    mach, alpha = (
        np.concatenate([getattr(each.motion, name) for each in data.reconstructions]) for name in ("mach", "alpha")
    )
    found = {"alpha": (0.0, float(alpha.max()))}
    if np.all(np.isfinite(mach)):
        found["mach"] = (float(mach.min()), float(mach.max()))
    return found


def _described(end: LoopEnd, moments: Coefficients) -> MechanismFile | None:
    """All that was described in generic terms, with its values; where nothing was added, what could not be."""
    model = end.state.model
    pieces = [
        (name, piece)
        for name in dict.fromkeys(column.mechanism for column in model.columns)
        if name.startswith(GENERIC) and isinstance(piece := model.mechanisms[name], YamlMechanism)
    ]
    if not pieces:
        return None if end.discovery is None else end.discovery.file
    terms = []
    for name, piece in pieces:
        own = [k for k, column in enumerate(moments.columns) if column.mechanism == name]
        found = as_terms([moments.columns[k] for k in own], moments.values[own], piece)
        label = "" if len(pieces) == 1 else f"{name}: "
        terms += [term.model_copy(update={"name": f"{label}{term.name}"}) for term in found]
    words = " and ".join(piece.title for _, piece in pieces)
    name = pieces[0][0] if len(pieces) == 1 else GENERIC
    source = "found in the residual of a flight"
    return MechanismFile(name=name, title=words, claims=words, source=source, terms=tuple(terms))


@dataclass(frozen=True)
class _Elsewhere:
    """The model without what belongs to its own flights alone, and what it leaves here.

    `values` (columns,) are the coefficients of the whole model's columns, NaN for what is left out, and `covariance`
    theirs, 0 there.
    """

    values: FloatArray
    covariance: FloatArray
    left: ResidualMoments


def _elsewhere(flights: Sequence[Flight], end: LoopEnd, model: Model, own: Coefficients) -> _Elsewhere:
    """What stays is fitted anew: it takes over the mean of what is left out."""
    state = end.state
    lasts = lasting(model.columns, model.mechanisms)
    if np.all(lasts) and not model.applied:
        return _Elsewhere(own.values, own.covariance, state.left)
    columns = tuple(itertools.compress(model.columns, lasts))
    state = converged_state(flights, replace(model, columns=columns, applied=()), end.config)
    here = baseline_analysis(state.data, state.model, state.linear, end.config, state.problem.rows.noise)
    found = coefficients_of(here)
    # What was refined on the way is the same column still.
    place = {column: k for k, column in (*enumerate(found.columns), *enumerate(columns))}
    kept = [j for j, column in enumerate(own.columns) if column in place]
    order = [place[own.columns[j]] for j in kept]
    values, covariance = np.full(own.values.size, np.nan), np.zeros_like(own.covariance)
    values[kept] = found.values[order]
    covariance[np.ix_(kept, kept)] = found.covariance[np.ix_(order, order)]
    return _Elsewhere(values, covariance, state.left)


def term_estimates(
    data: Corrected, columns: tuple[Regressor, ...], values: FloatArray, covariance: FloatArray
) -> tuple[TermEstimate, ...]:
    """Coefficients (columns,) of the moment model with their standard errors."""
    sigmas = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return tuple(
        TermEstimate(
            name=column.label + _of_flight(data, column.flight),
            mechanism=BASELINE if column.mechanism in _OF_THE_BASELINE else column.mechanism,
            channel=_channel(data, column),
            value=float(value),
            std_error=float(sigma),
            f_ratio=_f_ratio(float(value), float(sigma)),
            units=column.units,
            region_s=_region(data, column),
            delay_s=column.delay,
        )
        for column, value, sigma in zip(columns, values, sigmas, strict=True)
    )


def _of_flight(data: Corrected, number: int | None) -> str:
    """Which flight a term is of, where there are several; counted from 1."""
    return "" if number is None or len(data.records) == 1 else f" [flight {number + 1}]"


def _region(data: Corrected, column: Regressor) -> tuple[float, float] | None:
    """Where the course of a column acts, s; None where it is constant."""
    if column.time_basis.kind == "constant":
        return None
    time = data.flights[column.flight or 0].time
    return max(column.time_basis.start, float(time[0])), min(column.time_basis.stop, float(time[-1]))


def _record_terms(here: Analysis, model: Model) -> tuple[TermEstimate, ...]:
    """What was taken out of the record; its standard errors are those of a further change, moments and motion fitted
    along.
    """
    if not model.applied:
        return ()
    count, covariance = len(here.null.columns), whole_fit(here)[1]
    items = here.problem.rows.nuisances.items
    sigmas = np.sqrt(np.maximum(np.diag(covariance), 0.0))[count:]
    by_name = {(i.name, i.component, i.flight): float(s) * i.size for i, s in zip(items, sigmas, strict=True)}
    names = [(a.effect.name, a.component, a.flight) for a in model.applied]
    return tuple(
        TermEstimate(
            name=applied.component + _of_flight(here.data, applied.flight),
            mechanism=applied.effect.name,
            channel="record",
            value=applied.value,
            std_error=by_name[name],
            f_ratio=_f_ratio(applied.value, by_name[name]),
            units=applied.units,
        )
        for applied, name in zip(model.applied, names, strict=True)
    )


def _f_ratio(value: float, sigma: float) -> float:
    return (value / sigma) ** 2 if sigma > 0.0 else float("nan")


def _channel(data: Corrected, column: Regressor) -> str:
    motion = data.reconstructions[column.flight or 0].motion
    terms = data.frame.mechanisms[column.mechanism].terms(motion, dict(column.theta))
    term = next(term for term in terms if term.name == column.term)
    inside, outside = bool(np.any(term.in_plane)), bool(np.any(term.out_of_plane))
    return "both" if inside and outside else "out-of-plane" if outside else "in-plane"


def _unexplained(residual: Residual) -> str | None:
    """What is left, in a sentence."""
    if residual.white:
        return None
    start, stop = residual.worst_region_s
    ratio = float(np.sqrt(residual.noise_ratio))  # at two digits, never with an exponent
    times = f"{float(f'{ratio:.2g}'):.6g}" if ratio < 1e6 else "more than a million"
    return (
        f"The residual has an rms of {residual.rms:.3g}, {times} times the noise of the moments; it is largest in "
        f"{residual.worst_channel} and from {start:.2f} to {stop:.2f} s, at "
        f"{residual.dominant_frequency_hz:.3g} Hz ({residual.dominant_frequency_is})."
    )


def _caveats(flights: Sequence[Flight], data: Corrected) -> tuple[str, ...]:
    """What in the data could pose as an effect."""
    each = zip(flights, data.reconstructions, strict=True)
    return tuple(dict.fromkeys(caveat for pair in each for caveat in _caveats_of(*pair)))


def _caveats_of(flight: Flight, reconstruction: Reconstruction) -> list[str]:
    found = list(reconstruction.warnings)
    motion = reconstruction.motion
    turning = float(np.percentile(np.abs(motion.windward_meridian_rate), REPORTED_MERIDIAN)) + float(
        np.mean(np.abs(motion.p))
    )
    per_cycle = 2.0 * np.pi / (turning * flight.step)
    if per_cycle < REPORTED_PER_CYCLE:
        attenuation = 1.0 - np.sinc(1.0 / per_cycle)
        found.append(
            f"a cycle of the fastest motion (roll and turn of the meridian together) has {per_cycle:.0f} samples: "
            f"if samples are averages over their interval, the motion appears {100.0 * attenuation:.1f} % too small, "
            "and a delay of half a sample may look like damping or lag"
        )
    drag = _drag_spread(flight)
    if drag is not None and drag < REPORTED_DRAG:
        found.append(
            f"dynamic pressure keeps a fixed proportion to the axial force within {max(100.0 * drag, 0.01):.2g} %: "
            "where it was derived from drag, its errors are those of the assumed drag coefficient, and a stiffness "
            "that changes along the flight may in part be that coefficient's change"
        )
    return found


def _drag_spread(flight: Flight) -> float | None:
    """Relative spread of axial force over dynamic pressure."""
    share = flight.ax / flight.dynamic_pressure
    centre = float(np.median(share))
    return None if centre == 0.0 else float(np.std(share) / abs(centre))


def _picture(before: ResidualMoments, end: LoopEnd, number: int, own: Evidence) -> Picture:
    """Of several flights, that of the one with this number."""
    after, data = end.state.left, end.state.data
    reconstruction = data.reconstructions[number]
    motion = reconstruction.motion
    measured = residual_moments(data.frame, data.records, data.frame.observed)
    rows = data.rows_of(number)
    kept = (before.usable & after.usable)[rows]
    samples = data.samples_of(number)[kept]
    return Picture(
        time_s=tuple(motion.time[samples].tolist()),
        measured=pair(measured.body[rows][kept]),
        before=pair(before.body[rows][kept]),
        after=pair(after.body[rows][kept]),
        sigma=tuple(after.noise[rows][kept].tolist()),
        alpha_rad=tuple(motion.alpha[samples].tolist()),
        alpha_sigma_rad=tuple(reconstruction.alpha_sigma[samples].tolist()),
        windward_meridian_rad=tuple(motion.windward_meridian[samples].tolist()),
        windward_meridian_sigma_rad=tuple(reconstruction.phi_w_sigma[samples].tolist()),
        roll_rate_rad_s=tuple(motion.p[samples].tolist()),
        windward_meridian_rate_rad_s=tuple(motion.windward_meridian_rate[samples].tolist()),
        mach=tuple(motion.mach[samples].tolist()),
        dynamic_pressure_pa=tuple(motion.dynamic_pressure[samples].tolist()),
        whitened=whitened(own, number),
    )
