"""From (X, y) and the rules to the searched problem.

Rows are weighted, forced columns projected out, the rest scaled to unit length and reduced to a triangular factor.
Columns that are combinations of others are named as aliases; columns so near to dependence that rounding would decide
their coefficients are refused together, with the reason. Groups and parents say which subsets are allowed, closed
under implication. `build_frame` is the entrance.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg.lapack import dtrtrs

from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.errors import UsageError

EPS = float(np.finfo(np.float64).eps)
SPAN_TOLERANCE = 1e-12  # relative size of what is left of a column below which it counts as lying in a span
ALIAS_TOLERANCE = 1e-11  # distance of two unit columns below which they are one column under two names
# Diagonal of the triangular factor of unit columns below which a column is looked at for dependence.
WEAK_DIAGONAL = 1e-6
# What is left of a column after others, in units of its rounding error: below the first it is nothing; below the
# second fewer than five digits of it mean anything (NIST's Filip, the worst of its certified sets, has 1e6).
ROUNDING_MULTIPLE = 64.0
MEANINGFUL_MULTIPLE = 2.0**16
# Largest size, and inverse of the smallest, of a column whose sums of squares are well within double precision.
MOST_SQUARED = 1e140
NAMED_TERM = 1e-9  # relative size of the terms of a combination that are named


@dataclass(frozen=True)
class Group:
    """Columns bound by a rule: ``together`` (all in or all out) or ``at_most_one`` (none or one of them)."""

    columns: tuple[int, ...]
    rule: Literal["together", "at_most_one"]


def together(*columns: int) -> Group:
    """Columns that enter or stay out as one, for example the two components of a vector."""
    return Group(tuple(columns), "together")


def at_most_one(*columns: int) -> Group:
    """Columns of which a subset may hold one at most, for example one delay out of several."""
    return Group(tuple(columns), "at_most_one")


Groups = Sequence[Group | Sequence[int]] | None
Parents = Mapping[int, int | Sequence[int]] | None


@dataclass(frozen=True)
class Constraints:
    """The rules over m candidates, closed under implication."""

    requires: BoolArray  # (m, m): the candidates that each brings along, itself not among them
    excludes: BoolArray  # (m, m): those that cannot be in one subset with it and what it brings
    possible: BoolArray  # (m,): whether any allowed subset holds it

    @cached_property
    def active(self) -> bool:
        """Whether there is any rule at all."""
        return bool(self.requires.any() or self.excludes.any() or not self.possible.all())

    def propagated(
        self, included: Sequence[int], undecided: Sequence[int]
    ) -> tuple[tuple[int, ...], tuple[int, ...]] | None:
        """Both with what the rules imply carried out; None where no allowed subset is left."""
        if not self.active:
            return tuple(included), tuple(undecided)
        inside, alive = np.zeros((2, self.possible.size), dtype=np.bool_)
        inside[list(included)] = True
        alive[list(undecided)] = True
        brought = self.requires[inside].any(axis=0) & ~inside
        barred = self.excludes[inside].any(axis=0)
        impossible = (brought & ~alive).any() or ((inside | brought) & barred).any()
        if impossible or not self.possible[inside].all():
            return None
        alive &= ~brought & ~barred & self.possible
        alive &= ~(self.requires & ~(inside | brought | alive)[None, :]).any(axis=1)
        order = [*included, *np.flatnonzero(brought)]
        return tuple(int(j) for j in order), tuple(j for j in undecided if alive[j])


def constrained_columns(groups: Groups, parents: Parents) -> set[int]:
    """Every column that a rule names."""
    named = {column for group in _normalised(groups) for column in group.columns}
    for child, own in (parents or {}).items():
        named |= {child, *_as_tuple(own)}
    return named


def build_constraints(
    candidates: Sequence[int], forced: Collection[int], n_columns: int, groups: Groups, parents: Parents
) -> Constraints:
    """Translate rules on columns of X into rules on candidates. A column that is neither candidate nor forced (it lies
    in the forced span, so it adds nothing) counts as present as a parent, and not in a group.
    """
    position, m = {column: i for i, column in enumerate(candidates)}, len(candidates)
    outside = sorted(c for c in constrained_columns(groups, parents) if not 0 <= c < n_columns)
    if outside:
        raise UsageError(
            f"groups or parents name columns {outside}, but X has columns 0..{n_columns - 1}; "
            "number the columns as they stand in X, forced ones included"
        )
    requires, excludes = np.zeros((2, m, m), dtype=np.bool_)
    possible = np.ones(m, dtype=np.bool_)
    for group in _normalised(groups):
        members = [position[c] for c in group.columns if c in position]
        if group.rule == "together":
            requires[np.ix_(members, members)] = True
        elif any(c in forced for c in group.columns):
            possible[members] = False
        else:
            excludes[np.ix_(members, members)] = True
    for child, own in (parents or {}).items():
        if child in position:
            requires[position[child], [position[c] for c in _as_tuple(own) if c in position]] = True
    np.fill_diagonal(excludes, False)
    if not requires.any() and not excludes.any():
        return Constraints(requires, excludes, possible)
    reach = requires | np.eye(m, dtype=np.bool_)
    for k in range(m):
        reach |= reach[:, [k]] & reach[[k], :]
    clash = (reach.astype(np.uint8) @ excludes.astype(np.uint8)) > 0
    possible = possible & ~(clash & reach).any(axis=1) & ~(reach & ~possible).any(axis=1)
    # Two candidates also clash when what they bring along clashes.
    clash = (clash.astype(np.uint8) @ reach.T.astype(np.uint8)) > 0
    np.fill_diagonal(reach, False)
    np.fill_diagonal(clash, False)
    return Constraints(reach, clash, possible)


def _normalised(groups: Groups) -> list[Group]:
    return [g if isinstance(g, Group) else together(*g) for g in groups or ()]


def _as_tuple(value: int | Sequence[int]) -> tuple[int, ...]:
    return (value,) if isinstance(value, int) else tuple(value)


# ---- From (X, y) to the searched problem: weights, forced columns, scaling, aliases, triangular factor ----


class Alias(NamedTuple):
    """A column that equals a combination of others: ``x[column] = sum(weight * x[other])``."""

    column: int
    combination: tuple[tuple[int, float], ...]


class Refusal(NamedTuple):
    """Columns that no subset holds together: of the last, only rounding is left after the others."""

    columns: tuple[int, ...]
    remainder: float  # what is left of it, relative to its length
    reason: str  # that in words


@dataclass(frozen=True)
class Frame:
    """The least-squares problem that is searched: n rows, p columns, m of them candidates."""

    X: FloatArray  # the weighted columns (n, p), in the precision given
    y: FloatArray  # the weighted response (n,)
    forced: tuple[int, ...]  # columns in every subset, independent of each other
    candidates: IntArray  # columns of X to choose from (m,); everywhere else candidates go by their positions in it
    R: FloatArray  # triangular factor (m, m) of the candidates, the forced columns projected out, scaled to unit length
    z: FloatArray  # the response on the same axes (m,)
    noise: FloatArray  # rounding error of each candidate (m,), in units of eps: what projecting has cost of its digits
    rss_forced: float  # residual sum of squares of the forced columns alone
    rss_full: float  # residual sum of squares of all columns
    rank: int  # number of independent candidates
    condition: float  # condition number of R; infinite where it is not of full rank
    set_aside: tuple[Alias, ...]  # columns that are no candidates, as they equal combinations of others
    dependent: tuple[IntArray, ...]  # the columns of each linear dependency among the candidates
    constraints: Constraints  # which subsets are allowed

    @property
    def aliases(self) -> tuple[Alias, ...]:
        """Columns that are combinations of others."""
        return (*self.set_aside, *self._names[0])

    @property
    def refused(self) -> tuple[Refusal, ...]:
        """Columns that no subset holds together."""
        return self._names[1]

    @cached_property
    def _stacked(self) -> FloatArray:
        """Columns of R and, last, z, each a row (m + 1, m)."""
        return np.vstack([self.R.T, self.z])

    def columns(self, chosen: Sequence[int]) -> FloatArray:
        """Some columns of R, and z after them (m, columns + 1)."""
        return self._stacked[[*chosen, -1]].T

    @cached_property
    def _names(self) -> tuple[list[Alias], tuple[Refusal, ...]]:
        """The dependencies by name: fits of long columns, which a search for columns alone does without."""
        return _named(self.X.astype(np.float64), self.forced, self.dependent)


def build_frame(
    X: ArrayLike, y: ArrayLike, forced: Sequence[int], weights: ArrayLike | None, groups: Groups, parents: Parents
) -> Frame:
    """Check the input and reduce it to a triangular problem; UsageError for what is unfit."""
    X_given, y_given, forced_columns = _checked(X, y, forced, weights)
    X64, y64 = X_given.astype(np.float64), y_given.astype(np.float64)
    basis, kept_forced, aliases = _forced_basis(X64, forced_columns)
    free = np.array([j for j in range(X64.shape[1]) if j not in set(forced_columns)], dtype=np.int64)
    projected, norms = project_out(basis, X64[:, free])
    rest = project_out(basis, y64[:, None])[0][:, 0]
    original = np.linalg.norm(X64[:, free], axis=0)
    inside = norms <= SPAN_TOLERANCE * original
    aliases += _span_aliases(X64, kept_forced, free[inside])
    free, units = free[~inside], projected[:, ~inside] / norms[~inside]
    keep, duplicates = _representatives(units, free, norms[~inside], constrained_columns(groups, parents))
    aliases += duplicates
    free, units = free[keep], units[:, keep]

    m = free.size
    factor = square_triangle(np.column_stack([units, rest]))
    R = factor[:m, :m].copy()
    noise = (original[~inside] / norms[~inside])[keep]
    independent, involved = dependencies(R, noise)
    condition = (float(np.linalg.cond(R)) if m else 1.0) if len(independent) == m else np.inf
    return Frame(
        X=X_given, y=y_given, forced=kept_forced, candidates=free, R=R, z=factor[:m, m].copy(),
        noise=noise,
        rss_forced=float(rest @ rest), rss_full=float(factor[m, m] ** 2), rank=len(independent),
        condition=condition,
        set_aside=tuple(aliases), dependent=tuple(free[list(each)] for each in involved),
        constraints=build_constraints(free.tolist(), forced_columns, X64.shape[1], groups, parents),
    )  # fmt: skip


# ---- Triangular factors, and the linear dependencies that they show ----


def triangle(columns: FloatArray) -> FloatArray:
    """The triangular factor R of the columns, by Householder reflections."""
    return np.asarray(np.linalg.qr(columns, mode="r"), dtype=np.float64)


def square_triangle(columns: FloatArray) -> FloatArray:
    """The triangular factor with rows of zeros below it where there are fewer rows than columns."""
    factor = triangle(columns)
    square = np.zeros((columns.shape[1], columns.shape[1]))
    square[: factor.shape[0]] = factor
    return square


def dependency(R: FloatArray, noise: FloatArray) -> list[int]:
    """Positions of the columns in the first linear dependency of a triangular factor; empty for full rank. What is left
    of a column after those before it, R_kk, is nothing where it is within a multiple of the rounding error.
    """
    for k in np.flatnonzero(np.abs(R.diagonal()) <= WEAK_DIAGONAL).tolist():
        weights = np.append(dtrtrs(R[:k, :k], R[:k, k])[0], 1.0)
        if abs(R[k, k]) <= MEANINGFUL_MULTIPLE * EPS * float(np.abs(weights) @ noise[: k + 1]):
            return np.flatnonzero(np.abs(weights) > 1e-10 * np.abs(weights).max()).tolist()
    return []


def dependencies(R: FloatArray, noise: FloatArray) -> tuple[list[int], list[tuple[int, ...]]]:
    """Positions of columns that span all of them, and of those in each dependency, whose last is left out."""
    kept = list(range(R.shape[1]))
    found = []
    factor = R
    while involved := dependency(factor, noise[kept]):
        found.append(tuple(kept[i] for i in involved))
        del kept[involved[-1]]
        factor = triangle(R[:, kept])
    return kept, found


# ---- Input checked; columns inside a span, parallel ones, and the names of dependencies ----


def _checked(
    X: ArrayLike, y: ArrayLike, forced: Sequence[int], weights: ArrayLike | None
) -> tuple[FloatArray, FloatArray, tuple[int, ...]]:
    """X and y with their rows weighted, and the forced columns, each once."""
    X_array, y_array = np.asarray(X), np.asarray(y)
    if X_array.ndim != 2 or y_array.ndim != 1 or X_array.shape[0] != y_array.size:
        raise UsageError(
            f"X has shape {X_array.shape} and y {y_array.shape}; expected (n, p) and (n,): "
            "one row per sample, one column per term"
        )
    # Extended precision is kept for the final fit; anything else becomes double.
    wanted = np.longdouble if X_array.dtype == np.longdouble else np.float64
    X_array, y_array = X_array.astype(wanted), y_array.astype(wanted)
    bad_columns = np.flatnonzero(~np.isfinite(X_array).all(axis=0))
    if bad_columns.size or not np.isfinite(y_array).all():
        where = f"columns {bad_columns.tolist()} of X" if bad_columns.size else "y"
        raise UsageError(f"{where} hold values that are not finite; drop or mask those rows before the search")
    if weights is not None:
        w = np.asarray(weights, dtype=np.float64)
        if w.shape != y_array.shape or not np.isfinite(w).all() or (w < 0).any():
            raise UsageError(f"weights have shape {w.shape}; expected {y_array.size} finite values >= 0, one per row")
        root = np.sqrt(w).astype(wanted)
        X_array, y_array = X_array * root[:, None], y_array * root
    columns = tuple(dict.fromkeys(int(j) for j in forced))
    outside = [j for j in columns if not 0 <= j < X_array.shape[1]]
    if outside:
        known = f"X has columns 0..{X_array.shape[1] - 1}"
        raise UsageError(f"forced names columns {outside}, but {known}; use forced=() for none")
    for name, values in (*((f"column {j} of X", column) for j, column in enumerate(X_array.T)), ("y", y_array)):
        largest = float(np.max(np.abs(values), initial=0.0))
        if largest > MOST_SQUARED or 0.0 < largest < 1.0 / MOST_SQUARED:
            raise UsageError(
                f"{name} reaches {largest:.3g}, expected {1.0 / MOST_SQUARED:g} to {MOST_SQUARED:g}: the sum of its "
                "squares is beyond double precision. Give it in another unit"
            )
    return X_array, y_array, columns


def _forced_basis(X: FloatArray, forced: tuple[int, ...]) -> tuple[FloatArray, tuple[int, ...], list[Alias]]:
    """Orthonormal basis of the forced columns; dependent ones are reported and left out."""
    basis = np.empty((X.shape[0], 0))
    kept: list[int] = []
    aliases: list[Alias] = []
    for j in forced:
        rest, norm = project_out(basis, X[:, [j]])
        if norm[0] <= SPAN_TOLERANCE * np.linalg.norm(X[:, j]):
            aliases += _span_aliases(X, tuple(kept), np.array([j]))
            continue
        basis = np.column_stack([basis, rest / norm[0]])
        kept.append(j)
    return basis, tuple(kept), aliases


def project_out(basis: FloatArray, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Remove the basis from the columns, twice for orthogonality to rounding; also their norms."""
    rest = columns - basis @ (basis.T @ columns)
    rest -= basis @ (basis.T @ rest)
    return rest, np.linalg.norm(rest, axis=0)


