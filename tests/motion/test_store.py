from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from brv_hypo.errors import UsageError
from brv_hypo.io.binary import read_tree
from brv_hypo.motion import reconstruct, write_motion
from tests.motion.truth import Truth, observe


def test_written_motion_is_the_reconstruction(tmp_path: Path, truths: dict[str, Truth]) -> None:
    result = reconstruct(observe(truths["cone"], 0))
    path = tmp_path / "motion.h5"
    write_motion(result, path)
    tree = read_tree(path)
    assert tree.attributes["format"] == "brv-motion"
    assert tree.attributes["method"] == "joint"
    assert tree.datasets["alpha"].values == pytest.approx(result.motion.alpha)
    assert tree.datasets["alpha"].units == "rad"
    assert all(dataset.units for dataset in tree.datasets.values())
    usable = result.moments.usable
    assert tree.datasets["C_N_prime"].values[usable] == pytest.approx(result.plane_moments.real[usable])
    assert np.isnan(tree.datasets["C_m"].values[~usable]).all()
    assert tree.groups["estimate"].datasets["gravity_body"].values == pytest.approx(result.gravity_body)


def test_an_existing_file_is_kept_unless_forced(tmp_path: Path, truths: dict[str, Truth]) -> None:
    result = reconstruct(observe(truths["cone"], 0))
    path = tmp_path / "motion.h5"
    path.write_text("mine")
    with pytest.raises(UsageError, match="exists already"):
        write_motion(result, path)
    assert path.read_text() == "mine"
    write_motion(result, path, overwrite=True)
    assert read_tree(path).attributes["format_version"] == 1
    assert [entry.name for entry in tmp_path.iterdir()] == ["motion.h5"]
