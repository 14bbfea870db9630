"""Configurations written before the static moment's coefficients had their names of today are read as they were."""

from __future__ import annotations

import pytest

from brv_hypo.simulation.config import AerodynamicsConfig, PlantedConfig


def test_earlier_names_are_read() -> None:
    earlier = AerodynamicsConfig.model_validate({"C_N0": 1e-4, "C_Nalpha": -0.1, "C_Nalpha3": 2.0})
    assert earlier == AerodynamicsConfig(C_m0=1e-4, C_malpha=-0.1, C_malpha3=2.0)
    assert PlantedConfig(mechanism="inplane", terms={"C_Nalpha": 0.1}).terms == {"C_malpha": 0.1}


def test_a_name_given_twice_is_refused() -> None:
    with pytest.raises(ValueError, match="given twice"):
        AerodynamicsConfig.model_validate({"C_N0": 1e-4, "C_m0": 1e-4})
