"""The estimation problem of an identification: options, node records, equations, start values, priors, bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight.record import Flight
from brv_hypo.identification.equations import FORCE_BEND, GRAVITY, MomentModel, VehicleModel, use_of_rates
from brv_hypo.identification.nodes import NodeRecord, block_size, delays_of, node_records
from brv_hypo.identification.parameters import (
    ROLL_RATE_ERROR,
    Structure,
    Tolerated,
    input_error,
    of_flight,
    structure_of,
)
from brv_hypo.likelihood import FitResult, Segment, fit
from brv_hypo.likelihood.derivatives import PartialJacobian
from brv_hypo.model.term import Regressor
from brv_hypo.motion.inertial import FREE_GRAVITY, gravity_magnitude
from brv_hypo.motion.inputs import SmoothInputs, smooth_inputs
from brv_hypo.motion.measurement import BENT
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.uncertainty import Regressed

IDENTIFIED_STEPS = 30  # of `identify` alone, if a user says nothing else
IDENTIFIED_FORCE_DEGREE = 1  # Legendre degree of the normal-force slope in time
IDENTIFIED_TOLERANCE = 0.1  # standard errors of the last step; it is taken, and what it leaves is of its square
# Blocks that a knot may move by in one step. Where the moment that it cuts off passes zero, the data hardly see the
# knot, and an unbounded step would throw it far.
IDENTIFIED_KNOT_REACH = 3.0

_ROUNDING = 1e-9


class IdentificationConfig(BaseModel):
    """Options of `identify`; the defaults suit an unknown flight.

    `begin_anew`: search from the data alone where the regression's fit leads nowhere, which takes several times as
    long.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    max_iterations: int = Field(default=IDENTIFIED_STEPS, ge=1)
    begin_anew: bool = True


