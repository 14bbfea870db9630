"""A method of reconstruction is one file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from brv_hypo.cli.main import app
from brv_hypo.errors import UsageError
from brv_hypo.flight import save_flight
from brv_hypo.mechanisms.conformance import sample_flight
from brv_hypo.motion import ReconstructionConfig, methods, reconstruct
from brv_hypo.settings import settings_of

HALFWAY = '''
from dataclasses import replace

from brv_hypo.motion.methods.open_loop import from_nose


def halfway(record, config, perturbations):
    """Half the crossflow of the velocity method."""
    found = from_nose(record, perturbations, forces=True)
    return replace(found, crossflow=0.5 * found.crossflow)


METHODS = (halfway,)
'''


@pytest.fixture
def added(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "halfway.py").write_text(HALFWAY)
    monkeypatch.setattr(methods, "__path__", [*methods.__path__, str(tmp_path)])


def test_a_method_is_added_by_one_file(added: None) -> None:
    flight = sample_flight()
    found = reconstruct(flight, ReconstructionConfig(method="halfway"))
    velocity = reconstruct(flight, ReconstructionConfig(method="velocity"))
    assert found.method == "halfway"
    np.testing.assert_allclose(found.crossflow, 0.5 * velocity.crossflow, atol=1e-12)


def test_it_is_known_to_the_command_line(added: None, tmp_path: Path) -> None:
    save_flight(sample_flight(), tmp_path / "flight.h5")
    command = ["reconstruct", str(tmp_path / "flight.h5"), "--method", "halfway", "--json", "-"]
    done = CliRunner().invoke(app, command, catch_exceptions=False)
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["reconstruction"]["method"] == "halfway"


def test_an_unknown_method_is_refused_with_the_likeliest() -> None:
    with pytest.raises(UsageError, match="is 'velocity' meant"):
        settings_of(ReconstructionConfig, {"method": "velocty"})
    with pytest.raises(UsageError, match="known are joint, rates, velocity"):
        settings_of(ReconstructionConfig, {"method": "spiral"})
