"""A sparse description of a residual in generic terms."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import (
    CONFOUNDED_NEAR,
    DESCRIBED_CLOSEST,
    DESCRIBED_FINER,
    DESCRIBED_FREE,
    DESCRIBED_NEIGHBOURS,
    DESCRIBED_STRETCHES,
    DESCRIBED_TIMED,
)
from brv_hypo.mechanisms.yaml_mechanism import Factor, MechanismFile, YamlMechanism, YamlTerm, mechanism_of
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.regression.fit import HypothesisFit, fit_hypothesis
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.problem import Problem
from brv_hypo.residuals.candidates import Candidate, candidate_of, solved
from brv_hypo.residuals.dictionary import QUANTITIES, Entry, entries


@dataclass(frozen=True)
class Discovery:
    """A candidate of generic terms, the file that has them, and its words."""

    candidate: Candidate
    file: MechanismFile
    words: str


def discover(problem: Problem, null: HypothesisFit, name: str) -> Discovery | None:
    """The entry of the dictionary that describes best what the model does not explain; None if there is none."""
    basis, left = _left(problem)
    offered = entries(problem.frame.motions)
    gains = [_gain(_free(own, basis), left) for own in _white(problem, offered)]
    fits = []
    if gains and max(gains) > 0.0:
        fits = [_constant(problem, name, _best(problem, offered, gains, basis, left), len(gains))]
    if len(problem.records) == 1:
        fits += _all_timed(problem, name, offered, basis, left)
    if not fits:
        return None
    found = min(fits, key=lambda each: each.fit.information)
    candidate = candidate_of(problem, null, found.fit, name, "discovered")
    terms = as_terms(found.fit.selected, found.fit.values[found.fit.baseline_size :], found.mechanism)
    return Discovery(candidate, found.file.model_copy(update={"terms": terms}), found.file.title)


def _best(
    problem: Problem, offered: Sequence[Entry], gains: Sequence[float], basis: FloatArray, left: FloatArray
) -> Entry:
    """The entry of the largest gain, at its best place; a course in the first of the quantities that tell it alike."""
    leader = offered[int(np.argmax(gains))]
    if leader.follows is None:
        return _moved(problem, leader, basis, left)
    # Between the places of a grid a step of another width or quantity may look like more than the right one.
    order = sorted(range(len(offered)), key=lambda k: -gains[k])
    changing = [offered[k] for k in order if offered[k].follows is not None]
    forms = {(entry.follows, entry.form): entry for entry in reversed(changing)}
    moved = [_moved(problem, entry, basis, left) for entry in forms.values()]
    moved_gains = [_gain(_free(own, basis), left) for own in _white(problem, moved)]
    equal = [k for k, gain in enumerate(moved_gains) if gain > max(moved_gains) - CONFOUNDED_NEAR]
    first = min(equal, key=lambda k: (QUANTITIES.index(moved[k].follows or QUANTITIES[-1]), -moved_gains[k]))
    return moved[first]


def as_terms(columns: Sequence[Regressor], values: FloatArray, mechanism: YamlMechanism) -> tuple[YamlTerm, ...]:
    """The terms of a described mechanism's columns as a file holds them: one each, with its value and its jump."""
    known = {term.name: term for term in mechanism.definition}
    found = []
    for column, value in zip(columns, values, strict=True):
        term, start = known[column.term], column.time_basis.start
        changes: dict[str, object] = {"value": float(value)}
        if column.time_basis.kind == "jump":
            changes["name"] = f"{term.name}, from {start:.12g} s"
            changes["factors"] = (*term.factors, Factor(of="time", function="step", at=start))
        found.append(term.model_copy(update=changes))
    return tuple(found)


@dataclass(frozen=True)
class _Described:
    """A description as fitted; `file` has its terms without values and jumps, `entry` is the dictionary's."""

    fit: HypothesisFit
    file: MechanismFile
    mechanism: YamlMechanism
    entry: Entry


def _constant(problem: Problem, name: str, entry: Entry, entries_searched: int) -> _Described:
    """An entry that acts throughout."""
    file = _file(name, entry, entry.words)
    columns = tuple(_column(name, term.name, term.units) for term in file.terms)
    return _described(problem, file, columns, entries_searched, entry)


