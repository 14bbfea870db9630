"""`predict`: what a model that was found on other flights, its coefficients frozen, says of this one.

The prediction interval has the noise, what coefficients, times and the record's errors within tolerances make to first
order beside all that is fitted along, and the model's own error (`ModelError`) on stretches that took no part in its
fit. What is fitted along takes some of the noise with it where it is fitted, and brings its own error elsewhere.

The attitude integrates the noise that the rates show, and the static moment follows it: of noise at a frequency f, the
difference of measured and modelled moment has 1 - (f_n / f)^2, f_n being that of the motion (`noise_share`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from scipy.linalg import block_diag
from threadpoolctl import threadpool_limits

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from brv_hypo.comparison.judgement import processes
from brv_hypo.comparison.summary import estimates, flight_summary, record_summary
from brv_hypo.errors import UsageError
from brv_hypo.flight import FlightSource, load_flight, one_flight
from brv_hypo.flight.derived import averaged
from brv_hypo.flight.record import Flight
from brv_hypo.inference.derivatives import per_coefficient, scale_variance, slope
from brv_hypo.inference.evidence import Evidence
from brv_hypo.inference.refinement import prediction_slopes, shift_sigma
from brv_hypo.io.text import times
from brv_hypo.linearisation.channels import HELD_OUT_SHORTEST, first_values
from brv_hypo.linearisation.frame import ResidualMoments
from brv_hypo.linearisation.linear import lengths, solve_scaled
from brv_hypo.linearisation.nuisance import Errors
from brv_hypo.mechanisms.conformance import sample_motion, uniform_time
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect, current_name
from brv_hypo.mechanisms.registry import find_installed, installed, nuisance_effects, nuisance_mechanisms
from brv_hypo.model.baseline import StaticBend
from brv_hypo.model.model import Model, SavedModel, digest, read_model, restored
from brv_hypo.motion import try_record
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.signals import middle_weights
from brv_hypo.prediction import result
from brv_hypo.prediction.changes import find_differences, find_local_change, fixed_within
from brv_hypo.prediction.result import Difference, ErrorsOfPrediction, LocalChange, ModelSource, Prediction
from brv_hypo.progress import Progress, report_to
from brv_hypo.settings import settings_of, takes_settings
from brv_hypo.thresholds import REFUSED
from brv_hypo.tracing.baseline import is_bend
from brv_hypo.tracing.families import beside_processes
from brv_hypo.tracing.final_model import pair
from brv_hypo.tracing.fit import Corrected, Fit, Flights, correct, fitted_about, next_corrections, require_samples
from brv_hypo.tracing.result import TRACED_SMALLEST, ModelSummary, Trace, TraceConfig, TraceSettings

# Held by `tests.studies.independent.sisters`: what the frozen model explains, and what its band holds.
BAND_SIGMAS = 1.96  # standard deviations on either side of the prediction
BAND_LEVEL = 0.95  # share of a normal distribution between them
BAND_LEAST_NOISE = 0.1  # share of the noise that a fit leaves at least
BAND_FREQUENCIES = 2048  # up to half the sample rate, that the noise of moments is summed over
PREDICTED_BLOCKS = 8  # at least, of the record's: the fewest that a trace may be set to cut it into
PREDICTED_LINEARISATIONS = 2  # where errors of the record are fitted
_REGIONS = 8  # stretches of the record whose errors are reported apart
_OF_THE_MOTION = ("motion", "force")  # what every fit finds anew: how the flight began, and the force that shows it
_CUTOFF = 1e-12  # singular values of what is fitted that count, of the largest
_MOST_SHOWN = 2000  # samples of the interval that are reported: a picture has no more
_Spans = Sequence[tuple[float, float]]
INSTRUMENTS = "instruments"  # what `refit` calls all errors of record and vehicle that the tolerances allow


@takes_settings(
    TraceConfig,
    model="Trace, its `model`, SavedModel, str or Path\n    What `trace` returned, the model of it, or a file that "
    "holds either.",
    refit="str or sequence of str\n    What belongs to this vehicle and is fitted here: mechanisms, coefficients, "
    "errors of the record;\n    `instruments` stands for all of these, within their tolerances.",
)
def predict(
    flight: FlightSource,
    model: Trace | ModelSummary | SavedModel | str | Path,
    refit: Sequence[str] | str = (),
    config: TraceConfig | Mapping[str, Any] | str | Path | None = None,
    *,
    progress: Progress | None = None,
    **settings: Unpack[TraceSettings],
) -> Prediction:
    """Errors of the moments that a frozen model predicts for a flight.

    Errors of the record that the model holds, within tolerances or beyond, are those of its own flight, and are left
    out, unless this is that flight (its file, or a copy of its record); so is what belongs to its times, unless `refit`
    names it. On its own record nothing is tested, nor where next to no samples are at Mach numbers and angles of attack
    that the model was found at. What the model left on stretches held out where it was found widens the band. A record
    that contradicts itself is predicted as it is; `record` of the result says so.

    Returns
    -------
    Prediction
        Errors (mean squares of the moment coefficients), by region too, and the prediction interval.

    Examples
    --------
    >>> import brv_hypo
    >>> flown, sister = (brv_hypo.simulate("research_cone", seed=seed, sample_rate=50.0) for seed in (1, 2))
    >>> traced = brv_hypo.trace(flown, effects=["magnus"], discover=False)
    >>> brv_hypo.predict(sister, traced).ratio < 0.01
    True
    """
    report_to(progress)(0.0, "predicting the moments")
    summary = model.model if isinstance(model, Trace) else model
    saved = summary.definition if isinstance(summary, ModelSummary) else summary
    if not isinstance(saved, SavedModel | str | Path):
        raise UsageError(f"got {type(saved).__name__} for a model, expected what `trace` returned, or a file of it.")
    named = refit.split(",") if isinstance(refit, str) else refit
    refitted = tuple(current_name(name.strip()) for name in named if name.strip())
    path = None if isinstance(saved, SavedModel) else Path(saved)
    chosen = settings_of(TraceConfig, config, settings, ["refit"])
    content = saved if isinstance(saved, SavedModel) else read_model(Path(saved))
    own = one_flight(flight)
    record = averaged(own)  # as `trace` has it
    most = record.samples // HELD_OUT_SHORTEST  # blocks, by which nothing is chosen here
    fewest = PREDICTED_BLOCKS * HELD_OUT_SHORTEST
    require_samples(record, fewest, "know its motion and noise. Widen --start and --stop.")
    chosen = chosen.model_copy(update={"blocks": min(chosen.blocks, most)})
    with threadpool_limits(limits=1, user_api="blas"):
        found = _predict(record, content, path, refitted, chosen)
    return found.model_copy(update={"record": record_summary([try_record(own)[1]])})


def _predict(
    flight: Flight, content: SavedModel, path: Path | None, refit: tuple[str, ...], config: TraceConfig
) -> Prediction:
    found_on, number = content.found_on, _found_on(content, flight)
    here = number is not None
    content = content.of_as_many(1) if number is None else content.of_flight(number)
    if here:  # all of it was flown
        content = content.model_copy(update={"flown": {}})
    own_spans = [] if here else _own_spans(content, flight)
    fit, places, left_out = _frozen(flight, content, refit, config, here, own_spans)
    data, columns, tolerated = fit.data, fit.model.columns, _tolerated(flight)
    within = _freed(fit, tolerated)
    # What `--refit` would name as well to let record and vehicle err; nothing where all of it is fitted already.
    more = [name for name in tolerated if name in {c.mechanism for c in columns} and name not in refit]
    more += [] if INSTRUMENTS in refit else [INSTRUMENTS]
    measured, left, left_within = data.moments(data.frame.observed), fit.left if more else within.left, within.left
    own = _freed(within, tuple(column.mechanism for column in columns)).left
    errors = ErrorsOfPrediction(
        without=measured.mean_square(),
        frozen=left.mean_square(),
        within=left_within.mean_square(),
        own=own.mean_square(),
        noise=measured.mean_square_of_noise(),
    )
    # Coefficients that are fitted here are beside errors within tolerances.
    fixed, covariance = fit.known[: len(columns)], within.covariance[: len(columns), : len(columns)].copy()
    known, stated, bare, scale = _uncertain(fit, content, places)
    moved = _moved_by_times(fit, content, places)
    change, differences, differs, misfit, far = None, tuple[Difference, ...](), False, float("nan"), tuple[str, ...]()
    covariance[np.ix_(known, known)] = stated
    terms = estimates(columns, np.where(np.isfinite(fixed), fit.values, within.values), covariance, data.frame)
    motion, samples, flown = data.frame.motions[0], data.frame.samples(0), _flown(content, data, own_spans)
    mach = motion.mach[samples]
    beyond = np.zeros(mach.shape) if content.error is None else content.error.at(mach)
    # A test of estimates against the record that they are of would count it twice, and one on next to no samples that
    # the model is known at would be one of its extrapolation.
    if not here and flown.sum() >= TRACED_SMALLEST:

        def differ(own: Evidence) -> FloatArray:
            """What fixed coefficients may differ by on two flights that both have processes, or have none."""
            return (stated if own.rows.groups else bare) + scale

        about = fit
        for again in (False, True):  # about this flight's own, where one that is far off moves the vehicle elsewhere
            every = beside_processes(about, about.model, about.problem.rows.part)
            every = replace(every, rows=every.rows.allowing(moved))
            alone = every.evidence([], ())
            better = max(alone, every.null, key=lambda each: each.level)
            differences = find_differences(better, terms, fixed, differ(better))
            differs = any(each.p_value < REFUSED for each in differences)
            if again or not differs:
                break
            here_is = {(each.mechanism, each.term): each.frozen + each.value for each in differences}
            pairs = zip(terms, fit.values.tolist(), strict=True)
            moved_to = np.array([here_is.get((each.mechanism, each.name), value) for each, value in pairs])
            moving = fitted_about(fit.data, fit.model, moved_to)
            about = replace(moving, problem=moving.problem.on(fit.problem.rows.part), known=fit.known)

        def changed(places: Sequence[int]) -> tuple[LocalChange | None, Evidence]:
            """A change between two times beside some of the fixed coefficients within their covariance."""
            agreed = np.where(np.isin(np.arange(len(columns)), known[places]), fixed, np.nan)
            pair = ((each, differ(each)[np.ix_(places, places)]) for each in (alone, every.null))
            own, beside_all = (fixed_within(each, columns, agreed, there) for each, there in pair)
            return find_local_change(own, beside_all), own

        change, within_both = changed(range(known.size))
        misfit = min(_misfit(better), _misfit(within_both, 0.0 if change is None else change.f_ratio))
        far = tuple(each.sized for each in processes(better) if each.is_far and each.is_of_moment)
        if change is not None and differs:
            # Nothing changes between two times where nothing does beside the coefficients that differ throughout.
            differing = {(each.mechanism, each.term) for each in differences}
            same = [k for k, j in enumerate(known) if (terms[j].mechanism, terms[j].name) not in differing]
            change = change if changed(same)[0] is not None else None
    remain = np.flatnonzero(np.isfinite(within.known[: len(columns)]))
    slopes = per_coefficient(data.frame, columns, 0, motion, motion.alpha, slope) @ within.values
    stiffness, modes = slopes * data.records[0].moment_scale, fit.problem.rows.nuisances.flights[0].walks.size // 2
    noise = measured.noise * np.sqrt(noise_share(data.records[0], stiffness[samples], modes))
    # What processes make of the model's errors is in what it left on blocks held out.
    covariance[np.ix_(known, known)] = bare
    sigma = predictive_sigma(within, covariance[np.ix_(remain, remain)], moved, noise, beyond)
    band = band_of(data.frame.time, measured, left_within, sigma, beyond, flown)
    found = Prediction(
        flight=flight_summary(flight),
        model=ModelSource(path=None if path is None else str(path), found_on=found_on),
        frozen=tuple(terms[k] for k in known),
        refitted=tuple(term for k, term in enumerate(terms) if k not in known),
        error=errors,
        ratio=errors.frozen / errors.without,
        explained=1.0 - _unexplained(measured, left, errors.noise, flown),
        flown=float(flown.mean()),
        band=band,
        regions=_regions(data, measured, left),
        local_change=change,
        difference=next(iter(differences), None),
        further_differences=differences[1:],
        refused=change is not None or differs,
        misfit=misfit,
        far_processes=far,
        left_out=left_out,
        own_record=here,
        of_own=1.0 if here else sum(flight.window(*span).samples for span in own_spans) / flight.samples,
        reason="",
    )
    fitted = 1.0 - _unexplained(measured, own, errors.noise, flown)
    rest, freely = (_unexplained(measured, each, errors.noise) for each in (left, left_within))
    remedy = ",".join((*refit, *more)) if more and not (here and content.errors) else ""
    return found.model_copy(update={"reason": result.reason(found, fitted, rest, freely, remedy)})


def _misfit(own: Evidence, gain: float = 0.0) -> float:
    """The rms residual over the record's noise, whose level has a narrow prior; a term of this F-ratio taken out."""
    squares = float(np.sum(own.residual[own.rows.counted] ** 2)) - gain * own.noise**2
    return own.rows.noise_ratio * math.sqrt(max(squares, 0.0) / own.rows.size)


