"""What plugin authors test with: planted and recovered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from brv_hypo import testing
from brv_hypo.errors import UsageError
from brv_hypo.mechanisms import Parameter, find
from brv_hypo.testing import Nonconformity, check_mechanism, plant, plant_effect, recover


@pytest.mark.thorough
def test_a_planted_mechanism_is_recovered() -> None:
    flown = plant("sticking", {"eps": 0.6}, {"delay": 0.12}, start=1.0, stop=3.0)
    assert flown.truth.planted == ("sticking",)
    assert recover(flown, "sticking").verdict.winner == "sticking"


@pytest.mark.thorough
def test_a_planted_effect_is_in_the_record() -> None:
    known, more = (plant_effect("gyro_bias", "q", value) for value in (0.0, 0.01))
    np.testing.assert_allclose(more.q - known.q, 0.01)
    np.testing.assert_array_equal(more.r, known.r)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("gyro_bias", "up", 0.1), "has no component .up. .is .p. meant"),
        (("magnus", "C_npalpha", 0.1), "no error of the record but a mechanism"),
        (("gyro_bais", "q", 0.1), "gyro_bias"),
    ],
)
def test_what_cannot_be_planted_is_refused(arguments, message, monkeypatch) -> None:
    monkeypatch.setattr(testing, "DURATION", 0.5)
    with pytest.raises(UsageError, match=message):
        plant_effect(*arguments)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["sticking", "bodyfixed"])
def test_a_mechanism_that_keeps_its_contract_passes_every_check(name: str) -> None:
    check_mechanism(find(name))


class Forgetful(find("sticking").__class__):  # type: ignore[misc]
    """Broken: its delay is not in the unit that it is declared in."""

    name = "forgetful"

    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(replace(parameter, units="ms") for parameter in super().parameters())


def test_a_delay_in_another_unit_than_declared_is_caught() -> None:
    with pytest.raises(Nonconformity, match=r"at 'delay' = 0\.75 ms .* 0\.75 s earlier, not 0\.00075 s"):
        check_mechanism(Forgetful())
