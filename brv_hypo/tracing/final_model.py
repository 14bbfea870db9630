"""The model that a trace ends with: coefficients on the whole record, what they make of slopes, and its likelihood.

Entrances: `gathered`, the result of a trace, and `maximum_likelihood`.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy import stats

from brv_hypo.arrays import ComplexArray, FloatArray, IntArray
from brv_hypo.comparison.diagnostics import collinear, record_errors, whitened
from brv_hypo.comparison.result import MaximumLikelihood, TermEstimate
from brv_hypo.comparison.summary import flight_summary, likelihood_block
from brv_hypo.constants import LIKELIHOOD_STEPS, MODEL_ERROR_CHANCE, MODEL_ERROR_WEIGHTS, SCHEDULE_TRIFLE
from brv_hypo.identification import identify
from brv_hypo.inference.derivatives import Derivative, along_flight, along_flights, damping
from brv_hypo.inference.evidence import Evidence
from brv_hypo.inference.refinement import FINAL, nonlinear_parameters, prediction_slopes
from brv_hypo.inference.uncertainty import Regressed, ResidualMoments
from brv_hypo.linearisation.linear import covariance_of, solve_scaled
from brv_hypo.linearisation.whitening import effective_samples
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.mechanisms.yaml_mechanism import MechanismFile, YamlMechanism
from brv_hypo.model.baseline import KnownSlopeSchedule, PitchDamping, SlopeSchedule, StaticBend, StaticMoment
from brv_hypo.model.model import TOLERATED, Model, ModelError, SavedModel
from brv_hypo.model.term import BASELINE, Regressor, Theta, TimeBasis
from brv_hypo.motion.motion import Motion
from brv_hypo.tracing.additions import GENERIC
from brv_hypo.tracing.description import Discovery, as_terms, file_of
from brv_hypo.tracing.families import beside_processes
from brv_hypo.tracing.fit import Corrected, Fit, as_regressor, converged, noise_floor, with_efficiency
from brv_hypo.tracing.result import Account, ModelSummary, Picture, Step, Stop, Trace, names_added
from brv_hypo.tracing.wording import caveats, stability_in_words, unexplained

_OF_THE_BASELINE = (StaticMoment.name, PitchDamping.name, StaticBend.name, SlopeSchedule.name, KnownSlopeSchedule.name)
# What a static moment may be a function of.
_FLOW = ("time", "alpha", "velocity", "dynamic_pressure", "mach", "log_reynolds")
# Differences of the angle of attack, rad: the moment of a power of it is linear over less than 1e-7 of itself.
_STEP = 1e-4
_ALWAYS = TimeBasis("constant")


def gathered(
    fit: Fit,
    before: ResidualMoments,
    steps: Sequence[Step],
    account: tuple[Account, ...],
    stopped: Stop,
    discovery: Discovery | None,
) -> Trace:
    """The result of the contract; `before` are the residual moments of the first model."""
    data, flights, final = fit.data, fit.data.originals, fit.residual
    whole = WholeRecord.of(fit)
    found, beside = whole.coefficients, beside_processes(fit, fit.model).null
    definition, slopes = _definition(fit, whole), static_slopes(data, found)
    damped = along_flights(beside, beside.rows.problem.baseline, beside.rows.frame, damping)
    findings = names_added(steps, "finding")
    return Trace(
        flight=flight_summary(flights[0]),
        flights=tuple(flight_summary(flight) for flight in flights),
        steps=tuple(steps),
        findings=findings,
        hints=tuple(name for name in names_added(steps, "hint") if name not in findings),
        families=steps[0].families,
        account=account,
        model=ModelSummary(terms=(*found.estimates(data), *whole.record_terms()), definition=definition),
        record_errors=record_errors(beside),
        collinear=collinear(found.columns, found.covariance),
        static_slopes=slopes,
        static_stability=stability_in_words(slopes),
        damping=damped,
        dynamic_stability=stability_in_words(damped, "damping moment", doubt=False),
        stopped=stopped,
        unexplained=unexplained(final),
        caveats=caveats(flights, data.reconstructions),
        noise=noise_floor(data.held_out, fit.left),
        final_residual=final,
        discovered=_described(fit.model, found, discovery),
        picture=_picture(before, fit, final.flight or 0, beside),
    )


def _described(model: Model, found: Coefficients, discovery: Discovery | None) -> MechanismFile | None:
    """All that was described in generic terms, with its values; where nothing was added, what could not be."""
    names = dict.fromkeys(column.mechanism for column in model.columns if column.mechanism.startswith(GENERIC))
    pieces = {name: piece for name in names if isinstance(piece := model.mechanisms[name], YamlMechanism)}
    if not pieces:
        return None if discovery is None else discovery.file
    terms = []
    for name, piece in pieces.items():
        own = [k for k, column in enumerate(found.columns) if column.mechanism == name]
        label = "" if len(pieces) == 1 else f"{name}: "
        each = as_terms([found.columns[k] for k in own], found.values[own], piece.definition)
        terms += [term.model_copy(update={"name": f"{label}{term.name}"}) for term in each]
    words = " and ".join(piece.title for piece in pieces.values())
    name = next(iter(pieces)) if len(pieces) == 1 else GENERIC
    return file_of(name, words, terms)


def _picture(before: ResidualMoments, fit: Fit, number: int, own: Evidence) -> Picture:
    """Of several flights, that of the one with this number."""
    after, data, measured = fit.left, fit.data, fit.data.moments(fit.data.frame.observed)
    reconstruction, rows = data.reconstructions[number], data.rows_of(number)
    kept = (before.usable & after.usable)[rows]
    samples, rows, motion = data.samples_of(number)[kept], rows[kept], reconstruction.motion
    histories = {
        "time_s": motion.time,
        "alpha_rad": motion.alpha,
        "alpha_sigma_rad": reconstruction.alpha_sigma,
        "windward_meridian_rad": motion.windward_meridian,
        "windward_meridian_sigma_rad": reconstruction.phi_w_sigma,
        "roll_rate_rad_s": motion.p,
        "windward_meridian_rate_rad_s": motion.windward_meridian_rate,
        "mach": motion.mach,
        "dynamic_pressure_pa": motion.dynamic_pressure,
    }
    return Picture(
        measured=pair(measured.body[rows]),
        before=pair(before.body[rows]),
        after=pair(after.body[rows]),
        sigma=tuple(after.noise[rows].tolist()),
        whitened=whitened(own, number),
        **{name: tuple(values[samples].tolist()) for name, values in histories.items()},
    )


def pair(values: ComplexArray) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Pitch and yaw of moments (n,), as a result has them."""
    return tuple(values.real.tolist()), tuple(values.imag.tolist())


