"""The report's own findings come back: Tables 4.1 and 4.2, 5.5 and 5.7."""

from __future__ import annotations

import numpy as np
import pytest

from brv_hypo.arrays import FloatArray
from brv_hypo.comparison import CompareConfig, Comparison, compare
from brv_hypo.comparison.result import RankedHypothesis
from brv_hypo.simulation import simulate
from tests.studies.subset.stepwise import stepwise_columns

# Table 4.1: the 27 terms beside the constant, as powers of (alpha, Re, Mach).
TERMS = {
    "alpha": (1, 0, 0), "Re": (0, 1, 0), "mu": (0, 0, 1), "alpha^2": (2, 0, 0), "alpha^3": (3, 0, 0),
    "alpha^4": (4, 0, 0), "Re^2": (0, 2, 0), "Re^3": (0, 3, 0), "alpha mu^3": (1, 0, 3), "alpha Re": (1, 1, 0),
    "mu^2": (0, 0, 2), "mu^3": (0, 0, 3), "alpha mu": (1, 0, 1), "Re mu": (0, 1, 1), "alpha^2 Re": (2, 1, 0),
    "alpha^2 mu": (2, 0, 1), "alpha mu^2": (1, 0, 2), "Re mu^2": (0, 1, 2), "alpha Re^2": (1, 2, 0),
    "mu Re^2": (0, 2, 1), "alpha^3 Re": (3, 1, 0), "alpha^3 mu": (3, 0, 1), "alpha^4 Re": (4, 1, 0),
    "alpha^2 Re^2": (2, 2, 0), "alpha^2 mu^2": (2, 0, 2), "Re^2 mu^2": (0, 2, 2), "alpha Re mu": (1, 1, 1),
}  # fmt: skip
# Table 4.1, column C_N; Table 4.2, order of entry.
CONSTANT = -0.00101
COEFFICIENTS = {
    "alpha": -0.0695, "Re": 0.000225, "Re^2": -0.0000108, "alpha Re": 0.0125, "alpha Re^2": -0.00685,
    "Re^2 mu^2": -0.0976,
}  # fmt: skip
ORDER_OF_ENTRY = ["alpha", "Re", "Re^2", "alpha Re", "Re^2 mu^2", "alpha Re^2"]


def histories() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Deviations of alpha, Re and Mach from the means of Table 4.1 over 319.33 to 322.32 s.

    alpha oscillates at the cone's frequency, Re grows as on an exponential atmosphere, Mach falls slowly.
    """
    time = np.arange(0.0, 2.99, 0.005)
    alpha = 1.0 + 0.18 * np.cos(6.5 * time + 4.7)
    reynolds = np.exp(0.28 * time)
    mach = 1.0 - 0.034 * (time / 3.0) ** 2
    return (alpha * 0.0143 / alpha.mean() - 0.0143, reynolds * 1.939 / reynolds.mean() - 1.939, mach - mach.mean())


def test_table_4_2_order_of_entry() -> None:
    alpha, reynolds, mach = histories()
    columns = [alpha**i * reynolds**j * mach**k for i, j, k in TERMS.values()]
    names = list(TERMS)
    moment = CONSTANT + sum(value * columns[names.index(name)] for name, value in COEFFICIENTS.items())
    design = np.column_stack([np.ones_like(alpha), *columns])
    steps = [set(columns) for _, columns in stepwise_columns(design, moment, max_terms=6, samples=alpha.size)]
    entered = [names[(new - old).pop() - 1] for old, new in zip([set(), *steps], steps, strict=False)]
    assert entered == ORDER_OF_ENTRY


def by_name(comparison: Comparison, name: str) -> RankedHypothesis:
    return next(row for row in comparison.ranking if row.mechanism == name)


@pytest.mark.slow
def test_tables_5_5_and_5_7() -> None:
    """Jump of 2.71e-4 in C_m0 at 320.8 s, 0.6 of the flow sticking for 0.2 s from 320.75 to 322.5 s."""
    flight = simulate("report_table_5", seed=20_261_121).flight
    comparison = compare([flight], CompareConfig(mechanisms=("sticking", "inplane", "sticking+inplane")))
    assert comparison.verdict.winner == "sticking+inplane"
    found = by_name(comparison, "sticking+inplane")

    eps = [term for term in found.terms if term.mechanism == "sticking"]
    (delay,) = [d for d in found.derived if d.name == "sticking delay"]
    assert abs(delay.value - 0.2) < max(2.0 * delay.std_error, 0.002)
    assert [np.sign(term.value) for term in eps] == [1.0, -1.0]
    for term, knot in zip(eps, (320.75, 322.5), strict=True):
        assert term.region_s is not None
        assert abs(term.region_s[0] - knot) < 0.02
        assert abs(abs(term.value) - 0.6) < 2.0 * term.std_error

    jumps = [term for term in found.terms if term.mechanism == "inplane" and term.name == "jump in C_m0"]
    first = min(jumps, key=lambda term: abs((term.region_s or (0.0, 0.0))[0] - 320.8))
    assert first.region_s is not None
    assert abs(first.region_s[0] - 320.8) < 0.03
    assert 2.0e-4 < first.value < 3.2e-4
