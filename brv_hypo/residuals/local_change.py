"""Whether a flight contradicts a frozen model, and where its static moment or damping differs between two times of it.

The coefficients that this flight asks for, errors of record and vehicle within their tolerances, are held against the
frozen ones, both with their covariances: an error of pressure or inertia changes all of them alike, one of a
coefficient that one alone (`find_difference`).

Moments show little of a change of a few percent, sample by sample. Fitted to the rates as a jump that ends, beside all
that is fitted along and the frozen coefficients within their covariance, it stands out where it is. Slope and damping
as such are free beside it: one that is off throughout is no change between two times.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import CHANGE_CHANCE, CHANGE_EDGES, CHANGE_FINER, CHANGE_ROUNDS
from brv_hypo.inference.evidence import maximised, rows_under_own_noise
from brv_hypo.mechanisms.contract import Mechanism, Term
from brv_hypo.model.baseline import pitch_damping_term, static_terms
from brv_hypo.model.term import Regressor, TimeBasis, term_column
from brv_hypo.motion.motion import Motion
from brv_hypo.regression.fit import solved
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.linear import lengths
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.reduced import Reduced
from brv_hypo.residuals.prediction import Difference, LocalChange

# A change that is no longer told from what is fitted along, of its own length.
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


@dataclass(frozen=True)
class Rest:
    """The rows once all else is fitted: an orthonormal `basis` (rows, rank) of that, and what it leaves (rows,)."""

    problem: Problem
    frame: RateFrame
    basis: FloatArray
    left: FloatArray

    def columns(self, term: Term, edges: FloatArray) -> FloatArray:
        """A change of the term's coefficient from each edge (s) on, less what the rest takes up (rows, edges)."""
        changes = [_column(term, TimeBasis("jump", float(edge))) for edge in edges]
        design = _with_priors(self.problem.raw_design(self.frame, changes), self.basis.shape[0])
        return np.asarray(design - self.basis @ (self.basis.T @ design), dtype=float)

    def best(self, term: Term, edges: FloatArray, first: slice, last: slice) -> _Change:
        """The change from an edge of `first` to one of `last` that explains most."""
        columns = self.columns(term, edges)
        square, shared = columns.T @ columns, columns.T @ self.left
        own = np.diag(square)
        length = (own[:, np.newaxis] + own - 2.0 * square)[first, last]
        told = (np.subtract.outer(edges[first], edges[last]) < 0.0) & (length > _SPENT * np.max(own))
        along = (shared[:, np.newaxis] - shared)[first, last]
        gains = np.where(told, along**2 / np.where(told, length, 1.0), -1.0)
        start, stop = np.unravel_index(int(np.argmax(gains)), gains.shape)
        column = columns[:, first][:, start] - columns[:, last][:, stop]
        region = float(edges[first][start]), float(edges[last][stop])
        return _Change(term, region, float(gains[start, stop]), column)


@dataclass(frozen=True)
class _Change:
    """A term's coefficient changed between two times; `gain` is the fall of the sum of squares."""

    term: Term
    region: tuple[float, float]
    gain: float
    column: FloatArray


def find_local_change(rest: Rest) -> LocalChange | None:
    """The change of slope or damping, against before and after, that explains most; None where it may be chance."""
    frame = rest.frame
    times = frame.time[rest.problem.rows.part.rows]
    edges, anywhere = np.linspace(float(times.min()), float(times.max()), CHANGE_EDGES), slice(None)
    terms = ChangedSchedule().terms(frame.motions[0], {})
    change = max((rest.best(term, edges, anywhere, anywhere) for term in terms), key=lambda each: each.gain)
    spacing = float(edges[1] - edges[0])
    for _ in range(CHANGE_ROUNDS):
        near = spacing * np.linspace(-1.0, 1.0, 2 * CHANGE_FINER + 1)
        around = np.clip(np.concatenate([at + near for at in change.region]), edges[0], edges[-1])
        change = rest.best(change.term, around, slice(near.size), slice(near.size, None))
        spacing /= CHANGE_FINER
    return _told(rest, change, len(terms) * math.comb(CHANGE_EDGES, 2))