# ---- The model's coefficients on the whole record, and how well they are known ----


@dataclass(frozen=True)
class Coefficients:
    """Columns of moments with their coefficients (columns,) and these' covariance."""

    columns: tuple[Regressor, ...]
    values: FloatArray
    covariance: FloatArray

    def estimates(self, data: Corrected) -> tuple[TermEstimate, ...]:
        """With their standard errors, as a result has them."""
        sigmas = np.sqrt(np.maximum(np.diag(self.covariance), 0.0)).tolist()
        known = zip(self.columns, self.values.tolist(), sigmas, strict=True)
        return tuple(_estimate(data, column, value, sigma) for column, value, sigma in known)


def _estimate(data: Corrected, column: Regressor, value: float, sigma: float) -> TermEstimate:
    basis, number = column.time_basis, column.flight or 0
    motion, time = data.reconstructions[number].motion, data.flights[number].time
    terms = data.frame.mechanisms[column.mechanism].terms(motion, dict(column.theta))
    term = next(term for term in terms if term.name == column.term)
    inside, outside = bool(np.any(term.in_plane)), bool(np.any(term.out_of_plane))
    channel = "both" if inside and outside else "out-of-plane" if outside else "in-plane"
    mechanism = BASELINE if column.mechanism in _OF_THE_BASELINE else column.mechanism
    acts = max(basis.start, float(time[0])), min(basis.stop, float(time[-1]))
    more = {"region_s": None if basis.kind == "constant" else acts, "delay_s": column.delay}
    name, own = column.label + _of_flight(data, column.flight), (mechanism, channel, column.units)
    return _term(name, *own, value, sigma).model_copy(update=more)


def _of_flight(data: Corrected, number: int | None) -> str:
    """Which flight a term is of, where there are several; counted from 1."""
    return "" if number is None or len(data.records) == 1 else f" [flight {number + 1}]"


