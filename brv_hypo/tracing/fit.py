"""A model fitted to flights: their records as the model reads them, its regression, coefficients and errors.

`correct` takes a model's errors out of the records and reconstructs them: `Corrected`, with the part that is fitted and
the blocks that are held out. `Fit` is a model on it. `converged` linearises where the errors that the tolerances allow
are nearly taken out, and about the model's own coefficients.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy import stats

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight.record import Flight
from brv_hypo.inference.build import linearised_flights, on_rows
from brv_hypo.inference.fit import HypothesisFit, fit_hypothesis
from brv_hypo.inference.noise import estimated_noise, first_noise, raised_noise
from brv_hypo.inference.problem import GivenColumns, Problem, WhitenedRows
from brv_hypo.inference.reduced import Reduced
from brv_hypo.inference.refinement import ROUGH, Nonlinear, Steps, nonlinear_parameters, prediction_slopes, refine
from brv_hypo.likelihood.statistics import whiteness
from brv_hypo.linearisation.channels import Channels, Noise, Part, first_values, part, split, whole
from brv_hypo.linearisation.frame import RateFrame, ResidualMoments, build_frame, residual_moments
from brv_hypo.linearisation.linear import covariance_of, solve_scaled
from brv_hypo.linearisation.nuisance import Errors, Nuisance, nuisances, on_frame
from brv_hypo.linearisation.response import LinearisedFlight, linearisation_point
from brv_hypo.mechanisms.contract import RecordEffect
from brv_hypo.mechanisms.registry import nuisance_effects, without
from brv_hypo.model.model import TOLERATED, Applied, Model
from brv_hypo.model.reconstruction import reconstruct
from brv_hypo.model.term import Regressor, TimeBasis, default_knots
from brv_hypo.motion import ReconstructionConfig
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.motion import plane_from_body
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.motion.responses import superposed
from brv_hypo.thresholds import NOISE_EXCESS
from brv_hypo.tracing.result import WHITE_CHANCE, Residual, TraceConfig

# Revised on seeds 171100 to 174044 of `tests.studies.independent.loop_study`, and held by its fresh ones.
MODEL_LINEARISATIONS = 2  # with what the tolerances allow taken out of the record
MODEL_PLAUSIBLE = 3.0  # tolerances up to which an error is taken out: a larger one is what the model lacks
MODEL_MOMENT_ROUNDS = 2  # of the in-plane moment that a delay looks back to, and of the columns that make it
MODEL_OWN_POINTS = 4  # linearisations about a model's own coefficients at most, while what is left falls
MODEL_TRIFLE = 1.01  # over the mean square before: 1 % is what noise moves it by
WHITE_LAGS = 20  # samples, of the test of whiteness (Ljung and Box, Biometrika 65:297, 1978)
REPORTED_REGIONS = 8  # parts of a record, of which the worst is reported


def require_samples(flight: Flight, fewest: int, to: str) -> None:
    """UnanswerableError for a record that holds too few samples to do what the sentence goes on with."""
    if flight.samples < fewest:
        known = f"the record holds {flight.samples} samples in the window, expected at least {fewest}"
        raise UnanswerableError(f"{known}: too few to {to}")


@dataclass(frozen=True)
class Flights:
    """Flights and the settings that they are traced by; what each reads without a model's errors is found once."""

    records: tuple[Flight, ...]
    config: TraceConfig
    _known: dict[tuple[int, str], tuple[InertialRecord, Reconstruction]] = field(default_factory=dict, repr=False)

    def read(self, number: int, model: Model, corrections: Errors) -> tuple[InertialRecord, Reconstruction]:
        """One flight without its errors that a model holds, and `corrections` besides, where it is linearised."""
        own = tuple(applied for applied in model.applied if applied.flight == number)
        if corrections or (number, repr(own)) not in self._known:
            settings, read = ReconstructionConfig(method=self.config.method), without(self.records[number], corrections)
            read = superposed(read, [each.effect.perturb(read, each.component, -each.value) for each in own])
            found = reconstruct(read, settings)
            if corrections or own:  # warnings are of the record as it reads
                found = replace(found, warnings=self.read(number, Model(), {})[1].warnings)
            point = linearisation_point(found, settings)
            if corrections:  # not read again
                return point
            self._known[number, repr(own)] = point
        return self._known[number, repr(own)]


