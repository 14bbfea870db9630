"""What a record says of planted effects once its motion has to be found too."""

from __future__ import annotations

import pytest

from tests.studies.independent.flights import Made, make_flight
from tests.studies.independent.oracle import judge
from tests.studies.independent.record_oracle import f_ratios_in_record

REGION = (2.0, 4.0)


def flight_with(amplitude: float) -> Made:
    return make_flight("cone", "bodyfixed", amplitude, 7, region=REGION)


@pytest.mark.slow
def test_it_grows_as_the_square_of_the_size_and_is_less_than_with_known_motion() -> None:
    little, more = flight_with(0.02), flight_with(0.04)
    (first,), (second,) = f_ratios_in_record(little), f_ratios_in_record(more)
    assert second == pytest.approx(4.0 * first, rel=0.2)
    assert 0.0 < first < judge(little, ()).f_ratio


@pytest.mark.thorough
def test_each_of_two_effects_is_counted_beside_the_other() -> None:
    first = flight_with(0.04)
    second = make_flight("cone", "damping", 0.04, 8, region=REGION, start=first.true.start).true.planted
    both = make_flight("cone", "bodyfixed", 0.04, 7, region=REGION, beside=second)
    found = f_ratios_in_record(both)
    assert len(found) == 2
    assert found[0] <= 1.05 * f_ratios_in_record(first)[0]
