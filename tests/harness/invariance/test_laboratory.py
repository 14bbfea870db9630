"""The command that checks every law on many flights."""

from __future__ import annotations

from hypothesis import strategies as st

from tests.harness.invariance.__main__ import check
from tests.harness.invariance.chain import PLANTS, Case
from tests.harness.invariance.laws import NOTHING, Found

FLIGHTS = 50


def test_no_flight_comes_twice_and_every_mechanism_comes():
    drawn: list[Case] = []

    def law(data: st.DataObject, case: Case) -> Found:
        drawn.append(case)
        data.draw(st.floats(-3.0, 3.0))
        return NOTHING, NOTHING

    (account,) = check({"law": law}, FLIGHTS, 1)
    assert len(drawn) == len(set(drawn)) == FLIGHTS
    assert {case.mechanism for case in drawn} == set(PLANTS[1:])
    assert account.broken == 0
