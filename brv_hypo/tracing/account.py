"""The account of a trace: the residual of a model, and one step with its errors before and after.

Entrances: `residual_of` and `step_of`. Beside the candidates are those that this flight cannot tell from them, and
whether each flight needs what was added without having had a part in choosing it (`flight_left_out`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

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
from brv_hypo.model.term import Regressor
from brv_hypo.motion.kinematics import plane_from_body
from brv_hypo.motion.motion import Motion
from brv_hypo.regression.channels import Part, Rows
from brv_hypo.regression.frame import RateFrame, remove_levels
from brv_hypo.regression.problem import GIVEN
from brv_hypo.regression.whitening import white
from brv_hypo.thresholds import NOISE_EXCESS
from brv_hypo.tracing.acceptance import Candidate, Tried, adjusted, confounded
from brv_hypo.tracing.additions import Analysis, Choice
from brv_hypo.tracing.fit import Fit, MomentErrors, constrained
from brv_hypo.tracing.result import Errors, FlightLeftOut, Residual, Step, TriedCandidate, lasting_steps
from brv_hypo.tracing.wording import described

_REPORTED = 8  # candidates in a step's table


# ---- The residual: whiteness, size, where it is largest, its frequency ----


def residual_of(fit: Fit) -> Residual:
    """Tests of a fit's residual. White is only what is no larger than noise.

    Of several flights, size and place are those of the one with the largest residual against its noise.
    """
    data, ratios = fit.data, [_noise_ratio(fit, k) for k in range(len(fit.data.records))]
    number = int(np.argmax(ratios))
    rows, samples, motion = data.rows_of(number), data.samples_of(number), data.reconstructions[number].motion
    usable, sigma, time = fit.left.usable[rows], fit.left.noise[rows], motion.time[samples]
    body = np.where(usable, fit.left.body[rows], 0.0)
    plane = plane_from_body(body, motion.windward_meridian[samples])
    channels = {"C_m": body.real, "C_n": body.imag, "C_m,in": plane.real, "C_n,side": plane.imag}
    p_value, frequency = _whiteness(fit), _dominant(body[usable], float(np.median(np.diff(time))))
    return Residual(
        flight=number if len(ratios) > 1 else None,
        rms=float(np.sqrt(np.mean(np.abs(body[usable]) ** 2) / 2.0)),
        white=p_value > WHITE_CHANCE and ratios[number] < NOISE_EXCESS,
        p_value=p_value,
        noise_ratio=ratios[number],
        worst_channel=max(channels, key=lambda name: _excess(channels[name][usable], sigma[usable])),
        worst_region_s=_worst_region(time, body, usable),
        dominant_frequency_hz=frequency,
        dominant_frequency_is=_name_frequency(motion, frequency),
    )


def _noise_ratio(fit: Fit, number: int) -> float:
    """Mean square of the residual of one flight over that of its noise."""
    rows = fit.data.rows_of(number)
    rows = rows[fit.left.usable[rows]]
    body, sigma = fit.left.body[rows], fit.left.noise[rows]
    return _excess(np.concatenate([body.real, body.imag]), np.tile(sigma, 2)) if body.size else 0.0


def _excess(values: FloatArray, sigma: FloatArray) -> float:
    return float(np.mean(values**2) / np.mean(sigma**2))


def _whiteness(fit: Fit) -> float:
    """Of the rates' residual: the smaller p-value of Ljung-Box and of its size against the gyros' noise, doubled."""
    fitted = fit.data.fitted
    pieces = remove_levels(fit.rest.rates[fitted.rows], fitted.pieces, white())
    flights = fit.data.frame.flight_of_row[fitted.rows]
    sigmas = [fit.data.records[int(flights[a])].gyro_sigma for a, _ in fitted.pieces]
    parts = [part / sigma for piece, sigma in zip(pieces, sigmas, strict=True) for part in (piece.real, piece.imag)]
    chances = [
        float(acorr_ljungbox(part, lags=[min(WHITE_LAGS, part.size // 4)])["lb_pvalue"].iloc[0]) for part in parts
    ]
    together = float(stats.combine_pvalues(np.clip(chances, 1e-300, 1.0)).pvalue)
    total = sum(float(part @ part) for part in parts)
    free = sum(part.size - 1 for part in parts)
    # The noise level is itself estimated, to about one part in the root of the samples.
    spread = np.sqrt(2.0 * free) * np.sqrt(3.0)
    return min(1.0, 2.0 * min(together, float(stats.norm.sf((total - free) / spread))))


def _worst_region(time: FloatArray, body: ComplexArray, usable: BoolArray) -> tuple[float, float]:
    """Among equal parts of the record, those about the largest mean square that exceed a share of it."""
    count = REPORTED_REGIONS
    which = np.clip(((time - time[0]) / (time[-1] - time[0]) * count).astype(int), 0, count - 1)
    inside = [(which == k) & usable for k in range(count)]
    size = [float(np.mean(np.abs(body[own]) ** 2)) if own.any() else 0.0 for own in inside]
    edges = np.linspace(time[0], time[-1], count + 1)
    first = last = worst = int(np.argmax(size))
    while first > 0 and size[first - 1] > REPORTED_REGION_SHARE * size[worst]:
        first -= 1
    while last < count - 1 and size[last + 1] > REPORTED_REGION_SHARE * size[worst]:
        last += 1
    return float(edges[first]), float(edges[last + 1])


def _dominant(body: ComplexArray, step: float) -> float:
    """Frequency (Hz) of the largest line in the residual; negative where it turns from z to y."""
    values = body - body.mean()
    spectrum = np.abs(np.fft.fft(values * np.hanning(values.size)))
    return float(np.fft.fftfreq(values.size, step)[int(np.argmax(spectrum))])


def _name_frequency(motion: Motion, frequency: float) -> str:
    """What the frequency is near: a small multiple of the roll rate or of the meridian's."""
    resolution = REPORTED_FREQUENCY_LINES / float(motion.time[-1] - motion.time[0])
    rates = {"roll rate": motion.p, "windward-meridian rate": motion.windward_meridian_rate}
    away, name = min(
        (
            abs(abs(frequency) - multiple * abs(float(np.mean(rate))) / (2.0 * np.pi)),
            f"{multiple} x {name}" if multiple > 1 else name,
        )
        for name, rate in rates.items()
        for multiple in (1, 2, 3)
    )
    near = away < max(resolution, REPORTED_FREQUENCY_WITHIN * abs(frequency))
    return name if near else "not a multiple of the roll or meridian rate"


