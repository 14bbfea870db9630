"""Compiled parts that both kernels share: working arrays, quota, closed-form scoring, rules on the path.

Imported only when a compiled kernel is wanted: importing numba costs more than most searches.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

# What a path has decided about a column.
UNDECIDED, INCLUDED, DROPPED = 0, 1, 2
# Where a level stands: not looked at, its include branch taken, taken with no drop branch to follow.
NEW, BRANCHED, FORCED = 0, 1, 2
# Scalars of the search, by position in ``Work.state``.
LEVEL, NODES, HITS, TRAIL = 0, 1, 2, 3
# An argument as numpy scalar: numba would compile a function anew for every literal.
NONE: Any = np.int64(-1)
ZERO: Any = np.int64(0)
ONE: Any = np.int64(1)

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Compile on first call, keep on disk, run without the interpreter lock."""
    return _compile(function)


def compiled_part(function: Function) -> Function:
    """The same for what compiled functions alone call: a wrapper for Python would take as long again to compile."""
    return _compile(function, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def _compile(function: Function, **wrappers: Any) -> Function:
    # Without references counted (nothing is made here): counting those of arrays handed on took a fifth of the time.
    options = {"cache": True, "nogil": True, "fastmath": True, "error_model": "numpy", "_nrt": False, **wrappers}
    return cast(Function, njit(**options)(function))


def whole_vectors(m: int) -> int:
    """m rounded up to whole vectors of the processor: loops of that length have no end that runs column by column.

    Rows are stored at such lengths; what lies beyond m is finite and counts for nothing.
    """
    return (m + 7) & -8


padded = compiled_part(whole_vectors)


def _extremum(instruction: str) -> Any:
    """The larger or smaller of two numbers: a comparison as numba compiles it keeps a loop from being vectorised."""

    @intrinsic  # type: ignore[untyped-decorator, unused-ignore]
    def extremum(_: Any, a: Any, b: Any) -> Any:
        def emit(context: Any, builder: Any, signature: Any, pair: Any) -> Any:
            kind = pair[0].type
            found = builder.module.declare_intrinsic(instruction, [kind], ir.FunctionType(kind, [kind, kind]))
            return builder.call(found, pair, fastmath=("fast",))

        return types.float64(types.float64, types.float64), emit

    return extremum


larger, smaller = _extremum("llvm.maxnum"), _extremum("llvm.minnum")


class Work(NamedTuple):
    """The state of one search, which stops and goes on at any node. A level is a number of included columns."""

    A: Any  # (levels, m, m): S, or the factor R
    B: Any  # (levels, m, m): H; of orthogonal steps scratch
    x: Any  # (levels, m): c, or z
    beta: Any  # (levels, m): coefficients with all undecided columns in
    ids: Any  # (levels, m): the undecided columns
    count: Any  # (levels,): how many they are
    phase: Any  # (levels,): where the level stands
    at: Any  # (levels,): place of the column branched on
    owns: Any  # (levels,): whether B is the level's own
    rss: Any  # (levels,): residual without the undecided columns
    bound: Any  # (levels,): residual with all of them
    most: Any  # (levels,): no larger subset below the level can get under its limit
    chosen: Any  # the included columns
    status: Any  # (columns,): what the path has decided, for the rules
    trail: Any  # the drops along the path, with their levels
    requires: Any  # (columns, columns) bytes, empty without rules; the diagonal counts what a column brings along
    excludes: Any  # (columns, columns) bytes, empty without rules
    hits: Any  # rows of (size, columns...)
    scratch: Any  # (5, m)
    packing: Any  # (5, m): see `bounds`
    factor: Any  # (m, m): see `bounds`
    sets: Any  # (4, m): see `bounds`
    place: Any  # 0, 1, 2, ...
    state: Any  # LEVEL, NODES, HITS, TRAIL
    base: int  # columns included before the search
    slack: float  # allowance for rounding in a determinant
    scored: int  # see SCORED in `compiled`
    prefixes: int  # see MOST_PREFIXES there


@compiled_part
def quota_of(rise: Any, m: int, bound: float, limits: Any, size: int, most: int) -> int:
    """Largest number t of further columns, to no more than ``most`` in all, that may still get under the limit.

    Such a subset leaves out at least one of the t + 1 columns of the largest rise, so no more than t
    columns may have a rise that breaks the limit.
    """
    t: int = min(most - size, m)
    while t > 0:
        allowance = limits[size + t] - bound
        if allowance >= 0.0:
            count = 0
            for i in range(m):
                count += 1 if rise[i] > allowance else 0
            if count <= t:
                return t
        t -= 1
    return 0


@compiled_part
def record(w: Work, size: int, a: Any, b: Any) -> None:
    """Note the chosen columns, with up to two more, as a subset to be looked at."""
    row = w.hits[w.state[HITS]]
    for i in range(size):
        row[i + 1] = w.chosen[i]
    if a >= 0:
        size += 1
        row[size] = a
    if b >= 0:
        size += 1
        row[size] = b
    row[0] = size
    if w.requires.size == 0 or _permitted(row, size, w.requires, w.excludes):
        w.state[HITS] += 1


@compiled_part
def _permitted(row: Any, size: int, requires: Any, excludes: Any) -> bool:
    for i in range(1, size + 1):
        v = row[i]
        present = 0
        for k in range(1, size + 1):
            if excludes[v, row[k]]:
                return False
            if k != i:
                present += requires[v, row[k]]
        if present < requires[v, v]:
            return False
    return True


@compiled_part
def singles_enough(d: Any, c: Any, m: int, needed: float) -> int:
    """How many columns gain what is needed; without ``Work``, which takes longer to hand over than to count."""
    enough = 0
    for i in range(padded(m)):
        enough += 1 if c[i] * c[i] >= needed * d[i] else 0
    return enough


@compiled_part
def record_singles(w: Work, d: Any, c: Any, ids: Any, m: int, size: int, needed: float, without: Any) -> None:
    """Record those columns, but one."""
    for i in range(m):
        if c[i] * c[i] >= needed * d[i] and i != without:
            record(w, size, ids[i], NONE)


@compiled_part
def score(w: Work, S: Any, d: Any, c: Any, ids: Any, m: int, size: int, pairs: Any, rss: float, limits: Any) -> None:
    """Record every column, and every pair, whose gain reaches what its size needs, without a division.

    S is the normal matrix (its lower triangle is read), d its diagonal, c its right-hand side. A pair gains enough
    where d_k (c_i^2 - D d_i) + c_k^2 d_i + v (D v - 2 c_i c_k) >= 0, with v its entry and D what is needed.
    """
    record_singles(w, d, c, ids, m, size, rss - limits[size + 1], NONE)
    if not pairs:
        return
    needed = rss - limits[size + 2]
    relaxed = needed - abs(needed) * w.slack
    for i in range(1, m):
        di, ci = d[i], c[i]
        a = ci * ci - relaxed * di
        b = 2.0 * ci
        row = S[i]
        # Counting vectorises better than taking the maximum; the row is gone over again only on a hit.
        enough = 0
        for k in range(i):
            v = row[k]
            enough += 1 if d[k] * a + c[k] * c[k] * di + v * (needed * v - b * c[k]) >= 0.0 else 0
        if enough > 0:
            for k in range(i):
                v = row[k]
                if d[k] * a + c[k] * c[k] * di + v * (needed * v - b * c[k]) >= 0.0:
                    record(w, size, ids[i], ids[k])


@compiled_part
def implied(w: Work, ids: Any, m: int) -> tuple[int, int]:
    """First undecided column that the rules force, as (position, INCLUDED or DROPPED); (-1, 0) for none."""
    for i in range(m):
        v = ids[i]
        for u in range(w.status.size):
            if u == v:
                continue
            state = w.status[u]
            if (w.requires[v, u] and state == DROPPED) or (w.excludes[v, u] and state == INCLUDED):
                return i, DROPPED
            if w.requires[u, v] and state == INCLUDED:
                return i, INCLUDED
    return -1, 0


@compiled_part
def mark_dropped(w: Work, label: int, level: int) -> None:
    """Note a drop made at a level, so that leaving the level undoes it."""
    w.status[label] = DROPPED
    w.trail[w.state[TRAIL], 0] = label
    w.trail[w.state[TRAIL], 1] = level
    w.state[TRAIL] += 1


@compiled_part
def leave(w: Work, level: int) -> None:
    """Undo the drops made at a level and the inclusion that led to it."""
    while w.state[TRAIL] > 0 and w.trail[w.state[TRAIL] - 1, 1] == level:
        w.state[TRAIL] -= 1
        w.status[w.trail[w.state[TRAIL], 0]] = UNDECIDED
    if level > 0:
        w.status[w.chosen[w.base + level - 1]] = UNDECIDED
    w.state[LEVEL] = level - 1