@dataclass(frozen=True)
class Corrected:
    """The records of flights without what a model takes out of them, reconstructed. Blocks held out of the fit are
    `deciding` what is added, or `reported`: their errors take no part in any choice. `corrections`, one a flight, are
    the errors that were found within the tolerances. The regression knows them by their priors still, but is linearised
    where those of the record are corrected and those of the vehicle act.
    """

    source: Flights
    records: tuple[InertialRecord, ...]
    frame: RateFrame
    fitted: Part
    deciding: Part
    reported: Part
    whole: Part
    corrections: tuple[Errors, ...]

    @property
    def flights(self) -> tuple[Flight, ...]:
        """The records as they are read."""
        return tuple(reconstruction.flight for reconstruction in self.frame.reconstructions)

    def part_where(self, chosen: BoolArray) -> Part:
        """The rows that are chosen (frame rows,)."""
        return part(self.frame, self.whole.valid, chosen, shared=True)

    def with_in_plane_moment(self, columns: tuple[Regressor, ...], values: FloatArray | None = None) -> Corrected:
        """With C_mw of Eq. 5.1 where columns depend on its past, by coefficients (columns,), or plain, biased ones."""
        data = self
        for _ in range(MODEL_MOMENT_ROUNDS if any(column.theta for column in columns) else 0):
            known = first_values(data.frame, data.fitted, columns) if values is None else values
            data = replace(data, frame=data.frame.with_in_plane_moment(columns, known))
        return data

    def moments(self, rates: ComplexArray) -> ResidualMoments:
        """Moment coefficients of derolled rates (rows,)."""
        return residual_moments(self.frame, self.records, rates)

    def linearised(self, model: Model, values: FloatArray) -> tuple[LinearisedFlight, ...]:
        """Each flight, linearised about the model with coefficients (columns,) and its vehicle's known errors."""
        vehicle = model.tolerated(self.flights[0])
        return linearised_flights(self.frame, self.records, model.columns, values, vehicle, self.corrections)

    def regression(
        self,
        model: Model,
        linear: Sequence[LinearisedFlight],
        given: Mapping[str, Channels] | None = None,
        processes: Sequence[RecordEffect] = (),
    ) -> Problem:
        """The model's regression on the fitted part, under white noise; `given` are histories that may become columns.
        Components of effects that the model holds are free, others bounded by tolerances; `processes` may act.
        """
        frame, config, effects = self.frame, self.source.config, (*nuisance_effects(), *processes)
        free: list[dict[tuple[str, str], RecordEffect]] = [{} for _ in linear]
        for each in model.applied:
            free[each.flight][each.effect.name, each.component] = each.effect
        vehicle = model.tolerated(self.flights[0])
        unknown = nuisances(frame, linear, effects, vehicle, free, self.corrections)
        return Problem(
            frame=frame.with_mechanisms([GivenColumns()]),
            records=self.records,
            force=on_rows(frame, linear)[0],
            rows=WhitenedRows(self.fitted, first_noise(linear), unknown),
            baseline=model.columns,
            knots=default_knots(float(frame.time.min()), float(frame.time.max()), config.knot_count),
            max_terms=config.max_terms * len(linear),
            exact_terms=config.max_terms,
            given=dict(given or {}),
        )


def correct(source: Flights, model: Model, corrections: Sequence[Errors] | None = None) -> Corrected:
    """The flights as the model reads them, `corrections` out of each besides, reconstructed."""
    corrections = tuple(corrections) if corrections is not None else tuple({} for _ in source.records)
    points = [source.read(number, model, known) for number, known in enumerate(corrections)]
    records = tuple(record for record, _ in points)
    frame = build_frame([reconstruction for _, reconstruction in points], list(model.mechanisms.values()))
    without_moments = linearised_flights(frame, records, (), np.zeros(0), (), corrections)
    valid = on_rows(frame, without_moments)[1]  # no spike, and measured
    parts = (*split(frame, valid, source.config.blocks), whole(frame, valid))
    return Corrected(source, records, frame, *parts, corrections).with_in_plane_moment(model.columns)


