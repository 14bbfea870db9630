"""A missing reference file fails where everything must run, and is skipped, with its reason, elsewhere."""

from __future__ import annotations

import pytest

from tests import shared_data
from tests.shared_data import shared_file


@pytest.mark.parametrize("ci", ["true", "True", "1"])
def test_a_missing_file_fails_in_ci(ci: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CI", ci)
    with pytest.raises(pytest.fail.Exception, match=r"expected data/none\.h5"):
        shared_file("data/none.h5")


@pytest.mark.parametrize("ci", [None, "", "false"])
def test_a_missing_file_is_skipped_elsewhere(ci: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    if ci is None:
        monkeypatch.delenv("CI", raising=False)
    else:
        monkeypatch.setenv("CI", ci)
    with pytest.raises(pytest.skip.Exception, match=r"expected data/none\.h5"):
        shared_file("data/none.h5")


def test_a_file_that_is_there_is_its_path(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "there.csv").write_text("x\n")
    monkeypatch.setattr(shared_data, "SHARED", tmp_path)
    assert shared_file("there.csv") == tmp_path / "there.csv"
