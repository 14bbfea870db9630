"""Whether a flight contradicts a frozen model, and where its static moment or damping differs between two times of it.

The coefficients that this flight has, errors of record and vehicle within their tolerances, are compared with the
frozen ones, both with their covariances: an error of pressure or inertia changes all of them alike, one of a
coefficient that one alone (`find_difference`).

Moments show little of a change of a few percent, sample by sample. Fitted to the rates as a jump that ends, beside
the frozen coefficients within their covariance, it is significant where it is (`find_local_change`). Slope and damping
as such are free beside it: one that is off throughout is no change between two times.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import stats
from scipy.linalg import orth

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import CHANGE_CHANCE, CHANGE_EDGES, CHANGE_FINER, CHANGE_ROUNDS
from brv_hypo.inference.evidence import Evidence, maximised, rows_under_own_noise
from brv_hypo.inference.fit import solved
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.reduced import Reduced
from brv_hypo.mechanisms.contract import Mechanism, Term
from brv_hypo.model.baseline import pitch_damping_term, static_terms
from brv_hypo.model.term import Regressor, TimeBasis, term_column
from brv_hypo.motion.motion import Motion
from brv_hypo.prediction.result import Difference, LocalChange

# A change that what is fitted along takes nearly all of: what is left of it, of its own length.
_SPENT = 1e-6
# Eigenvalues of a covariance, its diagonal 1, that count: less is rounding.
_KNOWN = 1e-9


class ChangedSchedule(Mechanism):
    """The slope of the static moment and pitch damping, from a time on."""

    name = "changed schedule"
    title = "slope or damping from a time on"
    claims = "a slope or a damping that differs from a schedule"
    source = "the regression"
    time_variation = ("constant", "jump")

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """C_malpha and C_mq."""
        return (static_terms(motion)[1], pitch_damping_term(motion))


def evidence_here(problem: Problem, columns: tuple[Regressor, ...]) -> tuple[Evidence, Evidence]:
    """The model's columns with free coefficients: alone, and beside all processes.

    The problem has the processes of the record. Errors of record and vehicle are within their tolerances.
    """
    frame = problem.frame.with_mechanisms([ChangedSchedule()])
    problem = replace(problem, frame=frame)
    rows, start = rows_under_own_noise(problem, solved(Reduced(problem, frame), "model", (), columns, 1))
    bare = rows.only(())
    return maximised(bare, bare.terms(None), start[:1]), maximised(rows, rows.terms(None), start)


def fixed_within(own: Evidence, columns: tuple[Regressor, ...], fixed: FloatArray, covariance: FloatArray) -> Evidence:
    """The same with coefficients `fixed` (columns,) within their covariance (fixed columns, fixed columns), but slope
    and damping as such; NaN where a coefficient is free.
    """
    rows, known = own.rows, np.flatnonzero(~np.isnan(fixed))
    x = rows.of_moments(rows.frame, columns)
    changed, always = ChangedSchedule(), TimeBasis("constant")
    throughout = [term_column(changed, term, (), always) for term in changed.terms(rows.frame.motions[0], {})]
    free = orth(np.column_stack([np.delete(x, known, axis=1), rows.of_moments(rows.frame, throughout)]))
    variances, directions = np.linalg.eigh(covariance)
    erring = x[:, known] @ (directions * np.sqrt(np.maximum(variances, 0.0)))
    within = np.isfinite(rows.spread)
    rows = replace(
        rows,
        y=rows.y - x[:, known] @ fixed[known],
        shared=np.column_stack([free, rows.shared[:, within], erring]),
        spread=np.concatenate([np.full(free.shape[1], np.inf), rows.spread[within], np.ones(known.size)]),
        coefficients=np.zeros((0, free.shape[1])),
    )
    return maximised(rows, rows.terms(None), own.at)


class _Change(NamedTuple):
    """A term's coefficient changed between two times; `gain` is the fall of the sum of squares at unit noise."""

    term: Term
    region: tuple[float, float]
    value: float
    gain: float