def _span_aliases(X: FloatArray, kept: tuple[int, ...], inside: IntArray) -> list[Alias]:
    if not len(inside):
        return []
    weights = np.asarray(np.linalg.lstsq(X[:, list(kept)], X[:, inside], rcond=None)[0], dtype=np.float64)
    return [Alias(int(j), _combination(kept, weights[:, i])) for i, j in enumerate(inside)]


def _named(
    X: FloatArray, forced: tuple[int, ...], involved: Sequence[IntArray]
) -> tuple[list[Alias], tuple[Refusal, ...]]:
    """Dependencies of columns of X: combinations, or refusals where something is left; none with too few rows."""
    aliases, refused = [], []
    for columns in involved:
        *others, last = columns.tolist()
        base = [*forced, *others]
        if len(base) >= X.shape[0]:
            continue
        scale = np.linalg.norm(X[:, base], axis=0)
        weights = np.asarray(np.linalg.lstsq(X[:, base] / scale, X[:, last], rcond=None)[0], dtype=np.float64)
        length = float(np.linalg.norm(X[:, last]))
        left = float(np.linalg.norm(X[:, last] - X[:, base] @ (weights / scale)))
        named = _combination(base, weights, scale)
        if left <= ROUNDING_MULTIPLE * EPS * (length + float(np.abs(weights).sum())):
            aliases.append(Alias(last, named))
            continue
        together = (*(c for c, _ in named if c not in forced), last)
        refused.append(
            Refusal(
                together,
                left / length,
                f"columns {list(together)} are refused together: after the others only {left / length:.1g} of column "
                f"{last} is left, of which rounding takes all but a few digits; coefficients of the order of "
                f"{length / left:.1g} would come of it. Leave one of them out, or form their difference in X itself",
            )
        )
    return aliases, tuple(refused)