Coefficients = tuple[tuple[Regressor, ...], FloatArray, FloatArray]
"""Columns of moments with their coefficients (columns,) and these' covariance."""


@dataclass(frozen=True)
class Fit:
    """A model on a part of flights, else the fitted one; `problem` is its regression, linear about `linear`. `noise` is
    that of the record, which the problem's is raised from to what the model leaves. `known` (columns + unknowns,) are
    coefficients and nuisances that are not fitted, NaN for those that are; empty where all are.
    """

    model: Model
    data: Corrected
    problem: Problem
    linear: tuple[LinearisedFlight, ...]
    noise: Noise
    known: FloatArray = field(default_factory=lambda: np.zeros(0))

    @cached_property
    def solution(self) -> tuple[FloatArray, FloatArray]:
        """Coefficients (columns,) and nuisances (unknowns,)."""
        if not self.known.size:
            return self.problem.solution(self.data.frame, self.model.columns)
        _, values, _ = self.all_unknowns
        return values[self._places[: len(self.model.columns)]], values[self._places[len(self.model.columns) :]]

    @property
    def values(self) -> FloatArray:
        """Coefficients (columns,)."""
        return self.solution[0]

    @cached_property
    def all_unknowns(self) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Columns, constants of integration and nuisances (rows, all), what they come to, and which are fitted."""
        design = self.problem.whole_design(self.data.frame, self.model.columns)
        values = np.full(design.shape[1], np.nan)
        if self.known.size:
            values[self._places] = self.known
        free, values = np.isnan(values), np.nan_to_num(values)
        values[free] = solve_scaled(design[:, free], self.problem.raw_response - design @ values)
        return design, values, free

    @property
    def _places(self) -> IntArray:
        """Where coefficients and nuisances are among all unknowns: between them are constants of integration."""
        columns, first = len(self.model.columns), 2 * len(self.problem.rows.part.levels)
        return np.append(np.arange(columns), columns + first + np.arange(len(self.nuisances)))

    @property
    def covariance(self) -> FloatArray:
        """That of coefficients and nuisances, 0 of fixed ones; where none is, with what delays and knots err by."""
        return self._errors[np.ix_(self._places, self._places)]

    @property
    def joint_covariance(self) -> FloatArray:
        """That of coefficients, then delays and knots, where none is fixed."""
        columns, times = len(self.model.columns), len(self.nonlinear)
        places = np.append(np.arange(columns), len(self._errors) - times + np.arange(times))
        return self._errors[np.ix_(places, places)]

    @property
    def nonlinear(self) -> tuple[Nonlinear, ...]:
        """Delays and knots of the model."""
        return nonlinear_parameters(self.model.columns, self.data.frame, self.problem.knots)

    @property
    def errors_of_times(self) -> list[dict[str, float]]:
        """1-sigma of the delays and knots of each column."""
        sigmas = np.sqrt(np.diag(self.joint_covariance))[self.values.size :].tolist()
        pairs = list(zip(self.nonlinear, sigmas, strict=True))
        return [{each.name: sigma for each, sigma in pairs if k in each.columns} for k in range(self.values.size)]

    @cached_property
    def _errors(self) -> FloatArray:
        """Covariance of all unknowns and, where none is fixed, of delays and knots after them."""
        problem, columns = self.problem, self.model.columns
        design, values, free = self.all_unknowns
        residual, fitted, efficiency = problem.raw_response - design @ values, design[:, free], problem.efficiency
        # Constants and nuisances are subtracted from the problem's samples already.
        counted = problem.samples + int(free[len(columns) :].sum())
        if not free.all():
            efficiency = problem.efficiency_of(residual)
        elif nonlinear := self.nonlinear:
            slopes = prediction_slopes(nonlinear, columns, self.values, self.data.frame)
            fitted = np.column_stack([fitted, problem.rows.of_moments(slopes)])
            free = np.append(free, np.ones(len(nonlinear), dtype=bool))
        covariance = np.zeros((free.size, free.size))
        covariance[np.ix_(free, free)] = covariance_of(fitted, residual, counted, efficiency)
        return covariance

    @property
    def coefficients(self) -> Coefficients:
        """The model's columns, and what its baseline is more after them, which has a prior in the fit."""
        (values, others), items, always = self.solution, self.nuisances, TimeBasis("constant")
        places = [k for k, item in enumerate(items) if item.name in TOLERATED]
        more = [Regressor(items[k].name, items[k].component, (), always, items[k].units) for k in places]
        scale = np.array([*np.ones(values.size), *(items[k].size for k in places)])
        chosen = np.array([*range(values.size), *(values.size + k for k in places)], dtype=int)
        covariance = self.covariance[np.ix_(chosen, chosen)] * np.outer(scale, scale)
        return (*self.model.columns, *more), scale * np.append(values, others[places]), covariance

    @property
    def record_errors(self) -> tuple[Errors, ...]:
        """What the errors of record and vehicle come to, in SI: one mapping a flight."""
        return self.problem.rows.nuisances.values(self.solution[1], len(self.data.records))

    def histories(self, applied: Iterable[Applied]) -> dict[str, Channels]:
        """What one SI unit of components of record effects does to the residual (frame rows,), by their names."""
        wanted, found = tuple(applied), dict[str, Channels]()
        for number, linear in enumerate(self.linear):
            own = [each for each in wanted if each.flight == number]
            changes = linear.effects((each.effect, each.component, each.size) for each in own)
            for each, change in zip(own, changes, strict=True):
                found[history_name(each)] = on_frame(self.data.frame, number, change.times(1.0 / each.size))
        return found

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """Errors of record and vehicle beside the columns, in the order of the unknowns."""
        return self.problem.rows.nuisances.items

    @cached_property
    def null(self) -> HypothesisFit:
        """The model as a hypothesis that nothing is added to."""
        return fit_hypothesis(self.problem, "none", ())

    @cached_property
    def rest(self) -> Channels:
        """The residual of rates (but for a constant a piece) and force (frame rows,)."""
        return self.problem.left(self.data.frame, self.model.columns, *self.solution)

    @cached_property
    def left(self) -> ResidualMoments:
        """The residual as moment coefficients."""
        return self.data.moments(self.rest.rates)

    @property
    def error(self) -> float:
        """Mean square of the moment coefficients' residual, pitch and yaw together, on the fitted part."""
        return self.left.mean_square(self.data.fitted.rows)

    def mean_square_of(self, parts: Sequence[Part]) -> float:
        """The same on parts of the record."""
        return self.left.mean_square(np.concatenate([part.rows for part in parts]))

    @property
    def held_out(self) -> float:
        """The same on the blocks that take no part in fit or choice."""
        return self.mean_square_of([self.data.reported])

    def without_stretches(self, parts: Sequence[Part]) -> FloatArray:
        """The mean square on parts of the record without each of their stretches (stretches,)."""
        square = np.where(self.left.usable, np.abs(self.left.body) ** 2 / 2.0, 0.0)
        stretches = [part.rows[a:b] for part in parts for a, b in part.pieces]
        sums, sizes = (np.array([each[rows].sum() for rows in stretches]) for each in (square, self.left.usable))
        return np.asarray((sums.sum() - sums) / np.maximum(sizes.sum() - sizes, 1.0), dtype=float)

    @cached_property
    def residual(self) -> Residual:
        """Tests of the residual; size and place, over the noise, are of the flight where it is largest over that."""
        data, left = self.data, self.left
        spans = [data.frame.span(number) for number in range(len(data.records))]
        ratios = [left.mean_square(each) / max(left.mean_square_of_noise(each), 1e-300) for each in spans]
        number = int(np.argmax(ratios))
        usable, samples = left.usable[spans[number]], data.frame.samples(number)
        motion, body = data.frame.motions[number], (left.body / left.noise)[spans[number]][usable]
        time, samples = motion.time[samples], samples[usable]
        plane = plane_from_body(body, motion.windward_meridian[samples])
        channels = {"C_m": body.real, "C_n": body.imag, "C_m,in": plane.real, "C_n,side": plane.imag}
        squares, ends = np.abs(body) ** 2, (time[0], time[-1])
        means, edges, _ = stats.binned_statistic(time[usable], squares, bins=REPORTED_REGIONS, range=ends)
        worst, rest = int(np.nanargmax(means)), (body - body.mean()) * np.hanning(body.size)
        frequencies = np.fft.fftfreq(body.size, float(np.median(np.diff(time))))  # negative: from z to y
        p_value = _whiteness(self)
        return Residual(
            flight=number if len(ratios) > 1 else None,
            rms=float(np.sqrt(left.mean_square(spans[number]))),
            white=p_value > WHITE_CHANCE and ratios[number] < NOISE_EXCESS,
            p_value=p_value,
            noise_ratio=float(np.sqrt(ratios[number])),
            worst_channel=max(channels, key=lambda name: float(np.mean(channels[name] ** 2))),
            worst_region_s=(float(edges[worst]), float(edges[worst + 1])),
            dominant_frequency_hz=float(frequencies[np.argmax(np.abs(np.fft.fft(rest)))]),
        )

    def on_whole_record(self) -> Fit:
        """The same on the whole record, its samples as effective as the fitted part's; no histories as columns."""
        frame = self.data.frame.with_mechanisms([GivenColumns()])
        problem = replace(self.problem, frame=frame, baseline=self.model.columns, given={}, efficiency=1.0)
        fitted = replace(self, problem=problem.on(self.data.fitted))
        efficiency = fitted.problem.efficiency_of(fitted.null.residual)
        return replace(self, problem=replace(problem, efficiency=efficiency).on(self.data.whole))

    def at_best_knots(self, steps: Steps = ROUGH) -> Fit:
        """The same with knots and delays where its regression has them."""
        columns, problem = self.model.columns, self.problem
        nonlinear = nonlinear_parameters(columns, problem.frame, problem.knots)
        if not nonlinear:
            return self
        reduced = Reduced(replace(problem, baseline=()), problem.frame)
        found = refine(columns, nonlinear, frozenset(), reduced, steps)
        columns = found.columns
        own = self.model.but(columns=columns), self.data.with_in_plane_moment(columns, found.fitted.values)
        return Fit(*own, replace(problem, baseline=columns), self.linear, self.noise)

    @property
    def about_its_own(self) -> Fit:
        """The same, linear about its own coefficients; knots and delays follow the moment that these look back to."""
        if not any(column.theta for column in self.model.columns):
            return fitted_about(self.data, self.model, self.values)
        data = self.data.with_in_plane_moment(self.model.columns, self.values)
        return fitted_about(data, self.model, self.values).at_best_knots()


