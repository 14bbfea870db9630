"""C_m,in along a flight, and its derivatives by alpha and by the transverse rate times d / 2V.

A model with one C_mq and the processes `damping_change` and `damping_bend` are one estimate, with one standard error;
so are C_malpha and `static_change`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field, computed_field

from brv_hypo.arrays import FloatArray, IntArray
from brv_hypo.inference.evidence import Evidence
from brv_hypo.inference.fit import HypothesisFit
from brv_hypo.inference.problem import Problem
from brv_hypo.json_result import NullIsNaN
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.mechanisms.contract import Mechanism, MomentProcess, Process, Term, rms_of_shapes, span_of
from brv_hypo.mechanisms.registry import moment_processes, nuisance_effects
from brv_hypo.model.term import Regressor
from brv_hypo.motion.interpolation import time_splines
from brv_hypo.motion.motion import Motion

REPORTED_SLOPES = 32  # places along a flight at which the static slope is reported
# Of the change that a bend (alpha^2) makes of a slope from alpha = 0 to the greatest angle flown, the share below the
# least angle flown, which no sample shows, beyond which a value at alpha = 0 is an extrapolation; convention.
EXTRAPOLATED_SHARE = 0.05
COLLINEAR = 0.9  # correlation: Belsley, Kuh and Welsch, 1980, 3.2; convention
Function = Literal["C_m0", "C_malpha", "C_mq"]

_RATE = 1.0  # of the transverse rate, rad/s: moments of it are linear
_ANGLE = 1e-4  # of the angle of attack, rad: the moment of a power of it is linear over less than 1e-7 of itself


class Derivative(NullIsNaN):
    """C_m,in or a derivative of it (1/rad) along one flight; negative derivatives are stable. Of model and processes
    together, with the errors of both: by alpha of the static moment, by the transverse rate times d / 2V of all.
    """

    flight: int = Field(description="counted from 0; printed numbers and `reference_flight` from 1")
    time_s: tuple[float, ...] = Field(description="of the places, s")
    mach: tuple[float, ...] = Field(description="there; null: unknown")
    alpha_rad: tuple[float, ...] = Field(description="rms about the place, rad")
    at_zero: tuple[float, ...] = Field(description="at alpha = 0")
    at_zero_std_error: tuple[float, ...] = Field(description="1 sigma")
    at_flown: tuple[float, ...] = Field(description="at the angle of attack flown")
    at_flown_std_error: tuple[float, ...] = Field(description="1 sigma")
    alpha_ends_rad: tuple[tuple[float, float], ...] = Field(default=(), description="least and greatest there, rad")
    collinear_with: dict[str, tuple[float, ...]] = Field(default_factory=dict, description="correlations, by name")

    @computed_field  # type: ignore[prop-decorator]
    @property
    def extrapolated(self) -> tuple[bool, ...]:
        """At which places no sample is near alpha = 0, so that the value there is what the model makes of others."""
        known = (low**2 > EXTRAPOLATED_SHARE * high**2 for low, high in self.alpha_ends_rad)
        return tuple(known) or (False,) * len(self.time_s)

    @property
    def collinear(self) -> tuple[bool, ...]:
        """At which places the value is nearly collinear with something."""
        places = zip(*self.collinear_with.values(), strict=True)
        return tuple(max(each) > COLLINEAR for each in places) or (False,) * len(self.time_s)


class Along(NamedTuple):
    """A function at places of a flight: values, standard errors (places,), and correlation (places,) by name."""

    values: FloatArray
    sigmas: FloatArray
    correlations: Mapping[str, FloatArray]


def along_flight(motion: Motion, number: int, at: Callable[[FloatArray, IntArray], Along]) -> Derivative:
    """A function at places of a flight; `at` gives it about angles of attack (samples,) rad."""
    stretches = np.array_split(np.arange(motion.time.size), REPORTED_SLOPES)
    places = np.array([stretch[stretch.size // 2] for stretch in stretches])
    flown = np.array([np.sqrt(np.mean(motion.alpha[stretch] ** 2)) for stretch in stretches])
    everywhere = np.repeat(flown, [stretch.size for stretch in stretches])
    at_zero, at_flown = at(np.zeros_like(everywhere), places), at(everywhere, places)
    found = [tuple(part.tolist()) for each in (at_zero, at_flown) for part in (each.values, each.sigmas)]
    names = ("at_zero", "at_zero_std_error", "at_flown", "at_flown_std_error")
    alphas = [motion.alpha[stretch] for stretch in stretches]
    high = {name: each for name, each in at_flown.correlations.items() if np.any(each > COLLINEAR)}
    return Derivative(
        flight=number,
        time_s=tuple(motion.time[places].tolist()),
        mach=tuple(motion.mach[places].tolist()),
        alpha_rad=tuple(flown.tolist()),
        alpha_ends_rad=tuple((float(each.min()), float(each.max())) for each in alphas),
        collinear_with={name: tuple(each.tolist()) for name, each in high.items()},
        **dict(zip(names, found, strict=True)),
    )


class Change(NamedTuple):
    """From one motion to another, by `unit` (samples,); `less` None for the moment itself."""

    less: Motion | None
    more: Motion
    unit: FloatArray | float
    at_rest: bool


Request = Callable[[Motion, FloatArray], Change]  # a change about angles of attack (samples,) rad


def value(motion: Motion, alpha: FloatArray) -> Change:
    """The moment at rest about angles of attack (samples,) rad."""
    still = np.zeros_like(alpha)
    at_rest = replace(motion, alpha=alpha, alpha_rate=still, q=still, r=still, history=lambda _: at_rest)
    return Change(None, at_rest, 1.0, True)


def slope(motion: Motion, alpha: FloatArray) -> Change:
    """Its derivative by the angle of attack."""
    return Change(value(motion, alpha).more, value(motion, alpha + _ANGLE).more, _ANGLE, True)


def damping(motion: Motion, alpha: FloatArray) -> Change:
    """Its derivative by the transverse rate in the plane of alpha."""
    slower = replace(motion, alpha=alpha)
    turned = slower.to_body(np.full_like(alpha, _RATE), np.zeros_like(alpha))
    faster = replace(slower, alpha_rate=motion.alpha_rate + _RATE, q=motion.q + turned.real, r=motion.r + turned.imag)
    return Change(slower, faster, _RATE * motion.rate_factor, False)


def along_flights(
    own: Evidence, columns: Sequence[Regressor], frame: RateFrame, by: Request, weight: float = 1.0
) -> tuple[Derivative, ...]:
    """What `by` requests on each flight, at no angle of attack and at that flown; `columns` are those of the evidence.
    At rest it is the static moment: terms in the plane of alpha without a delay, and processes of the stiffness.
    `weight`: what a nat counts in the errors.
    """
    errors, found = (weight, scale_variance(own.rows.problem)), list[Derivative]()
    for k, motion in enumerate(own.rows.frame.motions):
        found.append(along_flight(motion, k, partial(_along, own, columns, frame, k, motion, by, errors)))
    return tuple(found)


def scale_variance(problem: Problem) -> float:
    """Relative variance of any moment coefficient by what tolerances allow of dynamic pressure and inertia. The rows
    have no part of it: what is tested keeps both (`MomentModel.usual`), lest either pose as a share of it.
    """
    effects = {effect.name: effect for effect in nuisance_effects()}
    flights = [record.flight for record in problem.records]
    found = 0.0
    for item in problem.rows.nuisances.items:
        if item.name in effects and np.isfinite(item.present):
            acting = flights if item.flight is None else [flights[item.flight]]
            moved = [effects[item.name].perturb(flight, item.component, item.size) for flight in acting]
            there, own = (
                [float(np.mean(each.vehicle.iyy / each.dynamic_pressure)) for each in some] for some in (moved, acting)
            )
            found += (sum(a / b - 1.0 for a, b in zip(there, own, strict=True)) / len(flights)) ** 2
    return found


def per_coefficient(
    frame: RateFrame, columns: Sequence[Regressor], flight: int, motion: Motion, alpha: FloatArray, by: Request
) -> FloatArray:
    """What `by` requests per unit of each coefficient about angles of attack (samples,) rad (samples, columns). Nothing
    of terms with a delay and, at rest, of those that are not in the plane of alpha alone.
    """
    less, more, unit, at_rest = by(motion, alpha)
    out = np.zeros((alpha.size, len(columns)))
    for j, column in enumerate(columns):
        mechanism = frame.mechanisms.get(column.mechanism)
        if mechanism is None or mechanism.parameters() or not column.acts_on(flight):
            continue
        slow, fast = (
            None if each is None else next(t for t in mechanism.terms(each, {}) if t.name == column.term)
            for each in (less, more)
        )
        if fast is not None and not (at_rest and np.any(fast.out_of_plane)):
            rise = fast.in_plane - (0.0 if slow is None else slow.in_plane)
            out[:, j] = rise / unit * column.time_basis(motion.coefficient_time)
    return out


def _along(
    own: Evidence,
    columns: Sequence[Regressor],
    frame: RateFrame,
    flight: int,
    motion: Motion,
    by: Request,
    errs: tuple[float, float],
    alpha: FloatArray,
    places: IntArray,
) -> Along:
    """The function about angles of attack (samples,) rad, at places (places,); `errs`: weight, relative variance."""
    less, more, unit, at_rest = by(motion, alpha)
    unit = np.broadcast_to(unit, alpha.shape)[places]
    items = own.shared_tolerances
    within = [Regressor(item.name, item.component, units=item.units) for item in items]
    values, allowed = np.zeros((places.size, own.values.size)), np.zeros((places.size, len(items)))
    values[:, : len(columns)] = per_coefficient(frame, columns, flight, motion, alpha, by)[places]
    if at_rest:
        allowed = per_coefficient(frame, within, flight, motion, alpha, by)[places] * [item.size for item in items]
    groups, splines = {group.name: k for k, group in enumerate(own.rows.groups)}, dict[int, FloatArray]()
    for process in moment_processes():
        if at_rest and process.family != "stiffness":
            continue
        unity = rms_of_shapes(process, motion)
        histories = time_splines(motion.time[places], float(motion.time[0]), float(motion.time[-1]), process.splines)
        fast = process.shapes(more)
        slow = [0.0 * each for each in fast] if less is None else process.shapes(less)
        rises = [np.real(b - a)[places] / unit for a, b in zip(slow, fast, strict=True)]
        splines[groups[process.name]] = np.hstack([rise[:, np.newaxis] * histories / unity for rise in rises])
    found, sigma, correlation = own.along(flight, values, splines, allowed)
    names = [*(group.name for group in own.rows.groups), *(column.label for column in columns)]
    return Along(found, np.sqrt(sigma**2 / errs[0] + errs[1] * found**2), dict(zip(names, correlation.T, strict=False)))


# ---- Processes at their mode ----


def process_history(
    own: Evidence, place: int, splines: int, flight: int, shares: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """A process of so many splines at shares of a flight's time: each shape or channel (kinds, times), and errors."""
    known = time_splines(shares, 0.0, 1.0, splines).T
    values, sigmas = (
        np.split(each, len(own.rows.blocks))[flight].reshape(-1, splines) for each in own.spline_coefficients(place)
    )
    return values @ known, np.sqrt(sigmas**2 @ known**2)