# ---- One step, with its errors before and after ----


def step_of(number: int, residual: Residual, here: Analysis, choice: Choice, earlier: Sequence[Step]) -> Step:
    """One step of the result: the candidates with what was added first, and the errors before and after."""
    fit, leading, accepted = here.fit, choice.leading, choice.accepted
    reported, chances = choice.reported[:_REPORTED], adjusted(choice.ranked)
    without_flight, status = None if leading is None else flight_left_out(here, leading.candidate), None
    if accepted is not None and choice.named_in is not None:
        generic = accepted.candidate.kind == "discovered" and len(fit.data.records) == 1
        elsewhere = None if without_flight is None else without_flight.ratio
        own = accepted.status(choice.named_in, len(choice.ranked), elsewhere)
        status = "hint" if generic or rests_on_hints(earlier) else own
    return Step(
        step=number,
        residual=residual,
        candidates=tuple(
            TriedCandidate(
                effect=each.name,
                kind=each.kind,
                f_ratio=each.f_ratio,
                p_value_adjusted=chances[each.name],
                explains=each.explains,
                description=described(each, here),
                near_equals=confounded(each, reported),
            )
            for each in reported
        ),
        refused=tuple(tried.candidate.name for tried in choice.tried if tried is not accepted),
        unwanted=choice.unwanted,
        evidence_gain=None if accepted is None else accepted.gain,
        added=None if accepted is None else accepted.candidate.name,
        standing=status,
        flight_left_out=without_flight,
        named_in=choice.named_in,
        error_before=_errors(fit.errors, fit.held_out) if leading is None else _errors(*leading.errors_before),
        force_error_before=_force_errors(fit, fit.rest if leading is None else leading.before),
        **({} if leading is None else _after(leading, here)),
    )


def _after(leading: Tried, here: Analysis) -> dict[str, Any]:
    """What a step says of the candidate that leads."""
    return {
        "description": described(leading.candidate, here),
        "error_after": _errors(leading.fit.errors, leading.fit.held_out),
        "error_ratio_held_out": leading.ratio,
        "error_ratio_std_error": leading.ratio_error,
        "force_error_after": _force_errors(here.fit, leading.after),
        "held_out_score": leading.agreement.fall,
    }


def _errors(fitted: MomentErrors, held_out: MomentErrors) -> Errors:
    return Errors(fit=fitted.mean_square, held_out=held_out.mean_square)


def _force_errors(fit: Fit, left: Rows) -> Errors:
    """Mean squares (m/s^2)^2 of the transverse specific force's residual (frame rows,), both axes together."""

    def mean(part: Part) -> float:
        return float(np.mean(np.abs(left.force[part.rows][part.valid]) ** 2) / 2.0)

    return Errors(fit=mean(fit.data.fitted), held_out=mean(fit.data.held_out))


def rests_on_hints(earlier: Sequence[Step]) -> bool:
    """Whether the model has what earlier steps added and did not establish.

    What is added beside it may make up for it: a moment that is constant in the body for one that drifts there.
    """
    return any(step.status == "hint" for step in lasting_steps(earlier))


def flight_left_out(here: Analysis, candidate: Candidate) -> FlightLeftOut | None:
    """Errors on each flight without and with the candidate; None for one flight, or where nothing of it is shared."""
    problem, found, flights = here.fit.problem, candidate.fit, range(len(here.fit.data.records))
    shared = any(column.flight is None and column.mechanism != GIVEN for column in found.selected)
    if len(flights) < 2 or not shared:
        return None
    before = [_predicted(here.fit, problem.frame, problem.baseline, k) for k in flights]
    after = [_predicted(here.fit, found.frame, found.columns, k) for k in flights]
    sums = [sum(float(each.squares.sum()) for each in errors) for errors in (before, after)]
    return FlightLeftOut(
        before=tuple(each.mean_square for each in before),
        after=tuple(each.mean_square for each in after),
        ratio=sums[1] / sums[0],
    )


def _predicted(fit: Fit, frame: RateFrame, columns: Sequence[Regressor], number: int) -> MomentErrors:
    """Errors on one flight of the shared coefficients that the others have: 0 is fixed, NaN free."""
    data, items = fit.data, fit.problem.rows.nuisances.items
    flights = [np.array([-1 if each.flight is None else each.flight for each in some]) for some in (columns, items)]
    others = fit.problem.on(data.part_where(data.frame.flight_of_row != number))
    known = constrained(others, frame, columns, *(np.where(each == number, 0.0, np.nan) for each in flights))
    fixed = [
        np.where(each == -1, found, np.where(each == number, np.nan, 0.0))
        for each, found in zip(flights, (known.values, known.others), strict=True)
    ]
    part = data.part_where(data.frame.flight_of_row == number)
    left = constrained(fit.problem.on(part), frame, columns, *fixed).left
    return MomentErrors.of(part, data.moments(left.rates))