def _term(name: str, mechanism: str, channel: str, units: str, value: float, sigma: float) -> TermEstimate:
    known = {"name": name, "mechanism": mechanism, "channel": channel, "units": units, "value": value}
    f_ratio = (value / sigma) ** 2 if sigma > 0.0 else float("nan")
    return TermEstimate.model_validate({**known, "std_error": sigma, "f_ratio": f_ratio})


@dataclass(frozen=True)
class WholeRecord:
    """A fit, on the whole record: its knots and delays are those of `fit`."""

    fit: Fit

    @classmethod
    def of(cls, fit: Fit) -> WholeRecord:
        """With delays and knots where the whole record has them: the sizes that go with them are of all of it."""
        fit = fit.alone()
        columns = fit.at_best_knots(with_efficiency(fit.problem, fit.null).on(fit.data.whole), FINAL)
        if columns is None:
            return cls(fit)
        model, problem = fit.model.but(columns=columns), replace(fit.problem, baseline=columns)
        return cls(replace(fit, model=model, problem=problem))

    @cached_property
    def solution(self) -> tuple[FloatArray, FloatArray]:
        """Coefficients and nuisances, and their covariance. Delays and knots are as uncertain as the record leaves
        them.
        """
        null, columns = self.fit.null, self.fit.null.columns
        problem = with_efficiency(self.fit.problem, null).on(self.fit.data.whole)
        design, response = problem.whole_design(null.frame, columns), problem.raw_response
        values = solve_scaled(design, response)
        left, nonlinear = response - design @ values, nonlinear_parameters(columns, 0, null.frame, problem.knots)
        if nonlinear:
            slopes = prediction_slopes(nonlinear, columns, values[: len(columns)], null.frame)
            design = np.column_stack([design, problem.rows.of_moments(slopes)])
        covariance = covariance_of(design, left, problem.samples, problem.efficiency)
        count, constants = len(columns), 2 * len(problem.rows.part.levels)
        kept = np.r_[:count, count + constants : values.size]
        return values[kept], covariance[np.ix_(kept, kept)]

    @property
    def coefficients(self) -> Coefficients:
        """The model's columns, and what its baseline is more after them, which has a prior in the fit."""
        (values, covariance), columns, items = self.solution, self.fit.null.columns, self.fit.nuisances
        places = [k for k, item in enumerate(items) if item.name in TOLERATED]
        scale = np.array([*np.ones(len(columns)), *(items[k].size for k in places)])
        chosen = np.array([*range(len(columns)), *(len(columns) + k for k in places)], dtype=int)
        more = tuple(as_regressor(items[k]) for k in places)
        covariance = covariance[np.ix_(chosen, chosen)] * np.outer(scale, scale)
        return Coefficients((*columns, *more), scale * values[chosen], covariance)

    def record_terms(self) -> tuple[TermEstimate, ...]:
        """What was taken out of the record; its standard errors are those of a further change, moments and motion
        fitted along.
        """
        sigmas = np.sqrt(np.maximum(np.diag(self.solution[1]), 0.0))[len(self.fit.model.columns) :].tolist()
        pairs = zip(self.fit.nuisances, sigmas, strict=True)
        of = {(item.name, item.component, item.flight): sigma * item.size for item, sigma in pairs}

        return tuple(
            _term(a.component + _of_flight(self.fit.data, a.flight), name, "record", a.units, a.value, sigma)
            for a in self.fit.model.applied
            for name in [a.effect.name]
            for sigma in [of[name, a.component, a.flight]]
        )


def _definition(fit: Fit, whole: WholeRecord) -> SavedModel:
    """The model as its file, with what is known of it where it was found."""
    found, flights = whole.coefficients, fit.data.originals
    elsewhere, left = _elsewhere(fit, whole)
    known = whole.fit.model.but(columns=found.columns).saved()
    return known.with_coefficients(found.values, found.covariance, elsewhere.values, elsewhere.covariance).model_copy(
        update={
            "error": model_error(fit.data, fit.left, left),
            "found_on": tuple(flight.path or flight.title for flight in flights),
            "times": tuple((float(flight.time[0]), float(flight.time[-1])) for flight in flights),
            "flown": _flown(fit.data),
        }
    )


def _flown(data: Corrected) -> dict[str, tuple[float, float]]:
    """The ends of the Mach numbers and angles of attack (rad) that the flights ran through, where they are known.

    The model knows small angles of attack, where its moment is nothing, as well as those that it was found at.
    """
    mach, alpha = (
        np.concatenate([getattr(each.motion, name) for each in data.reconstructions]) for name in ("mach", "alpha")
    )
    found = {"alpha": (0.0, float(alpha.max()))}
    return found | ({"mach": (float(mach.min()), float(mach.max()))} if np.all(np.isfinite(mach)) else {})


