"""A sparse description of a residual in generic terms, for what no plugin describes, in words that an analyst uses.

An entry of the dictionary is one vector or one scalar: terms that enter together. Entries with a position (a rate of
turning, a Mach number) are laid on a grid and can be moved. Entrance: `discover`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import (
    CONFOUNDED_NEAR,
    DESCRIBED_CLOSEST,
    DESCRIBED_FINER,
    DESCRIBED_GRADUAL,
    DESCRIBED_NEIGHBOURS,
    DESCRIBED_SHARP,
    DESCRIBED_SLOW,
    DESCRIBED_STEPS,
    DESCRIBED_STRETCHES,
    DESCRIBED_TIMED,
    TURNING_RATES,
)
from brv_hypo.inference.fit import HypothesisFit, fit_hypothesis, likeliest, solved
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.reduced import Reduced
from brv_hypo.inference.unmodelled import fastest_turning
from brv_hypo.io.text import times
from brv_hypo.linearisation.linear import solve_normal
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.mechanisms.yaml_mechanism import (
    Axis,
    Factor,
    MechanismFile,
    Quantity,
    Turn,
    YamlMechanism,
    YamlTerm,
    mechanism_of,
    values_of,
)
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.motion.motion import Motion
from brv_hypo.tracing.acceptance import Candidate

# ---- The dictionary ----

_BODY: tuple[Axis, Axis] = ("body_y", "body_z")
_PLANE: tuple[Axis, Axis] = ("in_plane", "out_of_plane")
_WAVES: tuple[Literal["cos", "sin"], ...] = ("cos", "sin")
_SIDES: dict[Axis, str] = {
    "in_plane": "an in-plane",
    "out_of_plane": "an out-of-plane",
    "along_rates": "a damping",
    "across_rates": "a cross-damping",
}
_POWERS: dict[Axis, Sequence[int]] = {  # of alpha, that the baseline lacks
    "in_plane": (2, 3),
    "out_of_plane": range(4),
    "along_rates": (1, 2),
    "across_rates": range(3),
}
_POWER = {0: "", 1: " times alpha", 2: " times alpha squared", 3: " times alpha cubed"}
_ORDINAL = {1: "first", 2: "second", 3: "third", 4: "fourth"}
_TIMES = {1: "once", 2: "twice", 3: "three times", 4: "four times"}
# Widths of a step, of the way to the next place: where it is gradual, a sharp one leaves what several jumps in time
# would describe better.
_WIDTHS = {DESCRIBED_SHARP: "", DESCRIBED_GRADUAL: " that is gradual", DESCRIBED_SLOW: " that is slow"}
# What a single flight cannot tell apart comes in this order: a slope that changes along an entry is first of all a
# function of Mach number, and nothing that follows the record's time can be said of another flight.
_QUANTITIES: dict[Quantity, str] = {"mach": "Mach", "log_reynolds": "log10 of Reynolds number", "time": "time"}


@dataclass(frozen=True)
class Entry:
    """Terms that enter together, in words; `spacing` is that of the grid which `position` lies on.

    `at(position)` is the same entry elsewhere. Some are functions of a quantity, `follows`, of a `form` wherever they
    lie; the others may begin, end and jump in time.
    """

    words: str
    terms: tuple[YamlTerm, ...]
    position: float = 0.0
    spacing: float = 0.0
    at: Callable[[float], Entry] | None = None
    follows: Quantity | None = None
    form: str = ""


def entries(motions: Sequence[Motion]) -> tuple[Entry, ...]:
    """The dictionary for these flights; quantities that a record lacks or that hardly change are left out.

    Of several flights, what all share: nothing that follows the record's time.
    """
    one = len(motions) == 1
    found = [*(_turning(motions[0]) if one else ()), *_throughout()]
    for quantity in list(_QUANTITIES) if one else list(_QUANTITIES)[:-1]:
        values = np.concatenate([values_of(motion, quantity) for motion in motions])
        low, high = float(np.min(values)), float(np.max(values))
        if np.isfinite(low) and np.isfinite(high) and high - low > 1e-6 * abs(high):
            found += _steps(quantity, low, high)
    return tuple(found)


def _term(
    name: str, axis: Axis, power: int = 0, factors: tuple[Factor, ...] = (), turn: Turn | None = None
) -> YamlTerm:
    """A term with a power of alpha after its factors."""
    units = ("1", "1/rad")[power] if power < 2 else f"1/rad^{power}"
    factors = (*factors, Factor(of="alpha", power=power)) if power else factors
    return YamlTerm(name=name, axis=axis, factors=factors, turn=turn, units=units)


def _turning(motion: Motion) -> list[Entry]:
    """Body-fixed moments of constant size that turn in the body at a constant rate."""
    duration = float(motion.time[-1] - motion.time[0])
    top = fastest_turning(motion)
    step = max(np.pi / duration, 2.0 * top / TURNING_RATES)
    rates = step * np.arange(-int(top / step), int(top / step) + 1)
    near = float(np.mean(motion.p))

    def entry(rate: float) -> Entry:
        roll = ", the roll rate" if abs(abs(rate) - abs(near)) < 0.5 * np.pi / duration else ""
        turn = Turn(of="time", rate=rate)
        terms = tuple(_term(f"turns at {rate:.12g} rad/s, {axis}", axis, turn=turn) for axis in _BODY)
        words = f"a body-fixed moment that turns at {rate:.3g} rad/s ({rate / 2 / np.pi:.3g} Hz{roll})"
        return Entry(words, terms, rate, step, entry)

    return [entry(float(rate)) for rate in rates if abs(rate) > 0.5 * step]


def _throughout() -> list[Entry]:
    """Harmonics of the windward meridian, in and out of plane; moments of any direction that turn with it (in plane and
    out of plane harmonics together; once round is fixed in the body); powers of alpha, also times the rates.
    """
    found = []
    for harmonic, power, axis in itertools.product((1, 2, 3, 4), (0, 1), _PLANE):
        waves = [Factor(of="windward_meridian", function=function, rate=float(harmonic)) for function in _WAVES]
        terms = tuple(_term(f"{axis} {w.function} {harmonic} phi_w{_POWER[power]}", axis, power, (w,)) for w in waves)
        words = f"{_SIDES[axis]} moment with the {_ORDINAL[harmonic]} harmonic of the windward meridian{_POWER[power]}"
        found.append(Entry(words, terms))
    for count, power in itertools.product((-3, -2, -1, 2, 3, 4), (0, 1)):
        turn, name = Turn(of="windward_meridian", rate=float(count)), f"turned by {count} phi_w{_POWER[power]}"
        turns = f"turns {_TIMES[abs(count)]} {'against' if count < 0 else 'with'} the windward meridian"
        terms = tuple(_term(f"{axis} {name}", axis, power, turn=turn) for axis in _PLANE)
        found.append(Entry(f"a moment that {turns} in the plane of alpha{_POWER[power]}", terms))
    for axis, powers in _POWERS.items():
        for power in powers:
            how = _POWER[power].replace(" times", " with") or ", constant"
            found.append(Entry(f"{_SIDES[axis]} moment{how}", (_term(f"{axis}{_POWER[power]}", axis, power),)))
    return found


def _steps(quantity: Quantity, low: float, high: float) -> list[Entry]:
    """Steps of the stiffness, in and out of plane, at a value of the quantity, sharp or gradual."""
    spacing = (high - low) / (DESCRIBED_STEPS + 1)

    def entry(axis: Axis, share: float, value: float) -> Entry:
        what = "a step of the stiffness" if axis == "in_plane" else "an out-of-plane moment with alpha that steps"
        step = Factor(of=quantity, function="step", at=value, width=share * spacing)
        term = _term(f"{axis} alpha, step{_WIDTHS[share]} at {quantity} {value:.12g}", axis, 1, (step,))
        place = times(value) if quantity == "time" else f"{value:.5g}"
        words = f"{what} at {_QUANTITIES[quantity]} {place}{_WIDTHS[share]}"
        at, form = partial(entry, axis, share), f"{what}{_WIDTHS[share]}"
        return Entry(words, (term,), value, spacing, at, follows=quantity, form=form)

    places = [low + k * spacing for k in range(1, DESCRIBED_STEPS + 1)]
    return [entry(axis, share, value) for axis in _PLANE for share in _WIDTHS for value in places]


# ---- Its entries beside a model ----

_Bases = tuple[TimeBasis, ...]
_ALWAYS: _Bases = (TimeBasis("constant"),)


def discover(problem: Problem, null: HypothesisFit, name: str) -> Candidate | None:
    """The entry of the dictionary that describes best what the model does not explain; None if there is none."""
    search = _Search(problem, name, entries(problem.frame.motions))
    gains = search.gains(search.offered)
    found = [search.fitted(search.best(gains), _ALWAYS, len(gains))] if gains and max(gains) > 0.0 else []
    if len(problem.records) == 1:
        found += [search.timed(entry) for entry in search.best_over_stretches()]
    if not found:
        return None
    fit = likeliest(found)
    terms = as_terms(fit.selected, fit.values[fit.baseline_size :], fit.mechanisms[0])
    return Candidate("discovered", null, fit, file=file_of(name, fit.mechanisms[0].title, terms))


def file_of(name: str, words: str, terms: Sequence[YamlTerm]) -> MechanismFile:
    """A description as a file of mechanisms."""
    source = "found in the residual of a flight"
    return MechanismFile(name=name, title=words, claims=words, source=source, terms=tuple(terms))


def as_terms(columns: Sequence[Regressor], values: FloatArray, mechanism: Mechanism) -> tuple[YamlTerm, ...]:
    """Columns of a mechanism that a file defines, as one holds them: a term each, with its value and its jump."""
    known = {term.name: term for term in mechanism.definition} if isinstance(mechanism, YamlMechanism) else {}
    found = []
    for column, value in zip(columns, values, strict=True):
        term, start = known[column.term], column.time_basis.start
        changes: dict[str, object] = {"value": float(value)}
        if column.time_basis.kind == "jump":
            changes["name"] = f"{term.name}, from {start:.12g} s"
            changes["factors"] = (*term.factors, Factor(of="time", function="step", at=start))
        found.append(term.model_copy(update=changes))
    return tuple(found)


class _Changing(YamlMechanism):
    """An entry of the dictionary, constant or with jumps, its terms the components of one vector."""

    name: str = "changing"  # type: ignore[misc]
    time_variation = ("constant", "jump")
    terms_enter_together = True


@dataclass(frozen=True)
class _Search:
    """The dictionary beside a model."""

    problem: Problem
    name: str
    offered: tuple[Entry, ...]

    def gains(self, chosen: Sequence[Entry], bases: _Bases = _ALWAYS) -> list[float]:
        """Fall of the residual sum of squares by each entry, changing in time like this."""
        normal = self._normal(chosen, bases)
        return [float(right @ solve_normal(products, right, squares)) for products, right, squares in normal]

    def _normal(self, chosen: Sequence[Entry], bases: _Bases) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
        """Normal equations of each entry, changing in time like this, beside the model, and its columns' squares."""
        mechanism = YamlMechanism(definition=tuple(term for entry in chosen for term in entry.terms))
        reduced = Reduced(self.problem, self.problem.frame.with_mechanisms([mechanism]))
        groups = [_columns(mechanism.name, entry, bases) for entry in chosen]
        batch = reduced.batch([column for group in groups for column in group])
        ends = np.cumsum([0, *(len(group) for group in groups)])
        each = (batch.of(slice(a, b)) for a, b in itertools.pairwise(ends))
        return [(own.products(own), reduced.right(own), own.squares) for own in each]

    def best(self, gains: Sequence[float]) -> Entry:
        """The entry of the largest gain, at its best place; of functions that this flight cannot tell apart, one of the
        first quantity.
        """
        leader = self.offered[int(np.argmax(gains))]
        if leader.follows is None:
            return self.moved(leader)
        # Between the places of a grid a step of another width or quantity may look like more than the right one.
        order = sorted(range(len(self.offered)), key=lambda k: -gains[k])
        changing = [self.offered[k] for k in order if self.offered[k].follows is not None]
        forms = {(entry.follows, entry.form): entry for entry in reversed(changing)}
        moved = [self.moved(entry) for entry in forms.values()]
        moved_gains, quantities = self.gains(moved), list(_QUANTITIES)
        equal = [k for k, gain in enumerate(moved_gains) if gain > max(moved_gains) - CONFOUNDED_NEAR]
        return moved[min(equal, key=lambda k: (quantities.index(moved[k].follows or "time"), -moved_gains[k]))]

    def moved(self, entry: Entry, bases: _Bases = _ALWAYS) -> Entry:
        """The entry, changing in time like this, at the place near it that explains most."""
        spacing, shifts = entry.spacing, np.linspace(-1.0, 1.0, 2 * DESCRIBED_FINER + 1)
        while entry.at is not None and spacing > DESCRIBED_CLOSEST * entry.spacing:
            places = [entry.at(entry.position + spacing * shift) for shift in shifts]
            entry = places[int(np.argmax(self.gains(places, bases)))]
            spacing /= DESCRIBED_FINER
        return entry

    def timed(self, entry: Entry) -> HypothesisFit:
        """An entry with jumps in time where they explain most, and then at its own best place."""
        mechanism = _Changing(definition=entry.terms)
        fit = fit_hypothesis(self.problem, mechanism.name, (mechanism,))
        bases = tuple(dict.fromkeys(column.time_basis for column in fit.selected))
        sets = len(self.offered) * math.comb(fit.searched, len(bases))
        searched = next(count for count in itertools.count(len(bases)) if math.comb(count, len(bases)) >= sets)
        return self.fitted(self.moved(entry, bases), bases, searched)

    def fitted(self, entry: Entry, bases: _Bases, searched: int) -> HypothesisFit:
        """An entry, changing in time like this, as one of so many choices."""
        changes = sorted(time_basis.start for time_basis in bases if time_basis.kind == "jump")
        words = entry.words + (f", that changes at {', '.join(map(times, changes))}" if changes else "")
        mechanism = mechanism_of(file_of(self.name, words, entry.terms))
        reduced = Reduced(self.problem, self.problem.frame.with_mechanisms([mechanism]))
        columns = (*self.problem.baseline, *_columns(self.name, entry, bases))
        return solved(reduced, self.name, (mechanism,), columns, searched)

    def best_over_stretches(self) -> list[Entry]:
        """The entries that explain most over some stretch of time; of neighbours the best alone."""
        time, offered = self.problem.frame.time, [entry for entry in self.offered if entry.follows is None]
        edges = np.linspace(float(time.min()), float(time.max()), DESCRIBED_STRETCHES + 1)
        stretches = tuple(TimeBasis("jump", float(a), float(b)) for a, b in itertools.pairwise(edges))
        gains = [_most_of_a_stretch(*self._normal([entry], stretches)[0]) for entry in offered]
        found: list[Entry] = []
        for k in sorted(range(len(gains)), key=lambda k: -gains[k]):
            if gains[k] > 0.0 and not any(_neighbours(offered[k], other) for other in found):
                found.append(offered[k])
        return found[:DESCRIBED_TIMED]