def find_local_change(own: Evidence) -> LocalChange | None:
    """The change of slope or damping, against before and after, that explains most; None where chance gives as much
    among so many.
    """
    frame, motion = own.rows.frame, own.rows.frame.reconstructions[0].motion
    times = frame.time[own.rows.problem.rows.part.rows]
    edges, anywhere = np.linspace(float(times.min()), float(times.max()), CHANGE_EDGES), slice(None)
    terms = ChangedSchedule().terms(frame.motions[0], {})
    change = max((_best(own, term, edges, anywhere, anywhere) for term in terms), key=lambda each: each.gain)
    spacing = float(edges[1] - edges[0])
    for _ in range(CHANGE_ROUNDS):
        near = spacing * np.linspace(-1.0, 1.0, 2 * CHANGE_FINER + 1)
        around = np.clip(np.concatenate([at + near for at in change.region]), edges[0], edges[-1])
        change = _best(own, change.term, around, slice(near.size), slice(near.size, None))
        spacing /= CHANGE_FINER
    p_value = float(stats.chi2.sf(change.gain, 1)) * len(terms) * math.comb(CHANGE_EDGES, 2)
    if change.gain <= 0.0 or p_value > CHANGE_CHANCE:
        return None
    mach = np.interp(change.region, motion.time, motion.mach)
    return LocalChange(
        term=change.term.name,
        units=change.term.units,
        start_s=change.region[0],
        stop_s=change.region[1],
        mach=(float(mach.min()), float(mach.max())) if np.all(np.isfinite(mach)) else None,
        value=change.value,
        std_error=abs(change.value) / math.sqrt(change.gain),
        f_ratio=change.gain,
        p_value=min(p_value, 1.0),
    )


def _best(own: Evidence, term: Term, edges: FloatArray, first: slice, last: slice) -> _Change:
    """The change from an edge of `first` to one of `last` that explains most beside all else."""
    changes = [term_column(ChangedSchedule(), term, (), TimeBasis("jump", float(edge))) for edge in edges]
    square, shared = own.projected_products(own.rows.of_moments(own.rows.frame, changes))
    diagonal = np.diag(square)
    length = (diagonal[:, np.newaxis] + diagonal - 2.0 * square)[first, last]
    distinct = (np.subtract.outer(edges[first], edges[last]) < 0.0) & (length > _SPENT * np.max(diagonal))
    along = (shared[:, np.newaxis] - shared)[first, last]
    length = np.where(distinct, length, 1.0)
    gains = np.where(distinct, along**2 / length, -1.0)
    place = np.unravel_index(int(np.argmax(gains)), gains.shape)
    region = float(edges[first][place[0]]), float(edges[last][place[1]])
    return _Change(term, region, float(along[place] / length[place]), float(gains[place]))


def find_difference(
    own: Evidence, columns: tuple[Regressor, ...], fixed: FloatArray, covariance: FloatArray
) -> Difference | None:
    """The frozen coefficient whose release improves the agreement most.

    `fixed` (columns,) are frozen values, NaN where there is none, `covariance` (fixed columns, fixed columns) theirs.
    """
    known = np.flatnonzero(~np.isnan(fixed))
    lasting = [k for k, j in enumerate(known) if " drift " not in columns[j].term]  # by one flight's time or speed
    known, covariance = known[lasting], covariance[np.ix_(lasting, lasting)]
    if not known.size:
        return None
    difference = own.values[known] - fixed[known]
    whole = own.covariance[np.ix_(known, known)] + covariance
    sigmas = np.sqrt(np.diag(whole))
    inverse = np.linalg.pinv(whole / np.outer(sigmas, sigmas), rcond=_KNOWN, hermitian=True)
    weights = np.sqrt(np.diag(inverse))
    beyond = inverse @ (difference / sigmas) / weights
    most = int(np.argmax(np.abs(beyond)))
    error = float(sigmas[most] / weights[most])
    return Difference(
        term=columns[known[most]].term,
        units=columns[known[most]].units,
        frozen=float(fixed[known[most]]),
        value=float(beyond[most]) * error,
        std_error=error,
        p_value=min(1.0, float(known.size * 2.0 * stats.norm.sf(abs(beyond[most])))),
        beside_processes=bool(own.rows.groups),
    )