@dataclass(frozen=True)
class Problem:
    """What is estimated from what."""

    frame: RateFrame  # the reconstructed flights, as regressed
    inputs: tuple[SmoothInputs, ...]  # of each flight
    records: tuple[NodeRecord, ...]  # a segment of the likelihood each
    model: VehicleModel  # equations of motion and of measurement
    theta: dict[str, float]  # start values of all parameters, by name
    priors: dict[str, tuple[float, float]]  # mean and standard deviation of those with a Gaussian prior
    bounds: dict[str, tuple[float, float]]  # of delays and knots
    tolerated: tuple[tuple[Tolerated, int], ...]  # the values that are known to a tolerance, each with its flight
    applied: dict[str, float]  # what was taken out of the record of each before, in tolerances, by name
    block: int  # samples to a node
    config: IdentificationConfig
    placed_delays: tuple[float, ...]  # delays (s) for which nodes were placed
    states: tuple[FloatArray, ...] = ()  # states (4, nodes) by segment of an earlier fit, where there is one
    first_noise: FloatArray | None = None  # noise covariance (4, 4) of that

    @property
    def structure(self) -> Structure:
        """The regression's parameters."""
        return self.model.moments.structure

    @property
    def flights(self) -> tuple[int, ...]:
        """The flights that have a segment."""
        return tuple(dict.fromkeys(record.context.flight for record in self.records))

    def warm(self, found: FitResult) -> Problem:
        """The problem started from a solution."""
        theta = {name: found.theta.get(name, value) for name, value in self.theta.items()}
        return replace(self, theta=theta, states=found.states, first_noise=found.noise_covariance)

    def refreshed(self, found: FitResult) -> Problem:
        """The problem started from a solution, with nodes and block means laid out by the motion that it has.

        Blocks may shrink; that they do not grow again keeps rounds of refreshing from going in a circle.
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
        records = node_records(frame, columns, values, rates, self.inputs, block, self.placed_delays, fitted)
        model = self.model.on(tuple(record.context for record in records))
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
        """Parameters and courses in which moments and readings are affine: coefficients, errors of the record.

        What changes rates of which a mechanism's columns are functions is not.
        """
        time_varying = {varying.name for record in self.records for varying in record.segment.time_varying}
        gravity = {of_flight(name, flight) for name in GRAVITY for flight in self.flights}
        bent = {name for flight in self.flights for name in self.model.rate_parameters(flight)}
        if self.model.moments.rates == "affine":
            bent = {of_flight(ROLL_RATE_ERROR, flight) for flight in self.flights}  # its square acts on the lever
        return frozenset({*self.structure.names, *self.model.forces, *time_varying, *gravity} - bent)

    @property
    def seconds_to_node(self) -> float:
        """Length (s) of the shortest block."""
        return min(record.context.block for record in self.records)

    def solve(
        self, *, max_iterations: int | None = None, near_start: bool = True, fixed: Sequence[str] = ()
    ) -> FitResult:
        """Maximum likelihood, with some parameters `fixed`."""
        return fit(
            PartialJacobian(self.model.dynamics, self.model.dynamics_slopes, self.affine),
            PartialJacobian(self.model.outputs, self.model.outputs_slopes, self.affine),
            self.segments(),
            self.theta,
            bounds=self.bounds | {name: (self.theta[name], self.theta[name]) for name in fixed},
            priors=self.priors,
            delays=self.structure.delays,
            reach=dict.fromkeys(self.structure.knots, IDENTIFIED_KNOT_REACH * self.seconds_to_node),
            first_noise=self.first_noise,
            max_iterations=max_iterations or self.config.max_iterations,
            tolerance=IDENTIFIED_TOLERANCE,
            near_start=near_start,
        )


def build_problem(
    frame: RateFrame,
    columns: Sequence[Regressor],
    values: FloatArray,
    config: IdentificationConfig,
    regressed: Regressed | None = None,
) -> Problem:
    """Lay out the problem of a regression model; `regressed` as in `identify`.

    Raises UnanswerableError where no segment is long enough.
    """
    size = block_size(frame, columns, values)
    inputs = tuple(smooth_inputs(r) for r in frame.reconstructions)
    rates = frame.columns(columns) @ values if regressed is None else regressed.rates
    records = node_records(frame, columns, values, rates, inputs, size, delays_of(columns))
    if not records:
        raise UnanswerableError(
            f"no stretch of the record is long enough for maximum likelihood at {size} samples a node. "
            "Likely cause: gaps or a short window. Remedy: widen the window, or rank by regression."
        )
    time = frame.coefficient_time
    span = (float(time.min()), float(time.max()))
    structure = structure_of(columns, frame.mechanisms, *span)
    forces = tuple("C_Nalpha_force" + (f" drift {n}" if n else "") for n in range(IDENTIFIED_FORCE_DEGREE + 1))
    model = VehicleModel(
        MomentModel(structure, frame.mechanisms, use_of_rates(columns, frame.mechanisms, frame.motions[0])),
        tuple(record.context for record in records),
        forces,
        span,
    )
    theta = dict(zip(structure.names, map(float, values), strict=True))
    theta |= {parameter.name: parameter.value for parameter in structure.nonlinear_parameters}
    start, bend = _force_start(frame, span)
    theta |= {**dict(zip(forces, start.tolist(), strict=True)), FORCE_BEND: bend}
    nuisances = _nuisances(frame, inputs, tuple(dict.fromkeys(record.context.flight for record in records)))
    theta |= {name: start for name, (start, _, _) in nuisances.items()}
    priors = {name: (mean, sigma) for name, (_, mean, sigma) in nuisances.items()}
    priors[FORCE_BEND] = (0.0, abs(float(start[0])) / BENT**2)
    tolerated = tuple(dict.fromkeys((value, r.context.flight) for r in records for value in r.tolerated))
    applied = {}
    for value, flight in tolerated:  # all in tolerances; what is estimated is beside what was taken out of the record
        name = of_flight(value.name, flight)
        applied[name], found, bounded = (0.0, 0.0, True) if regressed is None else value.known(regressed, flight)
        theta[name] = found - applied[name]
        if bounded:
            priors[name] = (-applied[name], 1.0)
    return Problem(
        frame=frame,
        inputs=inputs,
        records=records,
        model=model,
        theta=theta,
        priors=priors,
        bounds={parameter.name: parameter.bounds for parameter in structure.nonlinear_parameters},
        tolerated=tolerated,
        applied=applied,
        block=size,
        config=config,
        placed_delays=delays_of(columns),
    )


def _nuisances(
    frame: RateFrame, inputs: Sequence[SmoothInputs], flights: Sequence[int]
) -> dict[str, tuple[float, float, float]]:
    """Start, prior mean and prior standard deviation of gravity and of what noise leaves in the inputs, by name."""
    found: dict[str, tuple[float, float, float]] = {}
    for index in flights:
        reconstruction = frame.reconstructions[index]
        size = gravity_magnitude(reconstruction.flight) or FREE_GRAVITY
        for name, value in zip(GRAVITY, reconstruction.gravity_body.tolist(), strict=True):
            found[of_flight(name, index)] = (min(max(value, -size), size), 0.0, size)
        for error in inputs[index].errors:
            found |= dict.fromkeys(input_error(error, index).weights, (0.0, 0.0, 1.0))
    return found


def _force_start(frame: RateFrame, span: tuple[float, float]) -> tuple[FloatArray, float]:
    """Legendre coefficients of the reconstructed normal-force slope, 1/rad, and its bend, 1/rad^3.

    A rough 1 and no bend where they are unknown.
    """
    time = np.concatenate([r.motion.coefficient_time for r in frame.reconstructions])
    slope = np.concatenate([r.normal_force_slope for r in frame.reconstructions])
    bend = float(np.mean([r.normal_force_bend for r in frame.reconstructions]))
    known = np.isfinite(slope)
    if not known.any():
        return np.asarray(np.eye(IDENTIFIED_FORCE_DEGREE + 1)[0]), bend
    scaled = (2.0 * time[known] - span[0] - span[1]) / (span[1] - span[0])
    found = np.polynomial.legendre.legfit(scaled, slope[known], IDENTIFIED_FORCE_DEGREE)
    return np.asarray(np.where(np.abs(found) > _ROUNDING * abs(found[0]), found, 0.0)), bend
