"""`identify`: a regression model, refined by maximum likelihood on the original measurements (Sections 3.4 and 4.4).

An `IdentificationProblem` has node records, equations, start values, priors and bounds; its fit is repeated until
nodes stay the same.
"""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UnanswerableError, UsageError
from brv_hypo.flight.record import Flight
from brv_hypo.identification.equations import FORCE_BEND, FORCE_DRIFT, FORCES, MomentColumns, VehicleModel, rates_used
from brv_hypo.identification.nodes import NodeRecord, block_size, delays_of, node_records
from brv_hypo.identification.parameters import Structure, Tolerated, input_error, of_flight, structure_of, unique
from brv_hypo.inference.fit import Regressed
from brv_hypo.likelihood import Differenced, FitResult, Segment, fit
from brv_hypo.likelihood.statistics import Whiteness, estimate_variance, negative_log_likelihood
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.linearisation.nuisance import beyond_tolerance
from brv_hypo.linearisation.response import GRAVITY_ERRORS
from brv_hypo.model.baseline import scaled
from brv_hypo.model.term import Regressor
from brv_hypo.motion.inputs import SmoothInputs, smooth_inputs
from brv_hypo.motion.smoother import BENT

IDENTIFIED_STEPS = 30  # of one search of `identify`, if its caller says nothing else
IDENTIFIED_TOLERANCE = 0.1  # standard errors of the last step; it is taken, and what it leaves is of its square
# Blocks that a knot may move by in one step. Where the moment that it cuts off passes zero, the data hardly see the
# knot, and an unbounded step would throw it far.
IDENTIFIED_KNOT_REACH = 3.0

_ROUNDING = 1e-9
# Change of any estimate, in standard errors, that one step with other corrections of the block means makes, from which
# the fit is repeated; rounds of that.
IDENTIFIED_STALE = 0.1
IDENTIFIED_ROUNDS = 6
IDENTIFIED_CLOSE = 0.3  # standard errors of the last step: a search that stalled below is at its end but for knots
# Misfit of the start from which knots wait until the rest is near: a knot in an oscillating moment has several minima;
# steps with the knots held then: the first takes up what is linear, errors of the record above all.
IDENTIFIED_POOR_START = 2.0
IDENTIFIED_FIRST_STEPS = 2
IDENTIFIED_KNOTS_MOVED = 0.5  # blocks, by which a knot may have moved before the fit is repeated
IDENTIFIED_KNOTS_LOOSE = 0.25  # and standard errors: a knot hardly known from the data goes to and fro with the nodes

_REMEDY = "Try a part of the record (`--start`, `--stop`), fewer terms (setting `max_terms`) or stated tolerances"
_HELD = "as the search stalled, fixed at the last value and without a standard error: {}"


