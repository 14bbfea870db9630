"""A sparse description of a residual in generic terms."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.mechanisms.filed import FiledMechanism, MechanismFile, mechanism_of
from brv_hypo.model.columns import Column
from brv_hypo.model.time_variation import TimeFunction
from brv_hypo.regression.fit import HypothesisFit
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.problem import Problem
from brv_hypo.residuals.candidates import Candidate, candidate_of, solved
from brv_hypo.residuals.dictionary import Entry, entries
from brv_hypo.subset import best_subsets

_SCREENED = 10  # entries at most, of which the best subset is found exactly: 2^10 subsets
_FINER = 5  # times by which each turn narrows the spacing of the places tried, as many to either side


@dataclass(frozen=True)
class Discovery:
    """A candidate of generic terms, the file that holds them, and how many entries of the dictionary it is."""

    candidate: Candidate
    file: MechanismFile
    words: str
    pieces: int


@dataclass(frozen=True)
class Dictionary:
    """The dictionary's entries with their whitened columns in one step's regression: (rows, columns) each."""

    entries: tuple[Entry, ...]
    columns: tuple[FloatArray, ...]


def dictionary_of(problem: Problem) -> Dictionary:
    """The entries for the problem's flights."""
    found = entries(problem.frame.motions)
    return Dictionary(found, tuple(_white(problem, found)))


def discover(
    problem: Problem, null: HypothesisFit, dictionary: Dictionary, name: str, most: int
) -> Discovery | None:
    """The best description of at most `most` entries of the dictionary beside the model; None if there is
    none.

    Entries are screened one after another, moved to their best places, and the best subset of each size is
    found exactly.
    """
    response, basis = problem.response, np.linalg.qr(problem.design(problem.frame, problem.baseline))[0]
    left = response - basis @ (basis.T @ response)
    chosen: list[Entry] = []
    for _ in range(min(most + 2, _SCREENED) if most > 1 else 1):
        gains = [_gain(_free(own, basis), left) for own in dictionary.columns]
        if not gains or max(gains) <= 0.0:
            break
        best = _moved(problem, dictionary.entries[int(np.argmax(gains))], basis, left)
        own = _free(_white(problem, [best])[0], basis)
        basis = np.column_stack([basis, np.linalg.qr(own)[0]])
        left = response - basis @ (basis.T @ response)
        chosen.append(best)
    searched = len(dictionary.entries)
    fits = [_fit(problem, name, subset, searched) for subset in _subsets(problem, chosen, most)]
    if not fits:
        return None
    (fit, file), words, pieces = min(fits, key=lambda found: found[0][0].information)
    candidate = replace(candidate_of(problem, null, fit, name, "discovered"))
    valued = [
        term.model_copy(update={"value": float(v)})
        for term, v in zip(file.terms, fit.values[fit.baseline_size :], strict=True)
    ]
    return Discovery(candidate, file.model_copy(update={"terms": tuple(valued)}), words, pieces)


def _subsets(problem: Problem, chosen: Sequence[Entry], most: int) -> list[tuple[Entry, ...]]:
    """The best subsets of 1 to `most` of the chosen entries."""
    if len(chosen) <= 1:
        return [tuple(chosen)] if chosen else []
    frame, columns = _columns(problem, chosen)
    base = problem.design(problem.frame, problem.baseline)
    rows = np.column_stack([base, problem.design(frame, [c for group in columns for c in group]), problem.response])
    small = np.asarray(np.linalg.qr(rows, mode="r"), dtype=float)
    size = base.shape[1]
    ends = np.cumsum([size, *(len(group) for group in columns)])
    groups = tuple(tuple(range(a, b)) for a, b in itertools.pairwise(ends))
    widest = max(len(group) for group in groups)
    result = best_subsets(
        small[:, :-1],
        small[:, -1],
        max_terms=min(most * widest, int(ends[-1]) - size),
        forced=tuple(range(size)),
        groups=tuple(group for group in groups if len(group) > 1) or None,
    )
    found = {
        tuple(k for k, group in enumerate(groups) if group[0] in subset.columns) for subset in result.subsets
    }
    return [tuple(chosen[k] for k in members) for members in found if 0 < len(members) <= most]


def _fit(
    problem: Problem, name: str, chosen: tuple[Entry, ...], searched: int
) -> tuple[tuple[HypothesisFit, MechanismFile], str, int]:
    words = " and ".join(entry.words for entry in chosen)
    file = MechanismFile(
        name=name,
        title=words,
        claims=words,
        source="found in the residual of a flight",
        terms=tuple(term for entry in chosen for term in entry.terms),
    )
    mechanism = mechanism_of(file)
    frame = problem.frame.with_mechanisms([mechanism])
    columns = tuple(_column(name, term.name, term.units) for term in file.terms)
    return (solved(problem, name, (mechanism,), frame, columns, searched), file), words, len(chosen)


def _moved(problem: Problem, entry: Entry, basis: FloatArray, left: FloatArray) -> Entry:
    """The entry at the place near it that explains most."""
    spacing = entry.spacing
    while entry.at is not None and spacing > 0.02 * entry.spacing:
        places = [
            entry.at(entry.position + spacing * shift) for shift in np.linspace(-1.0, 1.0, 2 * _FINER + 1)
        ]
        gains = [_gain(_free(own, basis), left) for own in _white(problem, places)]
        entry = places[int(np.argmax(gains))]
        spacing /= _FINER
    return entry


def _white(problem: Problem, chosen: Sequence[Entry]) -> list[FloatArray]:
    """The whitened columns of each entry."""
    frame, groups = _columns(problem, chosen)
    design = problem.design(frame, [column for group in groups for column in group])
    ends = np.cumsum([0, *(len(group) for group in groups)])
    return [design[:, a:b] for a, b in itertools.pairwise(ends)]


def _free(own: FloatArray, basis: FloatArray) -> FloatArray:
    """Columns less what the basis holds."""
    free = own - basis @ (basis.T @ own)
    free[:, np.linalg.norm(free, axis=0) < 1e-4 * np.linalg.norm(own, axis=0)] = 0.0
    return np.asarray(free, dtype=float)


def _gain(columns: FloatArray, left: FloatArray) -> float:
    """Fall of the residual sum of squares."""
    normal, right = columns.T @ columns, columns.T @ left
    return float(right @ np.linalg.pinv(normal, rcond=1e-10, hermitian=True) @ right)


def _columns(problem: Problem, chosen: Sequence[Entry]) -> tuple[RateFrame, list[tuple[Column, ...]]]:
    name = "dictionary"
    mechanism = FiledMechanism(definition=tuple(term for entry in chosen for term in entry.terms))
    frame = replace(problem.frame.with_mechanisms([]), mechanisms={**problem.frame.mechanisms, name: mechanism})
    return frame, [tuple(_column(name, term.name, term.units) for term in entry.terms) for entry in chosen]


def _column(mechanism: str, term: str, units: str) -> Column:
    return Column(mechanism, term, (), TimeFunction("constant"), units)