# ---- The frozen model on this flight ----


def _freed(fit: Fit, names: tuple[str, ...]) -> Fit:
    """The same with record and vehicle free to err: these effects, and the columns of these mechanisms."""
    own = [*(column.mechanism for column in fit.model.columns), *(item.name for item in fit.nuisances)]
    return replace(fit, known=np.where(np.isin(own, names), np.nan, fit.known))


def _frozen(
    flight: Flight, content: SavedModel, refit: tuple[str, ...], config: TraceConfig, here: bool, own_spans: _Spans
) -> tuple[Fit, IntArray, tuple[str, ...]]:
    """The model on this flight, its coefficients and the errors of record and vehicle fixed but for what is fitted
    here, where the model is known if that is enough of the record; where its columns are in the file; and the
    mechanisms that are left out, which belong to times of the model's own flights, unless this one is (`here`).
    """
    model = restored(content, (flight,), frozen=True)
    columns, place = model.columns, {column: k for k, column in enumerate(model.columns)}
    refit = tuple(_in_model(model, name) for name in refit)
    to_refit = {column for column in columns if {column.mechanism, column.term} & set(refit)}
    changes = [c.time_basis.start for c in to_refit if c.time_basis.kind != "constant"]
    ends = flight.time[[0, -1]].tolist()
    if changes and len(content.times) == 1 and not any(ends[0] < each < ends[1] for each in changes):
        where = f"--refit {','.join(refit)}: its times are the model's, and none is within the record, {times(*ends)}"
        raise UsageError(f"{where}: it cannot be estimated. Leave it out, or give the record the model's clock.")
    if not here:  # without what belongs to the times and to the instruments of its own flights
        kept = tuple(c for c, lasts in zip(columns, model.lasting, strict=True) if lasts or c in to_refit)
        model = model.but(columns=kept, applied=())
    left_out = tuple(dict.fromkeys(c.mechanism for c in columns if c not in model.columns))
    source = Flights((flight,), config)
    model, effects = _with_refitted(model, refit, source)
    own_errors = {(each.effect, each.component): each.value for each in content.errors if here}
    known = {column: saved.value for column, saved in zip(columns, content.columns, strict=True)}
    fixed = np.array([np.nan if c in to_refit else known.get(c, np.nan) for c in model.columns], dtype=float)

    def read_with(corrections: Errors, own: FloatArray | None = None) -> Fit:
        """The model where these are taken out of the record and `effects` are free within their tolerances. A delay
        looks back to the moment that this flight's `own` coefficients (columns,) make, plain ones where not given.
        """
        data = correct(source, model, (corrections,))
        there = _flown(content, data, own_spans)
        part = data.part_where(there) if there.sum() >= TRACED_SMALLEST else data.whole
        values = first_values(data.frame, data.whole, model.columns) if own is None else own
        data = data.with_in_plane_moment(model.columns, values)
        fit = fitted_about(data, model, np.where(np.isnan(fixed), values, fixed))
        # What has no prior was found on this very record, and is taken out of it; so are errors that are known.
        held = fixed.tolist()
        for item in fit.nuisances:
            beyond = (own_errors.get((item.name, item.component), 0.0) - (item.applied or 0.0)) / item.size
            free = item.name in (*_OF_THE_MOTION, *effects)
            held.append(np.nan if free else beyond if np.isfinite(item.present) else 0.0)
        return replace(fit, problem=fit.problem.on(part), known=np.array(held))

    places = np.array([place.get(column, -1) for column in model.columns])
    corrections = next_corrections(0, flight, model, own_errors, {})
    delays, own = any(column.theta for column in model.columns), fixed if here else None
    found = list[tuple[float, Fit]]()
    for _ in range(1 + PREDICTED_LINEARISATIONS * bool(effects or (delays and not here))):
        last = read_with(corrections, own)
        own, errors = _within(last, content, places)
        mine = np.array([False] * len(model.columns) + [item.name in effects for item in last.nuisances])
        fitted = np.append(np.full(len(model.columns), np.nan), errors)
        found.append((last.left.mean_square(), replace(last, known=np.where(mine, fitted, last.known))))
        beside = last.problem.rows.nuisances.values(errors, 1)[0]
        free = {name: value for name, value in beside.items() if name[0] in effects}
        corrections = next_corrections(0, flight, model, free, corrections)
    # A record that the model explains badly may have another motion without them, which it explains worse. The first is
    # about a plain moment, whose errors are those of a lag's fraction.
    about = found[-PREDICTED_LINEARISATIONS:] if delays else found
    return min(about, key=lambda each: each[0])[1], places, left_out