@dataclass(frozen=True)
class IdentificationProblem:
    """What is estimated from what."""

    frame: RateFrame  # the reconstructed flights, as regressed
    inputs: tuple[SmoothInputs, ...]  # of each flight
    records: tuple[NodeRecord, ...]  # a segment of the likelihood each
    model: VehicleModel  # equations of motion and of measurement
    theta: dict[str, float]  # start values of all parameters, by name
    priors: dict[str, tuple[float, float]]  # mean and standard deviation of those with a Gaussian prior
    tolerated: tuple[tuple[Tolerated, int], ...]  # the values that are known to a tolerance, each with its flight
    applied: dict[str, float]  # what was taken out of the record of each before, in tolerances, by name
    block: int  # samples to a node
    max_iterations: int  # of one search
    states: tuple[FloatArray, ...] = ()  # states (4, nodes) by segment of an earlier fit, where there is one
    first_noise: FloatArray | None = None  # noise variances (4,) of that

    @property
    def structure(self) -> Structure:
        """The regression's parameters."""
        return self.model.moments.structure

    @property
    def flights(self) -> tuple[int, ...]:
        """The flights that have a segment."""
        return tuple(dict.fromkeys(record.context.flight for record in self.records))

    def warm(self, found: FitResult) -> IdentificationProblem:
        """The problem started from a solution."""
        theta = {name: found.theta.get(name, value) for name, value in self.theta.items()}
        return replace(self, theta=theta, states=found.states, first_noise=found.noise_variance)

    def refreshed(self, found: FitResult) -> IdentificationProblem:
        """The problem started from a solution, with nodes and block means laid out by the motion that it has. Blocks
        may shrink; that they do not grow again keeps rounds of refreshing from going in a circle.
        """
        warm, columns, values = self.warm(found), self.structure.at(found.theta), self.structure.values(found.theta)
        frame = self.frame.with_in_plane_moment(columns, values)

        def fitted(number: int, flight: Flight) -> Flight:
            for record, left in zip(self.records, found.innovations, strict=True):
                if record.context.flight == number:
                    flight = record.fitted(flight, record.segment.y - left)
            return flight

        block = min(self.block, block_size(frame, columns, values))
        rates = frame.columns(columns) @ values
        delays = delays_of(self.frame, self.structure.columns)  # of the regression: nodes stay placed for these
        records = node_records(frame, columns, values, rates, self.inputs, block, delays, fitted)
        old = self.model  # whose memory is of the old segments
        contexts = tuple(record.context for record in records)
        model = VehicleModel(old.moments, contexts, old.span)
        if block != self.block:
            warm = replace(warm, states=(), first_noise=None)
        return replace(warm, frame=frame, records=records, model=model, block=block)

    def segments(self) -> tuple[Segment, ...]:
        """The likelihood's segments, started from the states."""
        found = []
        for record, x in zip(self.records, self.states or [r.segment.x0 for r in self.records], strict=True):
            others = [f"[flight {other}]" for other in self.flights if other != record.context.flight]
            ignored = frozenset(name for name in self.theta if any(other in name for other in others))
            found.append(replace(record.segment, x0=x, ignores=ignored))
        return tuple(found)

    @property
    def affine(self) -> frozenset[str]:
        """Parameters and histories in which moments and readings are affine: coefficients, errors of the record. What
        changes rates of which a mechanism's columns are functions is not.
        """
        time_varying = {varying.name for record in self.records for varying in record.segment.time_varying}
        gravity = {of_flight(name, flight) for name in GRAVITY_ERRORS for flight in self.flights}
        bent = {name for flight in self.flights for name in self.model.rate_parameters(flight)}
        return frozenset({*self.structure.names, *FORCES, *time_varying, *gravity} - bent)

    @property
    def seconds_to_node(self) -> float:
        """Length (s) of the shortest block."""
        return min(record.context.block for record in self.records)

    def solve(
        self, *, max_iterations: int | None = None, near_start: bool = True, fixed: Sequence[str] = ()
    ) -> FitResult:
        """Maximum likelihood, with some parameters `fixed`."""
        return fit(
            Differenced(self.model.dynamics, self.affine),
            Differenced(self.model.outputs, self.affine),
            self.segments(),
            self.theta,
            bounds={parameter.name: parameter.bounds for parameter in self.structure.nonlinear_parameters}
            | {name: (self.theta[name], self.theta[name]) for name in (*fixed, *self.structure.fixed_delays)},
            priors=self.priors,
            delays=self.structure.delays,
            reach=dict.fromkeys(self.structure.knots, IDENTIFIED_KNOT_REACH * self.seconds_to_node),
            first_noise=self.first_noise,
            max_iterations=max_iterations or self.max_iterations,
            tolerance=IDENTIFIED_TOLERANCE,
            near_start=near_start,
        )


