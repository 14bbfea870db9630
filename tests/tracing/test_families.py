"""Which family of processes explains a residual, and whether an effect is needed beside all of them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from brv_hypo.mechanisms import find
from brv_hypo.mechanisms.contract import FAMILIES, RecordEffect
from brv_hypo.mechanisms.registry import find_installed, moment_processes, record_processes
from brv_hypo.model.model import Applied
from brv_hypo.thresholds import FAMILY_SIGNIFICANT
from brv_hypo.tracing import Trace, TraceConfig, trace
from brv_hypo.tracing.baseline import start_model
from brv_hypo.tracing.families import (
    FAMILY_RECORD_SPLINES,
    FAMILY_SPLINES,
    Beside,
    _family_of,
    _finer,
    beside_processes,
)
from brv_hypo.tracing.fit import Flights, converged, correct, fitted_about
from tests.chains import judged_cone
from tests.flights import nominal
from tests.studies.independent.flights import Made, make_flight

CONFIG = TraceConfig(max_steps=2, effects=("lag", "magnus", "damping", "trim", "gyro_bias"))
# Kinds of imperfections at several times an ordinary size, none of which is an effect of the list, and their families.
UNDECLARED = {
    "damping_alpha": ("biconic", "rate"),
    "three_lobes": ("biconic", "harmonic"),
    "cg_drift": ("biconic", "body"),
    "turbulence": ("capsule", "air"),
}


@cache
def flight(kind: str) -> Made:
    """A flight of the independent simulator with one undeclared effect."""
    return make_flight(UNDECLARED[kind][0], "none", seed=880_000, imperfect=(kind,), imperfect_size=4.0)


@cache
def traced(kind: str) -> Trace:
    """It, traced with few effects."""
    return trace(flight(kind).flight, CONFIG)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "kind", [each if each == "damping_alpha" else pytest.param(each, marks=pytest.mark.slow) for each in UNDECLARED]
)
def test_an_undeclared_effect_is_of_its_family_and_no_finding(kind: str) -> None:
    result = traced(kind)
    assert max(result.families, key=result.families.__getitem__) == UNDECLARED[kind][1]
    assert result.findings == ()


def test_families_are_compared_at_one_resolution() -> None:
    """Else a lobed moment within a part of the flight is a body-fixed one, whose history is finer; so is a drift."""
    every = [(own, FAMILY_SPLINES) for own in zip(moment_processes(), _finer(moment_processes()), strict=True)]
    every += [(own, FAMILY_RECORD_SPLINES) for own in zip(record_processes(), _finer(record_processes()), strict=True)]
    for (each, finer), fewest in every:
        assert finer.family == each.family
        assert finer.splines == max(each.splines, fewest)
        assert isinstance(finer, type(each))


@pytest.mark.slow
def test_a_drift_has_histories_of_its_own_where_families_are_compared() -> None:
    """Kept by its name alone, the first of the finer ones were those of the coarser."""
    coarse, fine = beside_nothing(), beside_nothing()._with_finer
    numbers = [[group.name for group in each.rows.groups].index("gyro_drift") for each in (coarse, fine)]
    blocks = [(each.rows.blocks[0], k) for each, k in zip((coarse, fine), numbers, strict=True)]
    drifts = [block.raw[:, block.columns[k]] for block, k in blocks]
    assert [each.shape[1] for each in drifts] == [3 * 8, 3 * FAMILY_RECORD_SPLINES]
    sums = [each[:, : each.shape[1] // 3].sum(axis=1) for each in drifts]  # of all splines: a constant bias
    np.testing.assert_allclose(sums[0], sums[1], atol=1e-3 * np.max(np.abs(sums[0])))


@pytest.mark.parametrize("stated", [None, "body", "rate"])
def test_an_effect_is_of_the_family_of_its_shape_whatever_it_does_in_time(
    stated: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that ends is small, not nothing, after its end; a family that is stated is its own."""
    monkeypatch.setattr(type(find("bodyfixed")), "stated_family", stated)
    beside = judged_cone("bodyfixed")
    fit = beside.leading.fit
    assert len({column.time_basis for column in fit.selected}) > 1
    assert _family_of(fit, beside.problem.frame.motions, "bodyfixed") == (stated or "body")


