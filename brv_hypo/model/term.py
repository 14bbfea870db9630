"""A term of a mechanism as a regressor, at given nonlinear parameters with a basis in time; and the sum of regressors.

`TimeBasis`: how a coefficient changes in time, by linear splines with jumps and ramps (Eq. 3.6 with m = 1).
`Regressor`: one coefficient of one term of one mechanism at theta, with its time basis. `candidates` lists all
regressors of a mechanism: theta x time basis x term. The moment of a model on a motion is the sum

    C_N' = sum_k c_k b_k(t) (in plane)_k        C_Z' = sum_k c_k b_k(t) (out of plane)_k

`evaluated` gives the terms of regressors, `summed` the sum; the simulator plants what the analysis tests by it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.mechanisms.contract import Mechanism, Parameter, Term, TimeVariation
from brv_hypo.motion.motion import Motion

BASELINE = "baseline"
Theta = tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class TimeBasis:
    """A coefficient in time per unit of its value, from `start` to `stop` (s). `constant` and `jump` are 1 in [start,
    stop); `ramp` is t - start in [start, stop), 0 before and, as the truncated power function of Eq. 3.7, stays at its
    last value after: its coefficient is per second.
    """

    kind: TimeVariation
    start: float = -np.inf
    stop: float = np.inf

    def __call__(self, time: FloatArray) -> FloatArray:
        """The basis at `time`, any shape."""
        if self.kind == "ramp":
            return np.asarray(np.clip(time, self.start, self.stop) - self.start, dtype=float)
        return ((time >= self.start) & (time < self.stop)).astype(float)

    @property
    def final(self) -> float:
        """The basis after its last change."""
        return self.stop - self.start if self.kind == "ramp" else float(not np.isfinite(self.stop))

    def units(self, coefficient_units: str) -> str:
        """Units of the value that multiplies this basis."""
        return f"{coefficient_units}/s" if self.kind == "ramp" else coefficient_units


ALWAYS = TimeBasis("constant")


# ---- Regressors: which coefficient, of which mechanism, with which basis in time ----


Choice = tuple[str, str | None, Theta, TimeBasis, int | None]


@dataclass(frozen=True)
class Regressor:
    """One candidate: a term of a mechanism at theta, with a basis in time."""

    mechanism: str  # its name
    term: str  # the name of the term
    theta: Theta = ()  # nonlinear parameters of the mechanism, by name
    time_basis: TimeBasis = ALWAYS  # how the coefficient changes in time
    units: str = "1"  # of the coefficient
    grouped: bool = False  # whether terms with this time basis are components of one vector and enter together
    late_by: tuple[Parameter, ...] = field(default=(), compare=False)
    """Those parameters of theta that the mechanism declares to be delays."""
    flight: int | None = None  # the one flight of several that it acts on; None for all
    part_of: str | None = None  # the vector that a grouped term belongs to, where the mechanism has several

    @property
    def choice(self) -> Choice:
        """What is chosen with the column: a vector's components are one choice, on each flight."""
        return (self.mechanism, self.part_of if self.grouped else self.term, self.theta, self.time_basis, self.flight)

    def acts_on(self, flight: int) -> bool:
        """Whether it is part of the moments of that flight."""
        return self.flight is None or self.flight == flight

    def at(self, theta: Theta, time_basis: TimeBasis) -> Regressor:
        """The regressor at another theta, or with another time basis."""
        kept = (self.units, self.grouped, self.late_by, self.flight, self.part_of)
        return Regressor(self.mechanism, self.term, theta, time_basis, *kept)  # `replace` takes several times as long

    @property
    def delays(self) -> tuple[float, ...]:
        """The delays of the term, s."""
        theta = dict(self.theta)
        return tuple(theta[late.name] * late.seconds for late in self.late_by if late.name in theta)

    @property
    def delay(self) -> float | None:
        """The delay of the term in s, the first where there are several; None where it has none."""
        return next(iter(self.delays), None)

    @property
    def label(self) -> str:
        """The name of the coefficient in tables: what changes, and how."""
        if self.time_basis.kind == "constant":
            return self.term
        return f"{self.time_basis.kind} in {self.term}"


def delays_among(parameters: Iterable[Parameter]) -> tuple[Parameter, ...]:
    """Those that are delays."""
    return tuple(parameter for parameter in parameters if parameter.is_delay)


def default_knots(start: float, stop: float, count: int) -> FloatArray:
    """`count` times between start and stop (s), evenly spaced, the ends left out."""
    return np.linspace(start, stop, count + 2)[1:-1]


def theta_grid(mechanism: Mechanism, *, dense: bool = False) -> tuple[Theta, ...]:
    """Every point of the grid of nonlinear parameters, or the one empty point; `dense`: geometric means between too."""
    points: list[dict[str, float]] = [{}]
    for parameter in mechanism.parameters():
        grid = np.asarray(parameter.grid, dtype=float)
        if dense and np.all(grid > 0.0):
            grid = np.sort(np.concatenate([grid, np.sqrt(grid[:-1] * grid[1:])]))
        points = [{**point, parameter.name: float(value)} for point in points for value in grid]
    return tuple(tuple(point.items()) for point in points)


def candidates(
    mechanism: Mechanism, motion: Motion, knots: FloatArray, thetas: Sequence[Theta]
) -> tuple[Regressor, ...]:
    """All columns of a mechanism: theta x time basis (Eq. 3.6) x term; the motion decides only which terms are."""
    terms = mechanism.terms(motion, dict(thetas[0]))
    bases = [
        TimeBasis(kind, start)
        for kind in mechanism.time_variation
        for start in ([-np.inf] if kind == "constant" else knots.tolist())
    ]
    return tuple(
        term_column(mechanism, term, theta, time_basis) for theta in thetas for time_basis in bases for term in terms
    )


def term_column(
    mechanism: Mechanism, term: Term, theta: Theta = (), time_basis: TimeBasis = ALWAYS, flight: int | None = None
) -> Regressor:
    """The regressor of one of a mechanism's terms at a theta, with a basis in time."""
    return Regressor(
        mechanism=mechanism.name,
        term=term.name,
        theta=theta,
        time_basis=time_basis,
        units=time_basis.units(term.units),
        grouped=mechanism.terms_enter_together or term.vector is not None,
        late_by=delays_among(mechanism.parameters()),
        flight=flight,
        part_of=term.vector,
    )


def evaluated(columns: Sequence[Regressor], mechanisms: Mapping[str, Mechanism], motion: Motion) -> list[Term]:
    """The term of each column; a mechanism is evaluated once at each of its thetas."""
    known: dict[tuple[str, Theta], dict[str, Term]] = {}
    for column in columns:
        key = (column.mechanism, column.theta)
        if key not in known:
            known[key] = {term.name: term for term in mechanisms[column.mechanism].terms(motion, dict(column.theta))}
    return [known[column.mechanism, column.theta][column.term] for column in columns]


def summed(shapes: Iterable[FloatArray], weights: Iterable[Any], like: FloatArray) -> Any:
    """Sum of one channel of terms, each times its weight, coefficient x time basis; zeros as `like` where none is."""
    total: Any = np.zeros_like(like)
    for shape, weight in zip(shapes, weights, strict=True):
        total = total + weight * shape
    return total