def build_problem(
    frame: RateFrame,
    columns: Sequence[Regressor],
    values: FloatArray,
    regressed: Regressed | None = None,
    max_iterations: int = IDENTIFIED_STEPS,
) -> IdentificationProblem:
    """The problem of a regression model, `regressed` as in `identify`; UnanswerableError without a long segment."""
    block = block_size(frame, columns, values)
    inputs = tuple(smooth_inputs(r) for r in frame.reconstructions)
    rates = frame.columns(columns) @ values if regressed is None else regressed.rates
    delays = delays_of(frame, columns)
    records = node_records(frame, columns, values, rates, inputs, block, delays)
    if not records:
        raise UnanswerableError(
            f"no stretch of the record is long enough for maximum likelihood at {block} samples a node. "
            "Likely cause: gaps or a short window. Remedy: widen the window, or rank by regression."
        )
    span = (float(frame.coefficient_time.min()), float(frame.coefficient_time.max()))
    structure = structure_of(columns, frame.mechanisms, span, delays)
    model = VehicleModel(
        MomentColumns(structure, frame.mechanisms, rates_used(columns, frame.mechanisms, frame.motions[0])),
        tuple(record.context for record in records),
        span,
    )
    theta = dict(zip(structure.names, map(float, values), strict=True))
    theta |= {parameter.name: parameter.value for parameter in structure.nonlinear_parameters}
    theta |= structure.fixed_delays
    forces = _force_start(frame, span)
    theta |= forces
    priors = {FORCE_BEND: (0.0, abs(forces[FORCE_DRIFT[0]]) / BENT**2)}
    for flight, (mean, errors) in {record.context.flight: record.context.gravity for record in records}.items():
        off = np.linalg.solve(errors, frame.reconstructions[flight].gravity_body - mean)
        for name, value in zip(GRAVITY_ERRORS, off.tolist(), strict=True):
            theta[of_flight(name, flight)] = value
            priors[of_flight(name, flight)] = (0.0, 1.0)
        left = [name for error in inputs[flight].errors for name in input_error(error, flight).weights]
        theta |= dict.fromkeys(left, 0.0)
        priors |= dict.fromkeys(left, (0.0, 1.0))
    tolerated = tuple(dict.fromkeys((value, r.context.flight) for r in records for value in r.tolerated))
    applied = {}
    for value, flight in tolerated:  # all in tolerances; what is estimated is beside what was taken out of the record
        name = of_flight(value.name, flight)
        applied[name], found = (0.0, 0.0) if regressed is None else value.known(regressed, flight)
        theta[name] = found - applied[name]
        priors[name] = (-applied[name], 1.0)
    return IdentificationProblem(
        frame, inputs, records, model, theta, priors, tolerated, applied, block, max_iterations
    )


def _force_start(frame: RateFrame, span: tuple[float, float]) -> dict[str, float]:
    """The reconstructed normal-force slope, its drift and its bend; a rough 1 and no drift where it is unknown."""
    time = np.concatenate([r.motion.coefficient_time for r in frame.reconstructions])
    slope = np.concatenate([r.normal_force_slope for r in frame.reconstructions])
    bend = float(np.mean([r.normal_force_bend for r in frame.reconstructions]))
    known = np.isfinite(slope)
    drift = np.array([1.0, 0.0])
    if known.any():
        drift = np.polynomial.legendre.legfit(scaled(time[known], *span), slope[known], 1)
        drift = np.where(np.abs(drift) > _ROUNDING * abs(drift[0]), drift, 0.0)
    return dict(zip(FORCES, (*drift.tolist(), bend), strict=True))


@dataclass(frozen=True)
class Estimate:
    """One parameter."""

    name: str
    value: float  # in `units`
    std_error: float  # for white residuals; where they are not white, that for coloured ones, if it is larger
    units: str