@pytest.mark.parametrize(("gains", "named"), [((2.9, 1.0), []), ((9.0, 3.5), ["air", "body"]), ((9.0, 2.9), ["air"])])
def test_a_family_explains_some_only_where_the_evidence_gains(gains: tuple[float, float], named: list[str]) -> None:
    """The first is compared with none at all, as the next ones against those before."""
    each = dict(zip(("air", "body"), gains, strict=True))
    groups = [SimpleNamespace(family=family) for family in each]

    def evidence(_: Any, families: Sequence[str]) -> Any:
        return SimpleNamespace(level=-500.0 + sum(each[family] for family in families))

    beside: Any = SimpleNamespace(rows=SimpleNamespace(groups=groups), evidence=evidence)
    assert [family for family, _ in Beside._selected(beside, [])] == named


@pytest.mark.slow
def test_shares_are_of_one_whole_and_within_their_intervals() -> None:
    step = traced("damping_alpha").steps[0]
    assert set(step.families) == set(FAMILIES)
    assert 0.0 <= sum(step.families.values()) <= 1.0
    for each in step.decomposition:
        assert each.interval_95[0] <= each.share <= each.interval_95[1]
        assert step.families[each.family] == each.share
        assert each.evidence > FAMILY_SIGNIFICANT


@pytest.mark.slow
def test_the_account_goes_from_constant_coefficients_to_the_last_model() -> None:
    account = traced("damping_alpha").account
    assert [each.model for each in account][:2] == ["constant", "scheduled"]
    assert all(each.held_out > 0.0 and each.std_error > 0.0 for each in account)


@cache
def beside_nothing() -> Beside:
    """The baseline of a flight beside all processes, with nothing added."""
    made = flight("damping_alpha")
    source = Flights((made.flight,), CONFIG)
    state = converged(source, start_model(source))
    return beside_processes(state, state.model)


@pytest.mark.slow
def test_with_nothing_added_there_is_nothing_unwanted() -> None:
    beside = beside_nothing()
    assert beside.terms == {}
    assert beside.unwanted([]) == ()
    assert np.isfinite(beside.evidence([]).level)


@pytest.mark.thorough
def test_shares_are_of_what_baseline_and_tolerances_do_not_explain() -> None:
    """A bend of the static moment, which is within its tolerance, explains nothing for a family of processes."""
    beside = beside_nothing()
    assert beside.rows.shared.shape[1] > beside.rows.coefficients.shape[1]
    first = beside.shares([])[0]
    finer = beside._with_finer
    squares = [float(np.sum(finer.evidence([], own).residual ** 2)) for own in ((), (first.family,))]
    assert first.share == pytest.approx(1.0 - squares[1] / squares[0], abs=1e-6)


@pytest.mark.thorough
def test_an_applied_correction_is_weighed_on_the_record_as_it_reads() -> None:
    """A step of the wind subtracted from a record that has none; of its value a share was put back.

    It is paid for as one of all steps that were searched, not of those about the time that was found.
    """
    source = Flights((nominal().flight,), CONFIG)
    model, installed = start_model(source), find_installed("wind_step")
    assert isinstance(installed, RecordEffect)
    searched = installed.variants(source.records[0])
    effect = searched[4]
    component, units, size = effect.components(source.records[0])[0]
    assert size != 1.0
    step = Applied(effect=effect, component=component, units=units, size=size, value=4.0 * size)
    known, without = fitted_about(correct(source, model), model), model.but(applied=(step,))
    fit = fitted_about(correct(source, without), without, known.values, known.noise)
    beside = beside_processes(fit, model)
    own = beside.evidence(["wind_step"])
    tried = sum(len(each.components(source.records[0])) for each in searched)
    assert beside.terms["wind_step"].prior == pytest.approx(-np.log(tried))
    assert own.covariance[-1, -1] < (0.5 * size) ** 2
    assert abs(own.values[-1]) < size