def _uncertain(fit: Fit, content: SavedModel, places: IntArray) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Columns of fixed coefficients, their covariance, that without processes, and that of pressure and inertia."""
    fixed = fit.known[: places.size]
    known = np.flatnonzero(np.isfinite(fixed))
    stated, bare = (each[np.ix_(places[known], places[known])] for each in content.known_covariance)
    return known, stated, bare, 2.0 * scale_variance(fit.problem) * np.outer(fixed[known], fixed[known])


def _moved_by_times(fit: Fit, content: SavedModel, places: IntArray) -> ComplexArray:
    """What a sigma of each delay and knot, with shifts by filters, does to the rates (frame rows, parameters)."""
    nonlinear, step = fit.nonlinear, shift_sigma(fit.data.flights[0].step)
    known = [content.columns[places[each.columns[0]]].time_errors.get(each.name, 0.0) for each in nonlinear]
    sigmas = np.hypot(known, [step * (each.kind == "knot") for each in nonlinear])
    return np.asarray(prediction_slopes(nonlinear, fit.model.columns, fit.values, fit.data.frame) * sigmas)


def _within(fit: Fit, content: SavedModel, places: IntArray) -> tuple[FloatArray, FloatArray]:
    """Coefficients (columns,) and nuisances (unknowns,) where fixed coefficients may differ by what they are known to:
    exact ones err at the expense of the record, whose errors were 15 tolerances beside a coefficient 0.8 % off.
    """
    known, _, bare, scale = _uncertain(fit, content, places)
    columns, covariance = fit.model.columns, bare + scale
    design, values, free = _freed(fit, tuple(column.mechanism for column in columns)).all_unknowns
    variances, directions = np.linalg.eigh(covariance)
    inverse = (directions / np.sqrt(np.maximum(variances, _CUTOFF * variances.max(initial=0.0)))).T
    prior = np.zeros((known.size, design.shape[1]))
    prior[:, known] = inverse
    response = fit.problem.raw_response - design @ np.where(free, 0.0, values)
    both = np.vstack([design, prior])[:, free]
    values[free] = solve_scaled(both, np.append(response, inverse @ fit.known[known]))
    return values[: places.size], values[values.size - len(fit.nuisances) :]


def _in_model(model: Model, name: str) -> str:
    """The name of the model's bend, where a mechanism of this name is the very same moment; else the name."""
    item = installed()[name].item if name in installed() and StaticBend.name in model.mechanisms else None
    return StaticBend.name if isinstance(item, Mechanism) and is_bend(item, sample_motion(uniform_time())) else name


