"""A mechanism under other names and units of its parameters: flown, compared, reported, saved and restored.

That fits agree for any names and units: tests/linearisation/test_parameters.py.
"""

from __future__ import annotations

import importlib
import io
from functools import cache
from typing import Any

import numpy as np
import pytest
import yaml
from rich.console import Console

from brv_hypo.comparison import CompareConfig, Comparison, compare
from brv_hypo.comparison.result import RankedHypothesis
from brv_hypo.inference.fit import fit_hypothesis
from brv_hypo.mechanisms import Mechanism, find
from brv_hypo.model.model import Model, SavedModel, model_text, restored
from brv_hypo.report.comparison import comparison_document
from brv_hypo.report.terminal import terminal_view
from brv_hypo.simulation import load_config, simulate
from tests.chains import prepared
from tests.flights import flown, nominal
from tests.renamed import Alias, renamed

LATE = Alias("τ [of the wake]", "ms", 1e-3)
NAMED = Alias("x", "s")
# What the last digit of a record's channels moves the numbers of a comparison by, relatively: histories of its errors
# are differences, and another unit is another last digit.
LAST_DIGIT = 1e-6
# What standard errors of the evidence differ by, relatively: its maximisation ends within a thousandth of a nat, and
# amplitudes of processes with it.
AMPLITUDES = 1e-2
DELAYED = ("sticking", "lag")


def late(name: str, alias: Alias = LATE) -> Mechanism:
    return renamed(find(name), {"delay": alias})


def known_as_late(patch: pytest.MonkeyPatch, place: str) -> None:
    """`find` of a module gives delayed mechanisms under the other name."""
    patch.setattr(f"{place}.find", lambda name, options=None: late(name) if name in DELAYED else find(name, options))


@pytest.mark.parametrize("name", DELAYED)
def test_its_flight_is_the_same(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    cone = load_config("research_cone", plant=(name,)).model_dump(exclude={"plantable"})
    cone |= {"duration": 0.5, "sample_rate": 100.0, "step": 0.01}
    (entry,) = cone["mechanisms"]
    flights = []
    for theta in ({"delay": 0.12}, {LATE.name: 120.0}):
        if LATE.name in theta:
            known_as_late(monkeypatch, "brv_hypo.simulation.vehicle")
        planted = entry | {"theta": theta, "start": 0.2, "stop": 0.4}
        flights.append(simulate(load_config({**cone, "mechanisms": [planted]}), seed=1))
    one, other = (flight.record.channels for flight in flights)
    for channel, values in one.items():
        np.testing.assert_allclose(other[channel], values, rtol=1e-12, atol=1e-12)
    assert flights[1].truth.parameters[f"mechanisms.0.theta.{LATE.name}"] == 120.0


def test_it_is_saved_and_restored(monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism, flights = late("lag"), (nominal().flight,)
    columns = fit_hypothesis(prepared("bodyfixed", knot_count=3), "lag", (mechanism,)).selected
    model = Model(mechanisms={"lag": mechanism}, columns=columns).saved()
    known_as_late(monkeypatch, "brv_hypo.model.model")
    for text, read in ((model.model_dump_json(), SavedModel.model_validate_json), (model_text(model), _of_yaml)):
        again = restored(read(text), flights)
        assert again.columns == columns
        assert [column.delays for column in again.columns] == [column.delays for column in columns]


def _of_yaml(text: str) -> SavedModel:
    return SavedModel.model_validate(yaml.safe_load(text))


@cache
def compared(alias: Alias | None) -> Comparison:
    """A flight on which flow sticks, with likelihood."""
    module = importlib.import_module("brv_hypo.comparison.compare")
    own = module.parse_hypothesis

    def parse(*arguments: Any) -> tuple[Mechanism, ...]:
        return tuple(
            each if alias is None or each.name not in DELAYED else late(each.name, alias) for each in own(*arguments)
        )

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "parse_hypothesis", parse)
        return compare([flown("research_cone", "sticking").flight], CompareConfig(mechanisms=("sticking",)))


def _numbers(row: RankedHypothesis) -> dict[str, float]:
    numbers = ("cp", "bic", "f_ratio", "log_likelihood", "r2", "n_effective")
    delays = {f"delay {k}": term.delay_s for k, term in enumerate(row.terms) if term.delay_s is not None}
    return {name: getattr(row, name) for name in numbers if getattr(row, name) is not None} | delays


@pytest.mark.slow
@pytest.mark.parametrize(("alias", "apart"), [pytest.param(NAMED, 0.0, marks=pytest.mark.slow), (LATE, LAST_DIGIT)])
def test_a_comparison_gives_the_same_numbers(alias: Alias, apart: float) -> None:
    one, other = compared(None), compared(alias)
    assert [row.mechanism for row in other.ranking] == [row.mechanism for row in one.ranking]
    for before, after in zip(one.ranking, other.ranking, strict=True):
        assert _numbers(after) == pytest.approx(_numbers(before), rel=apart, abs=0.0)
        # The evidence is at its top, its amplitudes wherever the maximisation ended.
        assert after.prediction_error == pytest.approx(before.prediction_error, rel=apart and AMPLITUDES, abs=0.0)
    assert other.verdict.probability == pytest.approx(one.verdict.probability, rel=apart, abs=0.0)
    assert other.verdict.winner == one.verdict.winner == "sticking"


@pytest.mark.slow
def test_its_likelihood_is_the_same_and_its_delay_is_in_its_own_unit() -> None:
    one, other = (compared(alias).ranking[0] for alias in (None, LATE))
    assert one.ml is not None
    assert other.ml is not None
    assert one.ml.status == other.ml.status == "converged"
    assert other.ml.log_likelihood == pytest.approx(one.ml.log_likelihood, rel=LAST_DIGIT)
    for found, same, apart in ((one.derived, other.derived, AMPLITUDES), (one.ml.derived, other.ml.derived, 1e-3)):
        before = next(item for item in found if item.name == "sticking delay")
        after = next(item for item in same if item.name == f"sticking {LATE.name}")
        assert (before.units, after.units) == ("s", "ms")
        assert after.value * LATE.scale == pytest.approx(before.value, rel=1e-6)
        assert after.std_error * LATE.scale == pytest.approx(before.std_error, rel=apart)


@pytest.mark.thorough
def test_it_is_printed_with_its_unit() -> None:
    console = Console(width=200, file=io.StringIO(), markup=False)
    console.print(terminal_view(comparison_document(compared(LATE)), verbose=True))
    estimates = [each for line in console.file.getvalue().splitlines() for each in line.split(";")]
    own = [each for each in estimates if f"sticking {LATE.name} = " in each]
    assert own
    assert all(each.split()[-1] == "ms" for each in own)