def _elsewhere(fit: Fit, whole: WholeRecord) -> tuple[Coefficients, ResidualMoments]:
    """The coefficients of the whole model's columns without what belongs to its own flights alone, NaN for what is left
    out (covariance 0), and the residual without it. What stays is fitted anew: it takes over the mean of the rest.
    """
    model, own = whole.fit.model, whole.coefficients
    lasts = model.lasting
    if np.all(lasts) and not model.applied:
        return own, fit.left
    columns = tuple(itertools.compress(model.columns, lasts))
    fit = converged(fit.data.originals, model.but(columns=columns, applied=()), fit.data.config)
    found = WholeRecord(fit.alone()).coefficients
    # What was refined on the way is the same column still.
    place = {column: k for k, column in (*enumerate(found.columns), *enumerate(columns))}
    kept = [j for j, column in enumerate(own.columns) if column in place]
    order = [place[own.columns[j]] for j in kept]
    values, covariance = np.full(own.values.size, np.nan), np.zeros_like(own.covariance)
    values[kept] = found.values[order]
    covariance[np.ix_(kept, kept)] = found.covariance[np.ix_(order, order)]
    return Coefficients(own.columns, values, covariance), fit.left


def model_error(data: Corrected, own: ResidualMoments, elsewhere: ResidualMoments) -> ModelError:
    """What the model leaves on the held-out part, and what it leaves there without what belongs to its own flights.

    Nothing where that is no more than the noise may leave by chance.
    """
    pieces = [rows for a, b in data.held_out.pieces if np.any(own.usable[rows := data.held_out.rows[a:b]])]
    mach = np.concatenate([rec.motion.mach[data.samples_of(k)] for k, rec in enumerate(data.reconstructions)])
    places = np.array([float(np.mean(mach[rows])) for rows in pieces])
    apart = bool(np.all(np.isfinite(places))) and np.unique(places).size == places.size
    order = np.argsort(places) if apart else np.arange(places.size)
    pieces, count = [pieces[k] for k in order], len(pieces)
    before, here, after = MODEL_ERROR_WEIGHTS  # of every stretch and its neighbours
    near = here * np.eye(count) + before * np.eye(count, k=-1) + after * np.eye(count, k=1)
    weights = near if apart else np.ones((1, count))
    sigmas = [tuple(np.sqrt(_beyond(left, pieces, weights)).tolist()) for left in (own, elsewhere)]
    return ModelError(mach=tuple(places[order].tolist()) if apart else (), own=sigmas[0], elsewhere=sigmas[1])


def _beyond(left: ResidualMoments, pieces: Sequence[IntArray], weights: FloatArray) -> FloatArray:
    """Mean square of either coefficient beyond that of the noise, by weighted means (means, pieces) of pieces."""
    kept = [rows[left.usable[rows]] for rows in pieces]
    weights = weights * [rows.size for rows in kept]
    weights = weights / weights.sum(axis=1, keepdims=True)
    squares = np.array([np.mean(np.abs(left.body[rows]) ** 2) / 2.0 for rows in kept])
    noises = np.array([np.mean(left.noise[rows] ** 2) for rows in kept])
    parts = [part(left.body[rows] / left.noise[rows]) for part in (np.real, np.imag) for rows in kept]
    share = effective_samples(parts) / sum(part.size for part in parts)
    # Of a mean square with so many degrees of freedom, were it noise alone.
    errors = noises * np.sqrt(2.0 / np.maximum([2.0 * share * rows.size for rows in kept], 1.0))
    found, noise, error = weights @ squares, weights @ noises, np.sqrt(weights**2 @ errors**2)
    # Weighted means are nearly such a mean square again (Satterthwaite, Biometrics 2:110, 1946); of all of them, the
    # largest exceeds what chance gives one.
    freedom = 2.0 * (noise / error) ** 2
    most = noise * stats.chi2.isf(MODEL_ERROR_CHANCE / len(weights), freedom) / freedom
    return np.asarray(np.where(found > most, found - noise, 0.0), dtype=float)