def _combination(
    columns: Sequence[int], weights: FloatArray, scale: FloatArray | float = 1.0
) -> tuple[tuple[int, float], ...]:
    """The terms that count of a combination of columns, its weights (columns,) being those of columns over `scale`."""
    kept = np.flatnonzero(np.abs(weights) > NAMED_TERM * np.abs(weights).max(initial=0.0))
    return tuple((int(columns[i]), float(w)) for i, w in zip(kept.tolist(), (weights / scale)[kept], strict=True))


def _representatives(
    units: FloatArray, free: IntArray, norms: FloatArray, unmergeable: set[int]
) -> tuple[IntArray, list[Alias]]:
    """The first of every class of parallel columns, the rest as its aliases, but those that a rule names."""
    correlation = np.abs(units.T @ units)
    suspects = np.argwhere(np.triu(correlation > 1.0 - 1e-12, k=1))
    merged: dict[int, int] = {}
    aliases = []
    for i, j in suspects:
        if i in merged or j in merged or free[i] in unmergeable or free[j] in unmergeable:
            continue
        sign = np.sign(units[:, i] @ units[:, j])
        if np.linalg.norm(units[:, i] - sign * units[:, j]) <= ALIAS_TOLERANCE:
            merged[int(j)] = int(i)
            aliases.append(Alias(int(free[j]), ((int(free[i]), float(sign * norms[j] / norms[i])),)))
    return np.array([i for i in range(free.size) if i not in merged], dtype=np.int64), aliases