def _found_on(content: SavedModel, flight: Flight) -> int | None:
    """Which of the model's own records this is, or a part of which; None for another flight, if by the same name."""
    if (own := digest(flight)) in content.digests:
        return content.digests.index(own)
    first, last, path = float(flight.time[0]), float(flight.time[-1]), Path(flight.path)
    spans = [(start, stop) for start, stop in content.times if start <= first and last <= stop]
    if not spans or not path.is_file() or path.name not in {Path(name).name for name in content.found_on}:
        return None
    parts = (digest(load_flight(path).window(*span)) for span in spans)
    return next((content.digests.index(part) for part in parts if part in content.digests), None)


def _own_spans(content: SavedModel, flight: Flight) -> _Spans:
    """From when to when (s) another record has the samples that the model was estimated from."""
    inside = ((a, b) for a, b in content.times if np.sum((flight.time >= a) & (flight.time <= b)) >= TRACED_SMALLEST)
    return [span for span in inside if digest(flight.window(*span)) in content.digests]


def _tolerated(flight: Flight) -> tuple[str, ...]:
    """What record and vehicle may err by within their tolerances."""
    return (*(effect.name for effect in nuisance_effects()), *(m.name for m in nuisance_mechanisms(flight)))


def _with_refitted(model: Model, refit: tuple[str, ...], source: Flights) -> tuple[Model, tuple[str, ...]]:
    """The model with refitted mechanisms that it lacks, and which names are of record and vehicle."""
    known, effects = {name for column in model.columns for name in (column.mechanism, column.term)}, list[str]()
    for name in refit:
        item = None if name in known or name == INSTRUMENTS else find_installed(name)
        searched = [parameter.name for parameter in item.parameters()] if isinstance(item, Mechanism) else []
        if isinstance(item, RecordEffect) and not item.carried and name not in {a.effect.name for a in model.applied}:
            searched = ["time"]
        if searched:
            compared = f"`compare --mechanisms {name}`, and by " if isinstance(item, Mechanism) else ""
            raise UsageError(
                f"--refit {name}: the model has no {name} of this flight, and its {searched[0]} is not known: it is "
                f"searched for by {compared}`trace`, whose model then has it. Leave {name} out, or predict with such a "
                "model."
            )
        if isinstance(item, Mechanism):
            model = model.with_terms(item, correct(source, model).frame.motions[0])
        elif item is not None:
            effects.append(name)
        elif name == INSTRUMENTS:
            effects += _tolerated(source.records[0])
    return model, tuple(effects)