def find_difference(
    problem: Problem, columns: tuple[Regressor, ...], held: FloatArray, covariance: FloatArray
) -> Difference | None:
    """The frozen coefficient whose release improves the agreement most.

    `held` (columns,) are frozen values, NaN where there is none, `covariance` (held columns, held columns) theirs. The
    problem may have processes, which are used where the evidence wants them.
    """
    known = np.flatnonzero(~np.isnan(held))
    if not known.size:
        return None
    point = solved(Reduced(problem, problem.frame), "model", (), columns, 1)
    rows, start = rows_under_own_noise(problem, point)
    bare = replace(rows, blocks=(), groups=())
    without, beside = maximised(bare, bare.terms(None), start[:1]), maximised(rows, rows.terms(None), start)
    own = max(without, beside, key=lambda each: each.level)
    difference = own.values[known] - held[known]
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
        frozen=float(held[known[most]]),
        value=float(beyond[most]) * error,
        std_error=error,
        p_value=min(1.0, float(known.size * 2.0 * stats.norm.sf(abs(beyond[most])))),
        beside_processes=own is beside,
    )


def rest_of(
    problem: Problem,
    frame: RateFrame,
    columns: Sequence[Regressor],
    held: FloatArray,
    others: FloatArray,
    covariance: FloatArray,
) -> Rest:
    """What is fitted here with slope and damping, and the frozen coefficients by as much as they may err.

    `held` (columns,) and `others` (unknowns,) are frozen values, NaN where they are fitted here; `covariance` (held
    columns, held columns) is that of the former, which have a row each for it. One flight.
    """
    frame = frame.with_mechanisms([ChangedSchedule()])
    constants = np.full(2 * len(problem.rows.part.levels), np.nan)
    fixed = np.concatenate([held, constants, others])
    free = np.isnan(fixed)
    design = problem.whole_design(frame, columns)
    response = problem.raw_response - design @ np.nan_to_num(fixed)
    variances, directions = np.linalg.eigh(covariance)
    known = np.flatnonzero(~np.isnan(held))
    erring = design[:, known] @ (directions * np.sqrt(np.maximum(variances, 0.0)))
    rows = design.shape[0] + known.size
    terms = ChangedSchedule().terms(frame.motions[0], {})
    throughout = [_column(term, TimeBasis("constant")) for term in terms]
    fitted = np.column_stack([problem.raw_design(frame, throughout), design[:, free], erring])
    whole = _with_priors(fitted, rows)
    whole[design.shape[0] :, whole.shape[1] - known.size :] = np.eye(known.size)
    basis = np.asarray(np.linalg.qr(whole / lengths(whole))[0], dtype=float)
    response = _with_priors(response[:, np.newaxis], rows)[:, 0]
    return Rest(problem, frame, basis, response - basis @ (basis.T @ response))


def _column(term: Term, time_basis: TimeBasis) -> Regressor:
    return term_column(ChangedSchedule(), term, (), time_basis)


def _with_priors(rows: FloatArray, count: int) -> FloatArray:
    """Rows (rows, columns), and below them zeros to make so many."""
    return np.concatenate([rows, np.zeros((count - rows.shape[0], rows.shape[1]))])


def _told(rest: Rest, change: _Change, searched: int) -> LocalChange | None:
    """The change with its errors; None where chance gives as much among so many."""
    if change.gain <= 0.0:
        return None
    value = float(change.column @ rest.left) / float(change.column @ change.column)
    residual = rest.left - value * change.column
    problem = rest.problem
    efficiency, freedom = problem.efficiency_of(residual), problem.samples - rest.basis.shape[1] - 1
    variance = float(residual @ residual) / freedom / efficiency
    f_ratio = change.gain / variance
    chance = float(stats.f.sf(f_ratio, 1, max(efficiency * freedom, 1.0)))
    if chance * searched > CHANGE_CHANCE:
        return None
    motion = rest.frame.reconstructions[0].motion
    mach = np.interp(change.region, motion.time, motion.mach)
    return LocalChange(
        term=change.term.name,
        units=change.term.units,
        start_s=change.region[0],
        stop_s=change.region[1],
        mach=(float(mach.min()), float(mach.max())) if np.all(np.isfinite(mach)) else None,
        value=value,
        std_error=math.sqrt(variance / float(change.column @ change.column)),
        f_ratio=f_ratio,
        p_value=min(chance * searched, 1.0),
    )