@dataclass(frozen=True)
class Identification:
    """A regression model refined by maximum likelihood on the original measurements."""

    status: str  # that of the likelihood, such as "converged"; "failed" where it could not be begun
    message: str  # cause and remedy
    columns: tuple[Regressor, ...]  # the regression's, with delays and knots at their estimates
    values: FloatArray  # coefficients (columns,), in the units of the columns
    covariance: FloatArray  # (columns, columns), others accounted for; at the reported standard errors
    terms: tuple[Estimate, ...] = ()  # the coefficients
    nonlinear: tuple[Estimate, ...] = ()  # delays and knots
    forces: tuple[Estimate, ...] = ()  # normal-force slope (1/rad) and its drift
    instruments: tuple[Estimate, ...] = ()  # what is known to a tolerance: errors of the record and moments
    log_likelihood: float = float("nan")  # minus the NLLF of Eq. 3.10 with erratum E8, at every sample
    iterations: int = 0  # of all searches together
    innovations: tuple[FloatArray, ...] = ()  # (4, samples) each: measured less predicted q, r, ay, az, SI
    whiteness: tuple[Whiteness, ...] = ()  # test of each output's innovations, in their order
    seconds: float = 0.0  # wall clock
    problem: IdentificationProblem | None = None  # what was solved; None where it could not be begun


# ---- The fit ----


def identify(
    frame: RateFrame,
    columns: Sequence[Regressor],
    values: FloatArray,
    *,
    regressed: Regressed | None = None,
    max_iterations: int = IDENTIFIED_STEPS,
    begin_anew: bool = True,
) -> Identification:
    """Estimate the coefficients, delays and knots of a regression model from the instruments' own readings.

    The states of Section 4.4 are estimated along, so that errors of the reconstruction do not enter; so are the
    errors of instruments, vehicle and air (Appendix B), within the tolerances of the record. Flights of the frame
    share the coefficients; each has its own initial states, gravity direction and errors.

    `columns` and `values` (columns,) are the model's, `regressed` what the regression says beside them, None where
    the records are as measured. `begin_anew`: search from the data alone where the regression's fit leads nowhere,
    which takes several times as long. A failure is a status, with the regression's values left in place.
    """
    begun = clock.perf_counter()
    try:
        problem = build_problem(frame, columns, values, regressed, max_iterations)
        problem, found, iterations = _search(problem, begin_anew)
    except (UnanswerableError, UsageError) as error:
        return Identification(
            status="failed",
            message=str(error),
            columns=tuple(columns),
            values=np.asarray(values),
            covariance=np.full((len(columns), len(columns)), np.nan),
            seconds=clock.perf_counter() - begun,
        )
    return replace(_summary(problem, found), iterations=iterations, seconds=clock.perf_counter() - begun)


def _search(problem: IdentificationProblem, begin_anew: bool) -> tuple[IdentificationProblem, FitResult, int]:
    """The fit, repeated until its own motion lays out the same nodes and block means, and its iterations."""
    searches: list[FitResult] = []

    def solve(problem: IdentificationProblem, **how: Any) -> FitResult:
        searches.append(problem.solve(**how))
        return searches[-1]

    misfits = [  # of the angular rate, mean squares over the gyros' noise
        np.mean(np.abs(record.measured[0] - record.expected[0]) ** 2)
        / (2.0 * problem.frame.reconstructions[record.context.flight].gyro_sigma ** 2)
        for record in problem.records
    ]
    if np.sqrt(max(misfits)) > IDENTIFIED_POOR_START:
        knots = problem.structure.knots
        problem = problem.refreshed(solve(problem, fixed=knots, max_iterations=IDENTIFIED_FIRST_STEPS))
    found = solve(problem)
    near = found.status == "stalled" and bool(found.history) and found.history[-1].step_length < IDENTIFIED_CLOSE
    if begin_anew and not found.converged and not near:
        found = solve(problem, near_start=False)
    held = _loose_knots(problem, found)
    if held:
        problem = problem.refreshed(found)
        found = solve(problem, fixed=held)
    for _ in range(IDENTIFIED_ROUNDS):
        if not found.converged:
            break
        before, problem = problem, problem.refreshed(found)
        if not _stale(before, problem, found, held):
            break
        found = solve(problem, fixed=held)
    if held:
        found = replace(found, message=f"{found.message}; {_HELD.format(', '.join(held))}")
    return problem.warm(found), found, sum(search.iterations for search in searches)


