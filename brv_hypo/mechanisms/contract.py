"""The plugin border: all that a mechanism package needs to know.

A mechanism is one vectorised definition, from the motion to the moment-coefficient columns. Regression uses the columns
as they are; the likelihood adds them up, times their coefficients, as the moment in the equations of motion; the
simulator evaluates them at the running state; the residual loop tries them against the residual. A record effect is the
other kind of hypothesis: a perturbation of the record.

A plugin is a module that an entry point of the group `brv_hypo.mechanisms` names. It implements a hook, or both:
`brv_hypo_mechanisms` gives moments, `brv_hypo_record_effects` errors of the record, processes with either; one of each.

Class variables say what else is known of the mechanism. A process is a moment (`shapes`), or an error of the record
(`changed`), with an unknown smooth time history: it is no hypothesis, every hypothesis has it. `brv-hypo docs
mechanism` has examples, `brv-hypo mechanisms new NAME` writes a package with its entry point, `check NAME` tests it.
The built-in mechanisms are registered in this way and in no other.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
import pluggy
from pydantic import BaseModel, ConfigDict, Field

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.flight.units import to_si
from brv_hypo.motion.interpolation import time_splines
from brv_hypo.motion.motion import Motion

hookimpl = pluggy.HookimplMarker("brv_hypo")
TimeVariation = Literal["constant", "jump", "ramp"]
Delays = Annotated[tuple[Annotated[float, Field(gt=0.0, allow_inf_nan=False)], ...], Field(min_length=1)]
"""Those that are searched first, s, increasing, as an option of a mechanism."""
FAMILIES = ("stiffness", "rate", "side", "body", "harmonic", "air", "gyros", "accelerometers", "data quality")
"""What kind of thing a record effect or a process is."""


def current_name(name: str) -> str:
    """Today's name of a term: older files call the static moment's coefficients C_N0, C_Nalpha, C_Nalpha3."""
    return re.sub(r"\bC_N(0|alpha3?)\b", r"C_m\1", name)


@dataclass(frozen=True)
class Parameter:
    """A nonlinear parameter theta of a mechanism: `grid` is searched, then refined inside `bounds`."""

    name: str  # its key in theta; any but 'knot', 'start' and 'stop'
    units: str  # what grid, bounds and theta are in; any unit
    grid: tuple[float, ...]  # values to search, increasing, inside `bounds`
    bounds: tuple[float, float]  # least and greatest value
    meaning: str  # one line for a reader
    is_delay: bool = False  # whether `terms` uses the motion so much earlier

    @property
    def seconds(self) -> float:
        """Seconds in one of its units; raises FlightRecordError where that is no unit of time."""
        return float(to_si(1.0, self.units, "time", self.name))


@dataclass(frozen=True)
class Term:
    """One column: C_N' and C_Z' per unit of its coefficient, on the motion's shape."""

    name: str
    in_plane: FloatArray
    out_of_plane: FloatArray
    units: str = "1"  # of the coefficient; the columns times the coefficient are dimensionless
    vector: str | None = None  # terms with the same name here are components of one vector and enter together


@dataclass(frozen=True)
class Derived:
    """A quantity that follows from the coefficients, such as phi_b."""

    name: str
    value: float  # in `units`
    std_error: float  # 1 sigma, in `units`
    units: str  # "1": dimensionless, "rad": an angle, shown in degrees too

    @classmethod
    def polar(
        cls,
        size: str,
        angle: str,
        pair: tuple[float, float],
        covariance: FloatArray,
        sense: float = 1.0,
        units: str = "1",
    ) -> tuple[Derived, ...]:
        """Two coefficients (x, y) of the same `units` in polar coordinates, to first order in their covariance (2, 2).

        Size, in `units`, and angle, atan2(sense y, x) in rad, with the names `size` and `angle`; nothing where both are
        0. The angle's standard error is at most that of an unknown one.
        """
        x, y = pair
        length = float(np.hypot(x, y))
        if length == 0.0:
            return ()
        axes = np.array([[x, y], [-y, x]]) / length
        along, across = np.sqrt(np.einsum("ij,jk,ik->i", axes, covariance, axes)).tolist()
        turned = cls(angle, float(np.arctan2(sense * y, x)), min(across / length, np.pi / np.sqrt(3.0)), "rad")
        return cls(size, length, along, units), turned


