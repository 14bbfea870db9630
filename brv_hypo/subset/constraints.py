"""Which subsets are allowed: groups of columns and parents of columns."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from brv_hypo.arrays import BoolArray, IntArray
from brv_hypo.errors import UsageError


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


Groups = Sequence[Group | Sequence[int]]
Parents = Mapping[int, int | Sequence[int]]


@dataclass(frozen=True)
class Constraints:
    """The rules over m candidates, closed under implication.

    ``requires[j]``: the candidates that j brings along (j itself not among them).
    ``excludes[j]``: the candidates that cannot stand beside j and what it brings.
    ``possible[j]``: whether any allowed subset holds j.
    """

    requires: BoolArray
    excludes: BoolArray
    possible: BoolArray

    @cached_property
    def active(self) -> bool:
        """Whether there is any rule at all."""
        return bool(self.requires.any() or self.excludes.any() or not self.possible.all())

    def allows(self, subset: IntArray | Sequence[int]) -> bool:
        """Whether the subset (positions among the candidates) obeys every rule."""
        members = np.zeros(self.possible.size, dtype=np.bool_)
        members[list(subset)] = True
        if not self.possible[members].all():
            return False
        return not (self.requires[members] & ~members).any() and not (self.excludes[members] & members).any()


def constrained_columns(groups: Groups | None, parents: Parents | None) -> set[int]:
    """Every column that a rule names."""
    named = {column for group in _normalised(groups) for column in group.columns}
    for child, own in (parents or {}).items():
        named |= {child, *_as_tuple(own)}
    return named


def build_constraints(
    candidates: Sequence[int],
    forced: Collection[int],
    n_columns: int,
    groups: Groups | None,
    parents: Parents | None,
) -> Constraints:
    """Translate rules on columns of X into rules on candidates.

    A column that is neither candidate nor forced (it lies in the forced span, so it adds nothing) holds
    nobody back: as a parent it counts as present, in a group it is passed over.
    """
    position = {column: i for i, column in enumerate(candidates)}
    _check_range(constrained_columns(groups, parents), n_columns)
    m = len(candidates)
    requires = np.zeros((m, m), dtype=np.bool_)
    excludes = np.zeros((m, m), dtype=np.bool_)
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
    return _closed(requires, excludes, possible)


def _closed(requires: BoolArray, excludes: BoolArray, possible: BoolArray) -> Constraints:
    m = possible.size
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


def _normalised(groups: Groups | None) -> list[Group]:
    return [g if isinstance(g, Group) else together(*g) for g in groups or ()]


def _as_tuple(value: int | Sequence[int]) -> tuple[int, ...]:
    return (value,) if isinstance(value, int) else tuple(value)


def _check_range(columns: set[int], n_columns: int) -> None:
    outside = sorted(c for c in columns if not 0 <= c < n_columns)
    if outside:
        raise UsageError(
            f"groups or parents name columns {outside}, but X has columns 0..{n_columns - 1}; "
            "number the columns as they stand in X, forced ones included"
        )