def _most_of_a_stretch(normal: FloatArray, right: FloatArray, squares: FloatArray) -> float:
    """The largest fall of the residual's squares by an entry over neighbouring parts of the record; normal equations of
    its parts, and their squares.
    """
    count = DESCRIBED_STRETCHES
    shape = (count, right.size // count)
    normal, right = normal.reshape(*shape, *shape), right.reshape(shape)
    ends = itertools.combinations(range(count + 1), 2)
    joined = np.array([(np.arange(count) >= a) & (np.arange(count) < b) for a, b in ends])
    of_each = np.einsum("wj,jakb,wk->wab", joined, normal, joined, optimize=True)
    values = solve_normal(of_each, joined @ right, joined @ squares.reshape(shape))
    return float(np.max(np.sum((joined @ right) * values, axis=1)))


def _neighbours(one: Entry, other: Entry) -> bool:
    """Whether two entries are the same at places next to each other."""
    placed = one.at is not None and other.at is not None
    return placed and abs(one.position - other.position) < DESCRIBED_NEIGHBOURS * max(one.spacing, other.spacing)


def _columns(mechanism: str, entry: Entry, bases: _Bases) -> tuple[Regressor, ...]:
    """Columns of an entry's terms; those of one time basis are chosen together."""
    return tuple(Regressor(mechanism, t.name, (), basis, t.units, grouped=True) for basis in bases for t in entry.terms)
