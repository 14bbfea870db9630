"""What a search returns: subsets, their certificate, what was set aside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from brv_hypo.arrays import FloatArray
from brv_hypo.subset.criteria import Criteria
from brv_hypo.subset.frame import Alias, Refusal
from brv_hypo.tabular import Row, Tabular


@dataclass(frozen=True)
class Subset:
    """One subset and its fit.

    ``columns``: chosen columns of X, ascending, without the forced ones. ``terms``: the forced columns,
    then the chosen ones; ``coefficients`` and ``std_errors`` (ordinary, from RSS / (n - p)) follow its order.
    """

    columns: tuple[int, ...]
    rss: float
    terms: tuple[int, ...]
    coefficients: FloatArray
    std_errors: FloatArray
    criteria: Criteria

    @property
    def size(self) -> int:
        """Number of chosen columns."""
        return len(self.columns)


@dataclass(frozen=True)
class Certificate:
    """What the search has proved.

    ``exact``: no allowed subset of a returned size beats the returned ones. ``gaps``: where the time limit
    struck, by how much, relatively, the RSS of size 1, 2, ... may still be too high (0.0 where that size is
    proved); ``gap`` is the largest. ``margin``: relative allowance for rounding with which branches were
    cut. ``nodes``: nodes visited. ``kernel``: ``numpy`` or ``numba``, ``schur`` or ``givens``. ``condition``:
    of the scaled candidates. ``status`` says in words how it ended.
    """

    exact: bool
    nodes: int
    margin: float
    gap: float
    gaps: tuple[float, ...]
    seconds: float
    kernel: str
    condition: float
    status: str


@dataclass(frozen=True)
class NearTies:
    """All subsets of one size within the window of the best, best first; ``complete``: no more of them."""

    size: int
    columns: tuple[tuple[int, ...], ...]
    rss: tuple[float, ...]
    complete: bool


@dataclass(frozen=True)
class PressBest:
    """The subset of least PRESS of one size, out of ``compared`` subsets.

    ``exact``: no other subset of the size has a lower one; else none is lower by more than ``gap``,
    relatively.
    """

    size: int
    columns: tuple[int, ...]
    press: float
    exact: bool
    gap: float
    compared: int


@dataclass(frozen=True)
class SubsetResult(Tabular):
    """Subsets by size, then by residual sum of squares.

    ``baseline`` is the forced model alone. ``aliases`` lists columns that equal a combination of others;
    multiples of one column, and of forced ones, are not searched unless a rule names them, and stand-ins of the
    same span can be read off here; of the columns of a longer combination no subset holds all. ``refused`` lists
    columns so near to dependence that no subset holds them together either, with the reason.
    ``near_ties`` and ``press`` are filled where they were asked for.
    """

    subsets: tuple[Subset, ...]
    certificate: Certificate
    aliases: tuple[Alias, ...]
    baseline: Subset
    near_ties: tuple[NearTies, ...] = ()
    press: tuple[PressBest, ...] = ()
    refused: tuple[Refusal, ...] = ()

    __repr__ = Tabular.__repr__
    __eq__ = Tabular.__eq__

    def headline(self) -> str:
        """How many subsets, and whether they are certainly the best."""
        proof = "exact" if self.certificate.exact else f"gap {self.certificate.gap:.3g}"
        return f"{len(self.subsets)} subsets, {proof}, {self.certificate.nodes} nodes"

    def rows(self) -> Sequence[Row]:
        """One row for each subset."""
        return [{"size": s.size, "columns": s.columns, "rss": s.rss} for s in self.subsets]

    def best(self, size: int) -> Subset:
        """The best subset of a size; KeyError where the search has none."""
        for subset in self.subsets:
            if subset.size == size:
                return subset
        sizes = sorted({s.size for s in self.subsets})
        raise KeyError(f"no subset of {size} columns: the search returned sizes {sizes}")

    def of_size(self, size: int) -> tuple[Subset, ...]:
        """All subsets returned of a size, best first."""
        return tuple(s for s in self.subsets if s.size == size)
