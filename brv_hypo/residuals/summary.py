"""Gathers the result of a trace: the model on the whole record, what is left, and its caveats."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.model.columns import BASELINE, Column
from brv_hypo.ranking.result import TermEstimate
from brv_hypo.ranking.summary import flight_summary
from brv_hypo.regression.linear import covariance_of, solve_scaled
from brv_hypo.regression.residual_moments import ResidualMoments
from brv_hypo.residuals.candidates_at_step import Look, bare_look
from brv_hypo.residuals.config import TraceConfig
from brv_hypo.residuals.discover import Discovery
from brv_hypo.residuals.find import find
from brv_hypo.residuals.fitted_model import State
from brv_hypo.residuals.judge import noise_floor
from brv_hypo.residuals.linearisation import Model, Seen
from brv_hypo.residuals.problem import with_efficiency
from brv_hypo.residuals.restore import saved
from brv_hypo.residuals.result import ModelSummary, Picture, Residual, Step, Stop, Trace

_FEW_SAMPLES = 25.0


@dataclass(frozen=True)
class Ending:
    """Where the loop ended."""

    config: TraceConfig
    state: State
    steps: tuple[Step, ...]
    stopped: Stop
    discovery: Discovery | None


def summary(flight: Flight, before: ResidualMoments, end: Ending) -> Trace:
    """The result of the contract; `before` are the residual moments that the first model left."""
    state, last, model = end.state, end.state.seen, end.state.model
    here = bare_look(last, model, state.values, end.config, state.problem.rows.noise)
    final = find(here, state.left)
    values, covariance = whole_fit(here)
    count = len(model.columns)
    definition = saved(model, values[:count], covariance[:count, :count], (flight.path or flight.title,))
    terms = (
        *term_estimates(last, model.columns, values[:count], covariance[:count, :count]),
        *_record_terms(here, model, covariance),
    )
    return Trace(
        flight=flight_summary(flight),
        steps=end.steps,
        findings=tuple(step.added for step in end.steps if step.added and step.standing == "finding"),
        hints=tuple(step.added for step in end.steps if step.added and step.standing == "hint"),
        model=ModelSummary(terms=terms, definition=definition),
        stopped=end.stopped,
        unexplained=_unexplained(final),
        caveats=_caveats(flight, last),
        noise_floor=noise_floor(last.held_out, last.reconstruction),
        final_residual=final,
        discovered=None if end.discovery is None else end.discovery.file,
        picture=_picture(before, end),
    )


def whole_fit(here: Look) -> tuple[FloatArray, FloatArray]:
    """Coefficients and nuisances on the whole record, constants of integration left out, and their covariance."""
    problem = with_efficiency(here.problem, here.null).on(here.seen.whole)
    design, response = problem.whole_design(here.null.frame, here.null.columns), problem.raw_response
    values = solve_scaled(design, response)
    left = response - design @ values
    covariance = covariance_of(design, left, problem.samples, problem.efficiency)
    count, constants = len(here.null.columns), 2 * len(problem.rows.part.levels)
    kept = np.r_[:count, count + constants : values.size]
    return values[kept], covariance[np.ix_(kept, kept)]


def term_estimates(
    seen: Seen, columns: tuple[Column, ...], values: FloatArray, covariance: FloatArray
) -> tuple[TermEstimate, ...]:
    """Coefficients (columns,) of the moment model with their standard errors."""
    sigmas = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    time = seen.frame.time
    return tuple(
        TermEstimate(
            name=column.label,
            mechanism=_owner(column),
            channel=_channel(seen, column),
            value=float(value),
            std_error=float(sigma),
            f_ratio=_f_ratio(float(value), float(sigma)),
            units=column.units,
            region_s=None
            if column.course.kind == "constant"
            else (max(column.course.start, float(time[0])), min(column.course.stop, float(time[-1]))),
            delay_s=column.delay,
        )
        for column, value, sigma in zip(columns, values, sigmas, strict=True)
    )


def _record_terms(here: Look, model: Model, covariance: FloatArray) -> tuple[TermEstimate, ...]:
    """What was taken out of the record; its standard errors are those of a further change, moments and motion fitted
    along.
    """
    count = len(here.null.columns)
    items = here.problem.rows.nuisances.items
    sigmas = np.sqrt(np.maximum(np.diag(covariance), 0.0))[count:]
    by_name = {(i.name, i.component): float(s) * i.size for i, s in zip(items, sigmas, strict=True)}
    return tuple(
        TermEstimate(
            name=applied.component,
            mechanism=applied.effect.name,
            channel="record",
            value=applied.value,
            std_error=by_name[applied.effect.name, applied.component],
            f_ratio=_f_ratio(applied.value, by_name[applied.effect.name, applied.component]),
            units=applied.units,
        )
        for applied in model.applied
    )


def _f_ratio(value: float, sigma: float) -> float:
    return (value / sigma) ** 2 if sigma > 0.0 else float("nan")


def _owner(column: Column) -> str:
    return BASELINE if column.mechanism in ("static", "pitch damping") else column.mechanism


def _channel(seen: Seen, column: Column) -> str:
    terms = seen.frame.mechanisms[column.mechanism].terms(seen.reconstruction.motion, dict(column.theta))
    term = next(term for term in terms if term.name == column.term)
    inside, outside = bool(np.any(term.in_plane)), bool(np.any(term.out_of_plane))
    return "both" if inside and outside else "out-of-plane" if outside else "in-plane"


def _unexplained(residual: Residual) -> str | None:
    """What is left, in a sentence."""
    if residual.white:
        return None
    start, stop = residual.worst_region_s
    first, last = residual.worst_share_region_s
    went = "".join(
        f"; {c.moment} goes with {c.channel} (r = {c.coefficient:.2f})" for c in residual.correlations[:1]
    )
    return (
        f"What is left has an rms of {residual.rms:.2e}, {np.sqrt(residual.noise_ratio):.1f} times the noise of the "
        f"moments; it is largest in {residual.worst_channel} and from {start:.2f} to {stop:.2f} s, at "
        f"{residual.dominant_frequency_hz:.3g} Hz ({residual.dominant_frequency_is}){went}; against the moment "
        f"that was flown it is largest from {first:.2f} to {last:.2f} s, {100.0 * residual.worst_share:.0f} % of "
        "its rms there."
    )


def _caveats(flight: Flight, seen: Seen) -> tuple[str, ...]:
    """What in the data could pose as an effect."""
    found = list(seen.reconstruction.warnings)
    motion = seen.reconstruction.motion
    turning = float(np.percentile(np.abs(motion.windward_meridian_rate), 90.0)) + float(
        np.mean(np.abs(motion.p))
    )
    per_cycle = 2.0 * np.pi / (turning * flight.step)
    if per_cycle < _FEW_SAMPLES:
        attenuation = 1.0 - np.sinc(1.0 / per_cycle)
        found.append(
            f"a cycle has {per_cycle:.0f} samples: where samples are means over their interval, fast motion reads "
            f"{100.0 * attenuation:.1f} % too small, and a delay of half a sample may pose as damping or lag"
        )
    drag = _drag_spread(flight)
    if drag is not None and drag < 0.1:
        found.append(
            f"dynamic pressure keeps a fixed proportion to the axial force within {100.0 * drag:.0f} %: where it was "
            "derived from drag, its errors are those of the assumed drag coefficient, and a stiffness that changes "
            "along the flight may in part be that coefficient's change"
        )
    return tuple(dict.fromkeys(found))


def _drag_spread(flight: Flight) -> float | None:
    """Relative spread of axial force over dynamic pressure."""
    share = flight.ax / flight.dynamic_pressure
    centre = float(np.median(share))
    return None if centre == 0.0 else float(np.std(share) / abs(centre))


def _picture(before: ResidualMoments, end: Ending) -> Picture:
    after, seen = end.state.left, end.state.seen
    moments, motion = seen.reconstruction.moments, seen.reconstruction.motion
    kept = before.usable & after.usable
    samples = np.concatenate([np.arange(s.rows.start, s.rows.stop) for s in seen.frame.segments])[kept]
    return Picture(
        time_s=tuple(motion.time[samples].tolist()),
        measured=_pair(moments.body[samples]),
        before=_pair(before.body[kept]),
        after=_pair(after.body[kept]),
        sigma=tuple(moments.noise_sigma[samples].tolist()),
        alpha_rad=tuple(motion.alpha[samples].tolist()),
        windward_meridian_rad=tuple(motion.windward_meridian[samples].tolist()),
        roll_rate_rad_s=tuple(motion.p[samples].tolist()),
        windward_meridian_rate_rad_s=tuple(motion.windward_meridian_rate[samples].tolist()),
    )


def _pair(values: ComplexArray) -> tuple[tuple[float, ...], tuple[float, ...]]:
    return tuple(values.real.tolist()), tuple(values.imag.tolist())