def _all_timed(
    problem: Problem, name: str, every: Sequence[Entry], basis: FloatArray, left: FloatArray
) -> list[_Described]:
    """Entries that change in time: the best over a stretch, the best at the times of those, and the first of them with
    times anew at its own place: beside a place a jump more makes up for what is off.
    """
    offered, count = [entry for entry in every if entry.may_change], len(every)
    fits = [_timed(problem, name, entry, count, basis, left) for entry in _changing(problem, offered, basis, left)]
    if not fits:
        return fits
    best = min(fits, key=lambda each: each.fit.information)
    bases = tuple(dict.fromkeys(column.time_basis for column in best.fit.selected))
    gains = [_gain(_free(_white(problem, [entry], bases)[0], basis), left) for entry in offered]
    again = (offered[int(np.argmax(gains))], best.entry)
    return fits + [_timed(problem, name, entry, count, basis, left) for entry in again]


def _timed(
    problem: Problem, name: str, entry: Entry, entries_searched: int, basis: FloatArray, left: FloatArray
) -> _Described:
    """An entry with jumps in time where they explain most, and then at its own best place."""
    mechanism = _Changing(definition=entry.terms)
    fit = fit_hypothesis(problem, mechanism.name, (mechanism,))
    bases = tuple(dict.fromkeys(column.time_basis for column in fit.selected))
    entry = _moved(problem, entry, basis, left, bases)
    searched = _choices(entries_searched * math.comb(fit.searched, len(bases)), len(bases))
    return _with_bases(problem, name, entry, bases, searched)


def _with_bases(problem: Problem, name: str, entry: Entry, bases: tuple[TimeBasis, ...], searched: int) -> _Described:
    """An entry with these courses in time."""
    times = sorted(time_basis.start for time_basis in bases if time_basis.kind == "jump")
    words = entry.words + (f", that changes at {', '.join(f'{time:.4g}' for time in times)} s" if times else "")
    columns = tuple(_column(name, term.name, term.units, time_basis) for time_basis in bases for term in entry.terms)
    return _described(problem, _file(name, entry, words), columns, searched, entry)


class _Changing(YamlMechanism):
    """An entry of the dictionary, constant or with jumps, its terms the components of one vector."""

    name: str = "changing"  # type: ignore[misc]
    time_variation = ("constant", "jump")
    terms_enter_together = True


def _choices(sets: int, chosen: int) -> int:
    """Of how many a choice of so many has at least this number of sets to choose from."""
    count = chosen
    while math.comb(count, chosen) < sets:
        count += 1
    return count


def _changing(problem: Problem, offered: Sequence[Entry], basis: FloatArray, left: FloatArray) -> list[Entry]:
    """The entries that explain most over some stretch; of neighbours the best alone."""
    start, stop = float(problem.frame.time.min()), float(problem.frame.time.max())
    edges = np.linspace(start, stop, DESCRIBED_STRETCHES + 1)
    stretches = [TimeBasis("jump", float(a), float(b)) for a, b in itertools.pairwise(edges)]
    gains = [_most_of_a_stretch(_free(_white(problem, [entry], stretches)[0], basis), left) for entry in offered]
    found: list[Entry] = []
    for k in sorted(range(len(gains)), key=lambda k: -gains[k]):
        if gains[k] > 0.0 and not any(_neighbours(offered[k], other) for other in found):
            found.append(offered[k])
    return found[:DESCRIBED_TIMED]


