"""A sparse description of a residual in generic terms, for what no plugin describes, in words that an analyst uses.

An entry of the dictionary is one vector or one scalar: terms that enter together. Entries with a position (a rate of
turning, a Mach number) are on a grid and can be moved. Entrances: `described` (a record), `described_in_part`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter
from typing import Literal

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.comparison.limits import even_edges
from brv_hypo.comparison.with_processes import acting
from brv_hypo.inference.fit import HypothesisFit, solved
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.reduced import Reduced
from brv_hypo.inference.unmodelled import turning_rates
from brv_hypo.io.text import times
from brv_hypo.mechanisms import yaml_mechanism
from brv_hypo.mechanisms.yaml_mechanism import Axis, Factor, MechanismFile, Quantity, Turn, YamlMechanism, YamlTerm
from brv_hypo.model.term import ALWAYS, Regressor
from brv_hypo.motion.motion import Motion
from brv_hypo.tracing.families import Beside

CONFOUNDED_NEAR = 10.0  # information that a confounded effect may lack against the leader
DESCRIBED_FINER = 5  # times by which each turn narrows the spacing of the places tried, as many to either side
DESCRIBED_CLOSEST = 0.02  # of the dictionary's spacing, at which that ends
DESCRIBED_EDGES = 17  # times, evenly over the record, between any two of which what is described may act
DESCRIBED_STEPS = 14  # places of a step, evenly over the quantity
GENERIC = "discovered"  # what is described in generic terms is called this, with the number of its step
_SOURCE = "found in the residual of a flight"

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
# Widths of a step, of the way to the next place: a sharp one leaves what several jumps would describe better.
_WIDTHS = {0.1: "", 0.3: " that is gradual", 1.0: " that is slow"}
# What a single flight cannot separate comes in this order: a slope that changes along an entry is first of all a
# function of Mach number, and nothing that follows the record's time can be said of another flight.
_QUANTITIES: dict[Quantity, str] = {"mach": "Mach", "log_reynolds": "log10 of Reynolds number", "time": "time"}


@dataclass(frozen=True)
class Entry:
    """Terms that enter together, in words; `spacing` is that of the grid which `position` lies on, `at(position)` the
    same entry elsewhere. Some are functions of a quantity, `follows`, of a `form` wherever they lie.
    """

    words: str
    terms: tuple[YamlTerm, ...]
    position: float = 0.0
    spacing: float = 0.0
    at: Callable[[float], Entry] | None = None
    follows: Quantity | None = None
    form: str = ""


def entries(motions: Sequence[Motion]) -> tuple[Entry, ...]:
    """The dictionary for these flights, without quantities that a record lacks; of several, what all share."""
    one = len(motions) == 1
    found = [*(_turning(motions[0]) if one else ()), *_throughout()]
    for quantity in list(_QUANTITIES) if one else list(_QUANTITIES)[:-1]:
        values = np.concatenate([yaml_mechanism.values_of(motion, quantity) for motion in motions])
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
    rates, step = turning_rates([motion], duration)
    near = float(np.mean(motion.p))

    def entry(rate: float) -> Entry:
        roll = ", the roll rate" if abs(abs(rate) - abs(near)) < 0.5 * np.pi / duration else ""
        turn = Turn(of="time", rate=rate)
        terms = tuple(_term(f"turns at {rate:.12g} rad/s, {axis}", axis, turn=turn) for axis in _BODY)
        words = f"a body-fixed moment that turns at {rate:.3g} rad/s ({rate / 2 / np.pi:.3g} Hz{roll})"
        return Entry(words, terms, rate, step, entry)

    return [entry(rate) for rate in rates.tolist()]


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


class Described(YamlMechanism):
    """An entry of the dictionary, its terms the components of one vector."""

    terms_enter_together = True

    @classmethod
    def by(cls, name: str, entry: Entry) -> Described:
        """The entry under a name."""
        return cls(name=name, title=entry.words, claims=entry.words, source=_SOURCE, definition=entry.terms)


def described(problem: Problem, name: str) -> HypothesisFit | None:
    """The entry of the dictionary that explains most beside the model, throughout, at its best place; None if none
    explains anything. Of functions that this flight cannot separate, one of the first quantity.
    """
    offered = entries(problem.frame.motions)
    gains = _gains(problem, offered)
    if not gains or max(gains) <= 0.0:
        return None
    leaders = [offered[int(np.argmax(gains))]]
    if leaders[0].follows is not None:
        # Between the places of a grid a step of another width or quantity may seem to explain more than the right one.
        order = sorted(range(len(offered)), key=lambda k: gains[k])
        changing = [offered[k] for k in order if offered[k].follows is not None]
        leaders = list({(entry.follows, entry.form): entry for entry in changing}.values())
    moved, quantities = _moved(problem, leaders), list(_QUANTITIES)
    known = _gains(problem, moved)
    equal = [k for k, gain in enumerate(known) if gain > max(known) - CONFOUNDED_NEAR]
    best = min(equal, key=lambda k: (quantities.index(moved[k].follows or "time"), -known[k]))
    mechanism = Described.by(name, moved[best])
    reduced = Reduced(problem, problem.frame.with_mechanisms([mechanism]))
    return solved(reduced, name, (mechanism,), (*problem.baseline, *_columns(mechanism)), len(offered))


def described_in_part(beside: Beside, like: HypothesisFit) -> HypothesisFit | None:
    """The entry that explains most between two times of one flight, at its best place, where there are no processes;
    throughout, what acts a quarter of a record keeps a quarter of what it explains.
    """
    problem, null, name = beside.rows.problem, [beside.evidence([], ())], like.name
    offered = {Described.by(name, e): e for e in entries(problem.frame.motions) if e.follows is None}
    pairs = len(offered) * math.comb(DESCRIBED_EDGES, 2)
    like = replace(like, searched=next(n for n in itertools.count(2) if math.comb(n, 2) >= pairs))
    found = acting(problem, like, list(offered), null, even_edges(problem.frame, DESCRIBED_EDGES))
    entry = next((e for m, e in offered.items() if found and m == found[0][0].mechanisms[0]), None)
    if entry is not None and entry.at is not None:
        time, starts = problem.frame.coefficient_time, sorted({c.time_basis.start for c in found[0][0].selected})
        region = np.clip([*starts, np.inf][:2], time.min(), time.max())
        shifts = entry.spacing * np.linspace(-1.0, 1.0, 2 * DESCRIBED_FINER + 1)
        nearer = [Described.by(name, entry.at(entry.position + shift)) for shift in shifts]
        found += acting(problem, like, nearer, null, region)
    return max(found, key=attrgetter("level")).fit if found else None


def file_of(fits: Sequence[tuple[YamlMechanism, Sequence[Regressor], FloatArray]]) -> MechanismFile:
    """Descriptions, each with its columns and their coefficients, as one file of mechanisms."""
    terms, words = list[YamlTerm](), list[str]()
    for mechanism, columns, values in fits:
        known = {term.name: term for term in mechanism.definition}
        label, changes = f"{mechanism.name}: " if len(fits) > 1 else "", list[float]()
        for column, value in zip(columns, values.tolist(), strict=True):
            term, start, when = known[column.term], column.time_basis.start, ""
            factors = term.factors
            if column.time_basis.kind == "jump":
                changes, when = [*changes, start], f", from {start:.12g} s"
                factors = (*factors, Factor(of="time", function="step", at=start))
            named = {"name": f"{label}{term.name}{when}", "value": value, "factors": factors}
            terms.append(term.model_copy(update=named))
        said = ", ".join(map(times, dict.fromkeys(changes)))
        words.append(mechanism.title + (f", that changes at {said}" if said else ""))
    name, whole = fits[0][0].name if len(fits) == 1 else GENERIC, " and ".join(words)
    return MechanismFile(name=name, title=whole, claims=whole, source=_SOURCE, terms=tuple(terms))


def _gains(problem: Problem, chosen: Sequence[Entry]) -> list[float]:
    """Fall of the residual sum of squares by each entry beside the model."""
    found = []
    mechanisms = [Described.by(f"entry_{k}", entry) for k, entry in enumerate(chosen)]
    reduced = Reduced(problem, problem.frame.with_mechanisms(mechanisms))
    groups = [_columns(mechanism) for mechanism in mechanisms]
    batch = reduced.batch([column for group in groups for column in group])
    ends = np.cumsum([0, *(len(group) for group in groups)])
    for a, b in itertools.pairwise(ends):
        fitted = reduced.fit(batch.of(slice(a, b)))
        found.append(float(fitted.right @ fitted.values))
    return found


def _moved(problem: Problem, entries: Sequence[Entry]) -> list[Entry]:
    """Each of some entries at the place near it that explains most."""
    share, shifts, found = 1.0, np.linspace(-1.0, 1.0, 2 * DESCRIBED_FINER + 1), list(entries)
    while share > DESCRIBED_CLOSEST:
        places = [[e if e.at is None else e.at(e.position + share * e.spacing * by) for by in shifts] for e in found]
        gains = np.reshape(_gains(problem, list(itertools.chain(*places))), (-1, shifts.size))
        found = [own[best] for own, best in zip(places, np.argmax(gains, axis=1).tolist(), strict=True)]
        share /= DESCRIBED_FINER
    return found


def _columns(mechanism: YamlMechanism) -> list[Regressor]:
    return [Regressor(mechanism.name, t.name, (), ALWAYS, t.units, grouped=True) for t in mechanism.definition]