def _loose_knots(problem: IdentificationProblem, found: FitResult) -> tuple[str, ...]:
    """Knots that kept a search from its end: those that the data do not determine, else all of them."""
    if found.status != "stalled":
        return ()
    knots = problem.structure.knots
    return tuple(name for name in knots if not found.std_error[name] < problem.seconds_to_node) or knots


def _stale(old: IdentificationProblem, new: IdentificationProblem, found: FitResult, fixed: Sequence[str]) -> bool:
    """Whether nodes, or any estimate by one more step with the new block means, have changed by more than a trifle."""
    error = found.std_error  # fixed ones have none
    moved = any(
        abs(found.theta[m.name] - old.theta[m.name])
        > max(IDENTIFIED_KNOTS_MOVED * old.seconds_to_node, IDENTIFIED_KNOTS_LOOSE * error.get(m.name, 0.0))
        for m in old.structure.nonlinear_parameters
        if m.kind != "theta"
    )
    if moved or new.block != old.block:
        return True
    after = new.solve(fixed=fixed, max_iterations=1).theta
    return any(
        abs(after[name] - found.theta[name]) > IDENTIFIED_STALE * each for name, each in error.items() if each > 0.0
    )


def _summary(problem: IdentificationProblem, found: FitResult) -> Identification:
    structure, theta = problem.structure, found.theta
    white = all(test.white for test in found.whiteness)

    def estimate(name: str, units: str, shown: str | None = None, size: float = 1.0, applied: float = 0.0) -> Estimate:
        plain, coloured = (size * e.get(name, np.nan) for e in (found.std_error, found.std_error_coloured))
        reported = plain if white else max(plain, coloured)
        return Estimate(shown or name, size * (theta[name] + applied), reported, units)

    def of_one(name: str, flight: int, units: str, size: float = 1.0) -> Estimate:
        """The estimate of a flight's own parameter, by the name that a reader knows."""
        own = of_flight(name, flight)
        shown = name if len(problem.flights) == 1 else own
        return estimate(own, units, shown, size, problem.applied.get(own, 0.0))

    innovations = tuple(
        record.innovations(record.segment.y - v) for record, v in zip(problem.records, found.innovations, strict=True)
    )
    columns, values = structure.at(theta), structure.values(theta)
    terms = tuple(estimate(n, c.units) for n, c in zip(structure.names, columns, strict=True))
    index = [found.names.index(term.name) for term in terms]
    stretch = [term.std_error / found.std_error[term.name] for term in terms]  # to the reported standard errors
    together = np.concatenate(innovations, axis=1)
    labels = unique([parameter.label for parameter in structure.nonlinear_parameters])
    instruments = tuple(of_one(v.name, flight, v.units, v.size) for v, flight in problem.tolerated)
    beyond = [
        beyond_tolerance(e.name, e.value, v.size, e.units, len(instruments))
        for e, (v, _) in zip(instruments, problem.tolerated, strict=True)
    ]
    remedy = found.status.remedy  # for whoever has functions; whoever has a record has other means
    return Identification(
        status=found.status,
        message="; ".join(
            [found.message.replace(remedy or _REMEDY, _REMEDY), *(text for text in beyond if text is not None)]
        ),
        columns=columns,
        values=values,
        covariance=found.covariance[np.ix_(index, index)] * np.outer(stretch, stretch),
        terms=terms,
        nonlinear=tuple(
            estimate(parameter.name, parameter.units, label, 1.0 / parameter.scale, parameter.origin)
            for parameter, label in zip(structure.nonlinear_parameters, labels, strict=True)
        ),
        forces=tuple(estimate(name, "1/rad") for name in FORCE_DRIFT),
        instruments=instruments,
        # With B of Eq. 3.11, over every sample.
        log_likelihood=-negative_log_likelihood(together, estimate_variance(together, np.full(4, 1e-300))),
        innovations=innovations,
        whiteness=found.whiteness,
        problem=problem,
    )