def static_slopes(data: Corrected, found: Coefficients) -> tuple[Derivative, ...]:
    """Of each flight, what its wind-fixed terms make of dC_m,in/d alpha, at no angle of attack and at that flown."""

    def at(number: int, motion: Motion, alpha: FloatArray, places: IntArray) -> tuple[FloatArray, FloatArray]:
        slopes = slopes_at(data, motion, found.columns, number, alpha)[places]
        variance = np.einsum("nj,jk,nk->n", slopes, found.covariance, slopes)
        return slopes @ found.values, np.sqrt(np.maximum(variance, 0.0))

    motions = enumerate(each.motion for each in data.reconstructions)
    return tuple(along_flight(motion, number, partial(at, number, motion)) for number, motion in motions)


def slopes_at(
    data: Corrected, motion: Motion, columns: Sequence[Regressor], number: int, alpha: FloatArray
) -> FloatArray:
    """d C_m,in/d alpha (n, columns) per unit of each coefficient about angles of attack (n,) rad."""
    out = np.zeros((motion.time.size, len(columns)))
    more, less = (replace(motion, alpha=alpha + side * _STEP, history=None) for side in (1.0, 0.0))
    known: dict[tuple[str, Theta], dict[str, FloatArray]] = {}
    for j, column in enumerate(columns):
        mechanism, key = data.frame.mechanisms[column.mechanism], (column.mechanism, column.theta)
        if not (column.acts_on(number) and _is_static(mechanism)):
            continue
        if key not in known:
            ends = (mechanism.terms(each, dict(column.theta)) for each in (more, less))
            known[key] = {high.name: (high.in_plane - low.in_plane) / _STEP for high, low in zip(*ends, strict=True)}
        out[:, j] = known[key][column.term] * column.time_basis(motion.coefficient_time)
    return out


def _is_static(mechanism: Mechanism) -> bool:
    """Whether its moment lies in the plane of alpha, and is one of the angle of attack and the flow alone."""
    if not isinstance(mechanism, YamlMechanism):
        return mechanism.wind_fixed
    return all(
        term.axis == "in_plane" and not (term.turn or term.delay) and all(f.of in _FLOW for f in term.factors)
        for term in mechanism.definition
    )


def maximum_likelihood(fit: Fit) -> MaximumLikelihood:
    """The likelihood's block of the result, in the form of `compare`'s; a failure is its status and message.

    On a record that limits the reconstruction the search takes long and seldom ends: it is left out.
    """
    data, model, columns, values = fit.data, fit.model, fit.model.columns, fit.values
    reason = ""
    if len(data.records) > 1:
        reason = "with several flights, terms of a single flight cannot be fitted"
    elif data.reconstructions[0].status == "degraded":
        reason = "the reconstruction is limited by the record, and the search would rarely converge"
    if reason:
        return MaximumLikelihood(status="left out", iterations=0, log_likelihood=None, message=reason)
    known_schedule = _known_schedule(fit)
    if known_schedule is not None:
        column = Regressor(known_schedule.name, "C_malpha by the schedule", (), _ALWAYS, "1")
        data = replace(data, frame=data.frame.with_mechanisms([known_schedule]))
        columns, values = (*columns, column), np.append(values, 1.0)
    fixed = {(each.effect.name, each.component): each.value for each in model.applied}
    regressed = Regressed.of(fit.problem, fit.data.frame, model.columns, *fit.solution).beside([fixed])
    found = identify(data.frame, columns, values, regressed=regressed, max_iterations=LIKELIHOOD_STEPS)
    terms = Coefficients(found.columns, found.values, found.covariance)
    return likelihood_block(found, terms.estimates(data))


def _known_schedule(fit: Fit) -> KnownSlopeSchedule | None:
    """What the baseline's slope is more by its schedule, which the likelihood knows no prior of; None for a trifle."""
    schedule = fit.model.mechanisms.get(SlopeSchedule.name)
    if not isinstance(schedule, SlopeSchedule):
        return None
    found = schedule.known_schedule(tuple(v for c, v in fit.increments.items() if c.mechanism == schedule.name))
    motion = fit.data.reconstructions[0].motion
    own = found.terms(motion, {})[0].in_plane
    slope = sum(v for c, v in zip(fit.model.columns, fit.values, strict=True) if c.term == "C_malpha")
    return found if np.linalg.norm(own) > SCHEDULE_TRIFLE * abs(slope) * np.linalg.norm(motion.alpha) else None