def _most_of_a_stretch(pieces: FloatArray, left: FloatArray) -> float:
    """The largest fall of the residual's squares by an entry whose parts by stretch are given (rows, columns)."""
    shape = (DESCRIBED_STRETCHES, pieces.shape[1] // DESCRIBED_STRETCHES)
    normal, right = (pieces.T @ pieces).reshape(*shape, *shape), (pieces.T @ left).reshape(shape)
    ends = itertools.combinations(range(DESCRIBED_STRETCHES + 1), 2)
    joined = np.array([(np.arange(DESCRIBED_STRETCHES) >= a) & (np.arange(DESCRIBED_STRETCHES) < b) for a, b in ends])
    of_each = np.einsum("wj,jakb,wk->wab", joined, normal, joined, optimize=True)
    return float(np.max(_fall(of_each, joined @ right)))


def _neighbours(one: Entry, other: Entry) -> bool:
    """Whether two entries are the same at places next to each other."""
    placed = one.at is not None and other.at is not None
    return placed and abs(one.position - other.position) < DESCRIBED_NEIGHBOURS * max(one.spacing, other.spacing)


def _file(name: str, entry: Entry, words: str) -> MechanismFile:
    return MechanismFile(
        name=name, title=words, claims=words, source="found in the residual of a flight", terms=entry.terms
    )


def _described(
    problem: Problem, file: MechanismFile, columns: tuple[Regressor, ...], searched: int, entry: Entry
) -> _Described:
    mechanism = mechanism_of(file)
    frame = problem.frame.with_mechanisms([mechanism])
    return _Described(solved(problem, file.name, (mechanism,), frame, columns, searched), file, mechanism, entry)


_ALWAYS = (TimeBasis("constant"),)


def _left(problem: Problem) -> tuple[FloatArray, FloatArray]:
    """An orthonormal basis (rows, rank) of the model, and what it leaves (rows,)."""
    basis = np.asarray(np.linalg.qr(problem.design(problem.frame, problem.baseline))[0], dtype=float)
    return basis, problem.response - basis @ (basis.T @ problem.response)


def _moved(
    problem: Problem, entry: Entry, basis: FloatArray, left: FloatArray, bases: Sequence[TimeBasis] = _ALWAYS
) -> Entry:
    """The entry, with these courses in time, at the place near it that explains most."""
    spacing = entry.spacing
    while entry.at is not None and spacing > DESCRIBED_CLOSEST * entry.spacing:
        places = [
            entry.at(entry.position + spacing * shift) for shift in np.linspace(-1.0, 1.0, 2 * DESCRIBED_FINER + 1)
        ]
        gains = [_gain(_free(own, basis), left) for own in _white(problem, places, bases)]
        entry = places[int(np.argmax(gains))]
        spacing /= DESCRIBED_FINER
    return entry


def _white(problem: Problem, chosen: Sequence[Entry], bases: Sequence[TimeBasis] = _ALWAYS) -> list[FloatArray]:
    """The whitened columns of each entry with these courses."""
    frame, groups = _columns(problem, chosen, bases)
    design = problem.design(frame, [column for group in groups for column in group])
    ends = np.cumsum([0, *(len(group) for group in groups)])
    return [design[:, a:b] for a, b in itertools.pairwise(ends)]


def _free(own: FloatArray, basis: FloatArray) -> FloatArray:
    """Columns less what the basis holds."""
    free = own - basis @ (basis.T @ own)
    free[:, np.linalg.norm(free, axis=0) < DESCRIBED_FREE * np.linalg.norm(own, axis=0)] = 0.0
    return np.asarray(free, dtype=float)


def _gain(columns: FloatArray, left: FloatArray) -> float:
    """Fall of the residual sum of squares."""
    return float(_fall(columns.T @ columns, columns.T @ left))


def _fall(normal: FloatArray, right: FloatArray) -> FloatArray:
    """Fall of the residual sum of squares by normal equations (..., columns, columns) and (..., columns)."""
    inverse = np.linalg.pinv(normal, rcond=1e-10, hermitian=True)
    return np.asarray(np.einsum("...a,...ab,...b->...", right, inverse, right), dtype=float)


def _columns(
    problem: Problem, chosen: Sequence[Entry], bases: Sequence[TimeBasis] = _ALWAYS
) -> tuple[RateFrame, list[tuple[Regressor, ...]]]:
    name = "dictionary"
    mechanism = YamlMechanism(definition=tuple(term for entry in chosen for term in entry.terms))
    frame = replace(problem.frame.with_mechanisms([]), mechanisms={**problem.frame.mechanisms, name: mechanism})
    return frame, [
        tuple(_column(name, term.name, term.units, time_basis) for time_basis in bases for term in entry.terms)
        for entry in chosen
    ]


def _column(mechanism: str, term: str, units: str, time_basis: TimeBasis = _ALWAYS[0]) -> Regressor:
    """A term's column; the terms of one course are chosen together."""
    return Regressor(mechanism, term, (), time_basis, units, grouped=True)
