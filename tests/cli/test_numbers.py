"""How numbers are written in tables."""

from __future__ import annotations

import pytest

from brv_hypo.io.text import interval, known_to, number, probability, share


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.60123, 3, "0.601"),
        (12345.6, 3, "12300"),
        (999400.0, 3, "999000"),
        (1.5e7, 3, "1.50×10⁷"),
        (0.001, 3, "0.001"),
        (2.6e-4, 2, "0.00026"),
        (999600.0, 3, "1000000"),
        (-9.098e-5, 4, "-9.098×10⁻⁵"),
        (0.0, 3, "0"),
        (None, 3, "–"),
        (float("nan"), 3, "–"),
        (float("inf"), 3, "–"),
    ],
)
def test_numbers_have_an_exponent_only_where_they_need_one(value, digits, text):
    assert number(value, digits) == text


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [
        (0.5999712, 7.7e-5, "0.599971"),
        (3.99986412, 3.1e-5, "3.999864"),
        (0.60123, 0.1, "0.60"),
        (-9.09812345e-5, 3e-10, "-9.098123×10⁻⁵"),
        (1.25, 1e-15, "1.25000000"),
        (0.004, 2.3, "0"),
        (-0.1069, 0.88, "-0.11"),
        (0.0, 0.1, "0"),
        (2.0, float("nan"), "2"),
    ],
)
def test_an_estimate_is_rounded_to_its_error(value, sigma, text):
    assert known_to(value, sigma) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(1.0, ">99 %"), (0.997, ">99 %"), (0.9, "90 %"), (0.005, "<1 %"), (0.001, "<1 %"), (0.0, "<1 %"), (None, "–")],
)
def test_a_probability_is_never_certain(value, text):
    assert probability(value) == text


@pytest.mark.parametrize(("value", "text"), [(0.0071, "0.71 %"), (1.2, "120 %"), (1e-9, "<0.01 %"), (None, "–")])
def test_a_share_has_two_digits(value, text):
    assert share(value) == text


def test_a_region_is_written_from_to():
    assert interval((2.0, 4.125)) == "2.00–4.12"
    assert interval(None) == "–"