def fitted_about(data: Corrected, model: Model, values: FloatArray | None = None, noise: Noise | None = None) -> Fit:
    """The fit, linear about coefficients (columns,) or plain ones; without `noise` under the record's, raised."""
    linear = data.linearised(model, first_values(data.frame, data.fitted, model.columns) if values is None else values)
    problem = data.regression(model, linear)
    own = estimated_noise(problem) if noise is None else noise
    raised = raised_noise(problem.under(own)) if noise is None else noise
    return Fit(model, data, problem.under(raised), linear, own)


def history_name(applied: Applied) -> str:
    """The name of a column that is the history of a component of a record effect with its settings."""
    effect = applied.effect
    return f"{effect.name} {effect.model_dump()} {applied.component} [flight {applied.flight}]"


def converged(source: Flights, model: Model) -> Fit:
    """The fit of a model, linearised where the errors that the tolerances allow are nearly taken out."""
    return converged_from(fitted_about(correct(source, model), model))


def converged_from(fit: Fit) -> Fit:
    """The same, from another point. What errors do to the reconstruction is not small enough to be linear from the
    record as it is; nor are the errors that the model holds, whose values follow. Knots and delays of the model are
    refined there. Last it is linearised about its own coefficients: the first are of the rates' differences, and those
    of columns that are nearly one are anything. Where it fits worse, much is unexplained, errors far beyond their
    tolerances are linear about no point, and the next is as good as chance.
    """
    fit, worse = _while_better(fit, _without_its_errors, MODEL_LINEARISATIONS)
    if worse:  # the record has none of the errors; what was found of the vehicle's moments acts
        acting = []
        for flight, known, found in zip(fit.data.flights, fit.data.corrections, _found(fit), strict=True):
            names = {mechanism.name for mechanism in fit.model.tolerated(flight)}
            acting.append({**known, **{name: value for name, value in found.items() if name[0] in names}})
        fit = replace(fit, data=replace(fit.data, corrections=tuple(acting))).about_its_own
    return _while_better(fit, lambda own: own.about_its_own, MODEL_OWN_POINTS)[0]