def moment_of_process(own: Evidence, place: int, process: MomentProcess) -> tuple[float, float]:
    """The rms over flights of a process's moment coefficient and of its standard error, splines independent."""
    squares, variances = list[FloatArray](), list[FloatArray]()
    for flight, motion in enumerate(own.rows.frame.motions):
        shares = (motion.time - motion.time[0]) / (motion.time[-1] - motion.time[0])
        values, errors = process_history(own, place, process.splines, flight, shares)
        shapes = np.array(process.shapes(motion)) / rms_of_shapes(process, motion)
        squares.append(np.abs(np.sum(shapes * values, axis=0)) ** 2)
        variances.append(np.sum(np.abs(shapes) ** 2 * errors**2, axis=0))
    size, error = (float(np.sqrt(np.mean(np.concatenate(each)))) for each in (squares, variances))
    return size, error


def as_planted(own: Evidence, process: Process, flight: int) -> dict[str, float]:
    """The coefficient of every spline on a flight at its mode, by the name under which a simulation plants it."""
    place = [group.name for group in own.rows.groups].index(process.name)
    values, motion = np.split(own.spline_coefficients(place)[0], len(own.rows.blocks))[flight], own.rows.frame.motions
    if isinstance(process, MomentProcess):
        values = values / rms_of_shapes(process, motion[flight])
        kinds = [f"{process.name} {k}" for k in range(values.size // process.splines)]
    else:
        kinds = list(process.channels)
    names = (f"{kind} {k}" for kind in kinds for k in range(process.splines))
    return dict(zip(names, values.tolist(), strict=True))


class ProcessesAtMode(Mechanism):
    """What processes of moments make on one flight, as estimated."""

    name, title = "processes", "processes at their mode"
    claims, source = MomentProcess.claims, MomentProcess.source
    processes: tuple[MomentProcess, ...]
    coefficients: tuple[tuple[float, ...], ...]  # of each process, those of its first shape's splines first

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One, of all of them."""
        total = np.zeros_like(motion.alpha, dtype=complex)
        for process, values in zip(self.processes, self.coefficients, strict=True):
            histories = time_splines(motion.time, process.start, process.stop, process.splines)
            each = np.reshape(values, (-1, process.splines))
            total += sum(shape * (histories @ own) for shape, own in zip(process.shapes(motion), each, strict=True))
        return (Term(ProcessesAtMode.name, total.real.copy(), total.imag.copy()),)


def beside_its_processes(own: Evidence, fit: HypothesisFit) -> tuple[RateFrame, list[Regressor], FloatArray]:
    """A hypothesis with the processes of moments beside it as a model: frame, columns and their values."""
    known = []
    for flight, motion in enumerate(own.rows.frame.motions):
        processes = tuple(each.model_copy(update=span_of(motion)) for each in moment_processes())
        coefficients = tuple(tuple(as_planted(own, each, flight).values()) for each in processes)
        each = ProcessesAtMode(processes=processes, coefficients=coefficients)
        known.append(each.model_copy(update={"name": f"{ProcessesAtMode.name} {flight}"}))
    moments = [Regressor(each.name, ProcessesAtMode.name, flight=k) for k, each in enumerate(known)]
    frame = own.rows.frame_of(fit).with_mechanisms(known)
    return frame, [*fit.columns, *moments], np.append(fit.values, np.ones(len(moments)))