# ---- The prediction interval: how far the measured moments may lie from the model's, noise included ----


def noise_share(record: InertialRecord, stiffness: FloatArray, modes: int) -> FloatArray:
    """Variance of the residual moments' noise over that of the measured ones' (n,). `stiffness` (n,) 1/s^2 is the
    static moment's slope, times its scale; negative where it restores. Slower than `modes` it is fitted.
    """
    spin, flight = record.spin_rate, record.flight
    frequency = np.pi * (np.arange(BAND_FREQUENCIES) + 0.5) / BAND_FREQUENCIES
    weights = middle_weights(spin.order, spin.half_width)
    power = np.abs(np.exp(1j * np.outer(frequency, np.arange(weights.size))) @ weights) ** 2
    faster = frequency > np.pi * modes * flight.step / record.time[-1]
    first, second = (float(np.sum((power / frequency**k)[faster]) / np.sum(power)) for k in (2, 4))
    turned = stiffness * flight.step**2
    return np.asarray(1.0 + 2.0 * first * turned + second * turned**2, dtype=float)


def predictive_sigma(
    fit: Fit, covariance: FloatArray, moved: ComplexArray, noise_sigma: FloatArray, beyond: FloatArray
) -> ComplexArray:
    """Standard deviation of the residual moments (rows,), of C_m as real part and of C_n as imaginary one.
    `covariance` is that of the fixed coefficients (fixed columns, fixed columns), `moved` (rows, times) what one
    standard deviation of each delay and knot makes of the rates; `noise_sigma` (rows,) is of the moments' noise,
    `beyond` (rows,) of what the model lacks.
    """
    problem, frame, (design, _, free) = fit.problem, fit.data.frame, fit.all_unknowns
    scale = lengths(design[:, free])
    solved = np.linalg.pinv(design[:, free] / scale, rcond=_CUTOFF) / scale[:, np.newaxis]
    constants = np.zeros((frame.observed.size, 2 * len(problem.rows.part.levels)))  # show in no moment
    nuisances = problem.rows.nuisances.histories(np.eye(len(fit.nuisances))).rates
    moments = fit.data.moments(np.column_stack([frame.columns(fit.model.columns), constants, nuisances, moved])).body
    design = np.column_stack([design, problem.rows.of_moments(moved)])
    fixed = np.append(~free, np.ones(moved.shape[1], dtype=bool))
    of_fitted = moments[:, ~fixed]
    slopes = moments[:, fixed] - of_fitted @ (solved @ design[:, fixed])
    known = block_diag(covariance, np.eye(slopes.shape[1] - covariance.shape[0]))
    # The level of the noise that the rates are weighed with, over that of the gyros.
    raised = problem.rows.noise.rates.sigma / float(np.median([record.gyro_sigma for record in problem.records]))
    inside = np.zeros(noise_sigma.size, dtype=bool)
    inside[problem.rows.part.rows] = True
    parts = []
    for own, response in ((slopes.real, of_fitted.real @ solved), (slopes.imag, of_fitted.imag @ solved)):
        share = raised**-2 * np.sum(response**2, axis=1) / noise_sigma**2  # of the noise, that what was fitted has
        after = np.where(inside, np.maximum(1.0 - share, BAND_LEAST_NOISE), 1.0 + share)
        variance = (noise_sigma**2 + beyond**2) * after
        parts.append(np.sqrt(variance + np.maximum(np.sum((own @ known) * own, axis=1), 0.0)))
    return np.asarray(parts[0] + 1j * parts[1])