def _while_better(fit: Fit, step: Callable[[Fit], Fit], most: int) -> tuple[Fit, bool]:
    """The fit after some steps, while these improve it; and whether a further one would make it worse."""
    for _ in range(most):
        nearer = step(fit)
        fall = fit.error / nearer.error
        if fall < 1.0 / MODEL_TRIFLE:
            return fit, True
        fit = nearer
        if fall < MODEL_TRIFLE:
            break
    return fit, False


def _found(fit: Fit) -> list[Errors]:
    """What is taken out of each flight's record after a fit."""
    pairs = zip(fit.data.source.records, fit.record_errors, fit.data.corrections, strict=True)
    return [next_corrections(k, flight, fit.model, found, before) for k, (flight, found, before) in enumerate(pairs)]


def _without_its_errors(fit: Fit) -> Fit:
    """The model where the errors of the record that a fit finds are taken out, its knots and delays refined."""
    more = ((a, fit.record_errors[a.flight].get((a.effect.name, a.component), 0.0)) for a in fit.model.applied)
    model = fit.model.but(applied=tuple(a.model_copy(update={"value": a.value + value}) for a, value in more))
    return fitted_about(correct(fit.data.source, model, _found(fit)), model).at_best_knots()


def next_corrections(number: int, flight: Flight, model: Model, found: Errors, before: Errors) -> Errors:
    """What is taken out of one flight's record: its errors within tolerances; `found` are whole, with `before`."""
    free = {(a.effect.name, a.component) for a in model.applied if a.flight == number}
    most = {(e.name, c.name): MODEL_PLAUSIBLE * c.size for e in nuisance_effects() for c in e.components(flight)}
    of_vehicle = {mechanism.name for mechanism in model.tolerated(flight)}
    within = {
        name: float(np.clip(value, -most[name], most[name])) if name in most else value
        for name, value in found.items()
        if (name in most or name[0] in of_vehicle) and name not in free
    }
    return {**before, **within}