class Component(NamedTuple):
    """One value of a record effect: `size` is the 1-sigma tolerance to which the record knows it, in SI `units`."""

    name: str
    units: str
    size: float


class Mechanism(BaseModel, ABC):
    """A hypothesis about the moments. Subclass it, set the class variables, write `terms`.

    Instance fields are the mechanism's options: pydantic checks what a configuration sets. Class variables:

    time_variation        how a coefficient may change in time (Eq. 3.6): constant, jumps at knots, ramps from knots
    terms_enter_together  the terms of one region are components of one vector: they enter and leave together
    stated_family         one of `FAMILIES`; None: that of the processes whose shapes make most of its moment
    characteristic        names of the terms without one of which a fit says nothing of this mechanism in particular, as
                          a stiffness that changes says nothing of asymmetric flow; empty where every term does
    bounds                least and greatest net coefficient on any body, by term: {"eps": (0.0, 1.0)} of a fraction
    wind_fixed            the terms belong to the wind-fixed in-plane moment C_mw of Eq. 5.1
    follows               the quantity whose schedule the terms are, which comes before jumps in time; a model that has
                          taken in one by Mach number has that schedule, smooth, from then on
    """

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    name: ClassVar[str]
    title: ClassVar[str]
    claims: ClassVar[str]
    source: ClassVar[str]
    kind: ClassVar[Literal["mechanism", "aerodynamic", "process"]] = "mechanism"
    time_variation: ClassVar[tuple[TimeVariation, ...]] = ("constant", "jump")
    terms_enter_together: ClassVar[bool] = False
    stated_family: ClassVar[str | None] = None
    characteristic: ClassVar[tuple[str, ...]] = ()
    bounds: ClassVar[Mapping[str, tuple[float, float]]] = {}
    wind_fixed: ClassVar[bool] = False
    follows: ClassVar[Literal["mach", "reynolds"] | None] = None

    def parameters(self) -> tuple[Parameter, ...]:
        """The nonlinear parameters, each a key of `theta`, with units, grid and bounds; none by default."""
        return ()

    @abstractmethod
    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """The columns at this motion, each of the motion's shape; pure, elementwise, and the same in number and order
        for every `theta`: the nonlinear parameters by name, in their own units.
        """

    def knots(self, motion: Motion) -> FloatArray | None:
        """Times (s) at which coefficients may change; None leaves them to the engine."""
        return None

    def derived(self, values: Mapping[str, float], covariance: FloatArray) -> tuple[Derived, ...]:
        """Quantities that follow from one region's coefficients; none by default.

        `values` are the coefficients by name of term, in the terms' units; `covariance` (n, n) is theirs, in the order
        of `terms`. Each quantity has units and a standard error of its own.
        """
        return ()

    def tolerance(self, flight: Flight) -> tuple[float, ...] | None:
        """1-sigma of each term's coefficient, in its units and the order of `terms`, that the tolerances of the vehicle
        (`flight.instruments`) allow; None: not a tolerance.

        A mechanism with one is part of every hypothesis, with that Gaussian prior; one of another distribution where
        its file (`--plugin`) or its name is given.
        """
        return None

    def of_each_flight(self, flight: Flight) -> bool:
        """Whether each of several flights has coefficients of its own, as of a c.g. offset; what is timed has."""
        return self.tolerance(flight) is not None