def band_of(
    time: FloatArray,
    measured: ResidualMoments,
    left: ResidualMoments,
    sigma: ComplexArray,
    model_sigma: FloatArray,
    flown: BoolArray,
) -> result.PredictionBand:
    """The band and the share of samples in it where the model is known; `model_sigma`: its own part of `sigma`."""
    kept, counted = np.flatnonzero(left.usable), left.usable & flown
    inside = [np.abs(getattr(left.body, axis)) <= BAND_SIGMAS * getattr(sigma, axis) for axis in ("real", "imag")]
    shown = kept[:: max(1, -(-kept.size // _MOST_SHOWN))]
    return result.PredictionBand(
        level=BAND_LEVEL,
        inside=float(np.mean([axis[counted] for axis in inside])) if np.any(counted) else 0.0,
        model_error=float(np.sqrt(np.mean(model_sigma[counted] ** 2))) if np.any(counted) else 0.0,
        time_s=tuple(time[shown].tolist()),
        measured=pair(measured.body[shown]),
        predicted=pair((measured.body - left.body)[shown]),
        half_width=pair(BAND_SIGMAS * sigma[shown]),
    )


# ---- Errors and shares ----


def _regions(data: Corrected, measured: ResidualMoments, left: ResidualMoments) -> tuple[result.Region, ...]:
    """Errors over even stretches of the record, with the Mach numbers that each runs through."""
    time, mach = data.frame.time, data.frame.motions[0].mach[data.frame.samples(0)]
    found = []
    for start, stop in itertools.pairwise(np.linspace(time.min(), time.max(), _REGIONS + 1).tolist()):
        inside = (time >= start) & (time <= stop) & left.usable
        if not np.any(inside):
            continue
        own, ratio = mach[inside], left.mean_square(inside) / measured.mean_square(inside)
        ends = (float(own.min()), float(own.max())) if np.all(np.isfinite(own)) else None
        found.append(result.Region(start_s=start, stop_s=stop, mach=ends, ratio=ratio))
    return tuple(found)


def _flown(content: SavedModel, data: Corrected, own_spans: _Spans) -> BoolArray:
    """Where the model's flights flew in Mach number and angle of attack, less its own record (rows,)."""
    motion, samples = data.frame.motions[0], data.frame.samples(0)
    there = np.ones(samples.size, dtype=bool)
    for name, (low, high) in content.flown.items():
        values = getattr(motion, name)[samples]
        there &= ~((values < low) | (values > high))
    for start, stop in own_spans:
        there &= (data.frame.time < start) | (data.frame.time > stop)
    return there


def _unexplained(
    measured: ResidualMoments, left: ResidualMoments, noise: float, kept: BoolArray | slice = slice(None)
) -> float:
    """The share of the moments' mean square, noise aside, that a model does not explain over all or some samples."""
    if not np.any(left.usable[kept]):
        return 1.0
    return max(left.mean_square(kept) - noise, 0.0) / max(measured.mean_square(kept) - noise, 1e-300)