def _whiteness(fit: Fit) -> float:
    """Of the rates' residual: the smaller p-value of Ljung-Box and of its size against the gyros' noise, doubled."""
    fitted = fit.data.fitted
    rates, parts = fit.rest.rates[fitted.rows], list[FloatArray]()
    for (a, b), number in zip(fitted.pieces, fitted.flights, strict=True):
        piece = (rates[a:b] - rates[a:b].mean()) / fit.data.records[number].gyro_sigma
        parts += [piece.real, piece.imag]
    chances = [whiteness([part[np.newaxis]], min(WHITE_LAGS, part.size // 4))[0].p_value for part in parts]
    together = float(stats.combine_pvalues(np.clip(chances, 1e-300, 1.0)).pvalue)
    total = sum(float(part @ part) for part in parts)
    free = sum(part.size - 1 for part in parts)
    # The noise level is itself estimated, to about one part in the root of the samples.
    spread = np.sqrt(2.0 * free) * np.sqrt(3.0)
    return min(1.0, 2.0 * min(together, float(stats.norm.sf((total - free) / spread))))


def has_tolerance(problem: Problem, effect: str) -> bool:
    """Whether every fit has the effect already, within its tolerance."""
    items = problem.rows.nuisances.items
    return any(items[k].name == effect for k in problem.rows.nuisances.bounded)