class RecordEffect(BaseModel, ABC):
    """An instrument or environment effect: a perturbation of the record, linear for small values.

    `perturb(flight, component, value)` returns the record as it would read had that component the value (SI) more.
    Its columns are the derivative of the reconstructed moments with respect to the value.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: ClassVar[str]
    title: ClassVar[str]
    claims: ClassVar[str]
    source: ClassVar[str]
    kind: ClassVar[Literal["instrument", "environment"]]
    family: ClassVar[str] = "data quality"  # one of `FAMILIES`: whose residual it would explain
    carried: ClassVar[bool] = True
    """Whether it is part of every hypothesis, with the prior that the tolerances in `components` give it; of another
    distribution where its file (`--plugin`) or its name is given. False for hypotheses of their own, as wind steps."""

    def variants(self, flight: Flight) -> tuple[RecordEffect, ...]:
        """The effect with each setting to try on this flight, such as an unknown time; itself by default."""
        return (self,)

    @abstractmethod
    def components(self, flight: Flight) -> tuple[Component, ...]:
        """Each value that the effect has, with its tolerance on this flight (`flight.instruments`)."""

    @abstractmethod
    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with `value` (SI) of that component added."""


class MomentProcess(Mechanism):
    """Shapes of a moment, each times an unknown smooth history in time; every hypothesis of `compare` has all of them.

    A shape has cubic B-splines over [`start`, `stop`] s; their coefficients share one amplitude, which is estimated,
    zero included; 1 % of the static moment is ordinary (`thresholds.MOMENT_AMPLITUDE`). One unit is a coefficient of 1.
    """

    claims = "nothing in particular: a smooth change that any hypothesis may have beside it"
    source = "Kennedy and O'Hagan, J. R. Stat. Soc. B 63:425, 2001"
    kind = "process"
    time_variation = ("constant",)

    family: ClassVar[str]  # one of `FAMILIES`
    splines: ClassVar[int]  # how many each shape has: 1, a constant, or at least 4
    start: float = 0.0
    stop: float = 1.0

    @abstractmethod
    def shapes(self, motion: Motion) -> Sequence[ComplexArray]:
        """C_m,in + i C_n,side of each shape, on the motion's own."""

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One for each shape and spline."""
        histories, terms = time_splines(motion.time, self.start, self.stop, self.splines), list[Term]()
        for number, shape in enumerate(self.shapes(motion)):
            for k in range(self.splines):
                product = shape * histories[..., k]
                terms.append(Term(f"{self.name} {number} {k}", product.real.copy(), product.imag.copy()))
        return tuple(terms)


def span_of(motion: Motion) -> dict[str, float]:
    """`start` and `stop` of a process whose splines are over all of a motion."""
    return {"start": float(motion.time[0]), "stop": float(motion.time[-1])}


def rms_of_shapes(process: MomentProcess, motion: Motion) -> float:
    """Of all shapes of a process together over a motion: what a coefficient of 1 makes; tiny where that is nothing."""
    return max(float(np.sqrt(np.mean(np.abs(np.array(process.shapes(motion))) ** 2))), 1e-300)


class RecordProcess(RecordEffect):
    """A channel's error with an unknown smooth history, in cubic B-splines over the record of one estimated size."""

    claims = MomentProcess.claims
    source = MomentProcess.source
    carried = False

    channels: ClassVar[tuple[str, ...]]
    splines: ClassVar[int]  # how many each channel has: 1, a constant, or at least 4
    units: ClassVar[str]  # SI units of the history
    size: ClassVar[float]  # one unit of the amplitude, whose prior is centred on a tenth of it

    def components(self, flight: Flight) -> tuple[Component, ...]:
        """One for each channel and spline."""
        names = (f"{channel} {k}" for channel in self.channels for k in range(self.splines))
        return tuple(Component(name, self.units, self.size) for name in names)

    def perturb(self, flight: Flight, component: str, value: float) -> Flight:
        """The record with so much of one spline more."""
        channel, _, number = component.rpartition(" ")
        histories = time_splines(flight.time, float(flight.time[0]), float(flight.time[-1]), self.splines)
        return self.changed(flight, channel, value * histories[..., int(number)])

    @abstractmethod
    def changed(self, flight: Flight, channel: str, history: FloatArray) -> Flight:
        """The record with a history (n,) more in that channel."""


Process = MomentProcess | RecordProcess
