"""An aerodynamic table of the user's as baseline, and increments to it within its uncertainty."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from brv_hypo.errors import UnanswerableError, UsageError
from brv_hypo.mechanisms.conformance import sample_motion, uniform_time
from brv_hypo.model.aero_table import AeroTable, TableIncrements, TableSlope, read_aero_table
from brv_hypo.model.model import SavedModel
from brv_hypo.prediction import predict
from brv_hypo.simulation import load_config
from brv_hypo.tracing import Trace, trace
from tests.chains import ONE_EFFECT
from tests.flights import nominal

CSV = "mach,alpha_deg,slope,std_error\n5,0,-0.1,0.01\n5,10,-0.12,0.01\n9,0,-0.2,0.02\n9,10,-0.22,0.02\n"


def test_a_table_is_read(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text(CSV, encoding="utf-8")
    table = read_aero_table(path)
    assert table.mach == (5.0, 9.0)
    np.testing.assert_allclose(table.alpha, np.radians([0.0, 10.0]))
    assert table.slope == ((-0.1, -0.12), (-0.2, -0.22))
    assert table.std_error == ((0.01, 0.01), (0.02, 0.02))


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.csv", "mach,slope\n1,2\n", "has the columns"),
        ("a.csv", "mach,slope,std_error\n1,x,1\n", "line 2"),
        ("a.csv", "mach,slope,std_error\n1,-0.1,1\n1,-0.1,1\n", "twice"),
        ("a.csv", "mach,alpha,slope,std_error\n1,0,-0.1,1\n2,0.1,-0.1,1\n", "Fill in"),
        ("a.csv", "mach,slope,std_error\n1,-0.1,0\n", "no table is exact"),
        ("a.csv", "", "is not an aerodynamic table"),
        ("a.csv", "mach,slope,std_error\n1,-0.1,nan\n", "line 2"),
    ],
)
def test_says_what_is_wrong(tmp_path: Path, name: str, text: str, said: str) -> None:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match=said):
        read_aero_table(path)


@given(places=st.lists(st.floats(0.5, 20.0), min_size=2, max_size=6, unique=True), at=st.floats(0.0, 30.0))
def test_the_places_share_every_motion(places: list[float], at: float) -> None:
    table = AeroTable(mach=sorted(places), slope=[[-1.0]] * len(places), std_error=[[1.0]] * len(places))
    weights = table.weights(np.array([at]), np.array([0.1]))
    assert weights.sum() == pytest.approx(1.0)
    assert np.all(weights >= 0.0)


def test_equal_increments_at_all_places_are_a_constant_slope() -> None:
    motion = sample_motion(uniform_time(40))
    table = AeroTable(mach=(1.0, 30.0), slope=((-0.2,), (-0.2,)), std_error=((0.1,), (0.1,)))
    increments = TableIncrements(table=table).terms(motion, {})
    np.testing.assert_allclose(sum(term.in_plane for term in increments), motion.alpha)
    np.testing.assert_allclose(TableSlope(table=table).terms(motion, {})[0].in_plane, -0.2 * motion.alpha)


def test_a_table_without_errors_is_refused() -> None:
    with pytest.raises(ValidationError):
        AeroTable(mach=(1.0,), slope=((-0.1,),), std_error=((0.0,),))


def test_a_flight_without_mach_number_cannot_use_a_table() -> None:
    from dataclasses import replace

    flight = replace(nominal().flight, mach=None)
    table = AeroTable(mach=(1.0,), slope=((-0.1,),), std_error=((0.1,),))
    with pytest.raises(UnanswerableError, match="Mach"):
        trace(flight, ONE_EFFECT.model_copy(update={"aero": table}))


@pytest.fixture(scope="module")
def result() -> Trace:
    """A flight of constant slope, traced from a table that is 3 % too steep at one end and too shallow at the other."""
    flight = nominal().flight
    assert flight.mach is not None
    slope = load_config("research_cone").aerodynamics.C_malpha
    ends = (float(flight.mach.min()), float(flight.mach.max()))
    table = AeroTable(mach=ends, slope=((1.03 * slope,), (0.97 * slope,)), std_error=((0.05 * abs(slope),),) * 2)
    return trace(flight, ONE_EFFECT.model_copy(update={"aero": table}))


@pytest.mark.thorough
def test_the_table_is_corrected_and_nothing_is_missed(result: Trace) -> None:
    assert result.added == ()
    assert result.steps[0].error_before.held_out < 1.2 * result.noise
    increments = {term.name: term for term in result.model.terms if term.mechanism == "aero_increment"}
    low, high = increments.values()
    assert high.value - low.value < 0.0  # the slope is negative: too shallow at the upper end
    assert all(term.std_error > 0.0 for term in increments.values())
    assert "C_malpha" not in {term.name for term in result.model.terms}


@pytest.mark.thorough
def test_the_increments_are_part_of_the_model(result: Trace) -> None:
    saved = SavedModel.model_validate_json(result.model.definition.model_dump_json())
    assert saved.table is not None
    predicted = predict(nominal().flight, saved)
    assert predicted.error.frozen < 1.2 * predicted.error.noise
    again = trace(nominal().flight, ONE_EFFECT.model_copy(update={"start": saved}))
    assert again.steps[0].error_before.held_out < 1.2 * again.noise
