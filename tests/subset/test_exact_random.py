"""A thousand random problems against complete enumeration: every kernel, degeneracy and rule."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from brv_hypo.subset import Group, SubsetResult
from tests.subset.brute_force import Row, enumerate_subsets, representatives
from tests.subset.kernels import best_subsets_by

pytestmark = pytest.mark.thorough

KERNELS = ("numpy", "numba-schur")
BATCHES, PER_BATCH = 40, 25
QUICK_BATCHES, THOROUGH_BATCHES = 4, 8
"""Batches of every run; each batch has every kernel, with and without rules."""


@dataclass
class Problem:
    X: NDArray[np.float64]
    y: NDArray[np.float64]
    forced: tuple[int, ...]
    max_terms: int
    n_best: int
    groups: list[Group] = field(default_factory=list)
    parents: dict[int, tuple[int, ...]] = field(default_factory=dict)

    @property
    def named(self) -> set[int]:
        columns = {c for g in self.groups for c in g.columns} | set(self.parents)
        return columns | {c for own in self.parents.values() for c in own}

    def allowed(self, subset: frozenset[int], candidates: set[int]) -> bool:
        """The rules; a column inside the forced span adds nothing and excludes no other."""
        for group in self.groups:
            members = set(group.columns) & candidates
            inside = len(subset & members)
            if group.rule == "together" and inside not in (0, len(members)):
                return False
            if group.rule == "at_most_one" and inside > 1:
                return False
        return all(set(own) & candidates <= subset for child, own in self.parents.items() if child in subset)


def random_problem(rng: np.random.Generator) -> Problem:
    """p <= 14 with duplicates, dependencies, constant and zero columns, sometimes fewer rows than columns."""
    p = int(min(14, 3 + rng.geometric(0.17)))
    n = int(rng.integers(4, p + 2) if rng.random() < 0.1 else rng.integers(p + 2, 3 * p + 12))
    X = rng.standard_normal((n, p)) + rng.choice([0.0, 0.0, 0.8, 3.0]) * rng.standard_normal((n, 1))
    X *= 10.0 ** rng.integers(-3, 4, size=p)
    X[:, 0] = 1.0
    spare = list(rng.permutation(np.arange(1, p)))
    if p > 4 and rng.random() < 0.3:
        X[:, spare.pop()] = rng.choice([-2.0, 0.5, 1.0]) * X[:, spare[0]] + rng.choice([0.0, 3.0])
    if p > 5 and rng.random() < 0.3:
        X[:, spare.pop()] = X[:, spare[0]] / np.linalg.norm(X[:, spare[0]]) - X[:, spare[1]] * 1e-2
    if p > 6 and rng.random() < 0.2:
        X[:, spare.pop()] = rng.choice([0.0, 7.0])
    forced = ((0,), (0,), (0,), (), (0, int(spare[0])))[rng.integers(5)]
    y = X[:, rng.integers(1, p, size=3)] @ rng.standard_normal(3) * rng.choice([0.0, 0.3, 1.0])
    y = y / max(float(np.linalg.norm(y)), 1e-9) + 0.3 * rng.standard_normal(n) * rng.choice([0.1, 1.0])
    return Problem(X, y, forced, int(rng.integers(1, p)), int(rng.integers(1, 5)))


def with_rules(problem: Problem, rng: np.random.Generator) -> Problem:
    """Random groups and parents over the free columns."""
    free = [j for j in range(problem.X.shape[1]) if j not in problem.forced]
    order = [int(j) for j in rng.permutation(free)]
    if len(order) >= 4 and rng.random() < 0.6:
        rule = "together" if rng.random() < 0.5 else "at_most_one"
        problem.groups.append(Group(tuple(order[: int(rng.integers(2, 4))]), rule))
    if len(order) >= 6 and rng.random() < 0.4:
        problem.groups.append(Group(tuple(order[3 : int(rng.integers(5, 7))]), "at_most_one"))
    for child in rng.permutation(order)[: int(rng.integers(0, 4)) if len(order) > 2 else 0]:
        own = rng.choice([j for j in order if j != child], size=int(rng.integers(1, 3)), replace=False)
        problem.parents[int(child)] = tuple(int(j) for j in own)
    return problem


def solve(problem: Problem, kernel: str) -> SubsetResult:
    p = problem
    return best_subsets_by(kernel, p.X, p.y, p.max_terms, p.forced, p.n_best, p.groups, p.parents)


def check(problem: Problem, result: SubsetResult) -> None:
    candidates = representatives(problem.X, problem.forced, problem.named)
    table = enumerate_subsets(
        problem.X, problem.y, problem.forced, candidates, problem.max_terms,
        lambda subset: problem.allowed(subset, set(candidates)),
    )  # fmt: skip
    scale = float(problem.y @ problem.y)
    assert result.certificate.exact
    assert result.certificate.gap == 0.0
    for size, rows in table.items():
        _check_size(rows, problem.n_best, result, size, scale)


def _check_size(rows: list[Row], n_best: int, result: SubsetResult, size: int, scale: float) -> None:
    expected = [rss for rss, _ in rows[:n_best]]
    found = [subset for subset in result.subsets if subset.size == size]
    assert len(found) == len(expected)
    np.testing.assert_allclose([s.rss for s in found], expected, rtol=1e-7, atol=1e-13 * scale)
    by_columns = {columns: rss for rss, columns in rows}
    for subset in found:
        assert subset.rss == pytest.approx(by_columns[subset.columns], rel=1e-7, abs=1e-13 * scale)
    assert len({s.columns for s in found}) == len(found)


@pytest.mark.parametrize(
    "batch",
    [
        *range(QUICK_BATCHES),
        *(pytest.param(batch, marks=pytest.mark.thorough) for batch in range(QUICK_BATCHES, THOROUGH_BATCHES)),
        *(pytest.param(batch, marks=pytest.mark.slow) for batch in range(THOROUGH_BATCHES, BATCHES)),
    ],
)
def test_agrees_with_complete_enumeration(batch: int) -> None:
    rng = np.random.default_rng(1000 + batch)
    for i in range(PER_BATCH):
        problem = random_problem(rng)
        if i % 2:
            problem = with_rules(problem, rng)
        check(problem, solve(problem, KERNELS[(batch + i // 2) % 2]))


@pytest.mark.parametrize("kernel", KERNELS)
def test_ties_go_to_the_lower_columns(kernel: str) -> None:
    """Any two of a, b, a + b span the same plane: the answer must be the lexicographically first pair."""
    rng = np.random.default_rng(7)
    a, b, other = rng.standard_normal((3, 40))
    X = np.column_stack([np.ones(40), other, a + b, a, b])
    y = 2.0 * a - b + 0.1 * rng.standard_normal(40)
    assert best_subsets_by(kernel, X, y, 2).best(2).columns == (2, 3)
