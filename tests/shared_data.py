"""Where the reference data live: beside the checkout, never copied into it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

SHARED = Path(__file__).resolve().parents[2] / "shared"


def shared_file(relative: str) -> Path:
    """The path of a reference file; its absence fails in CI and skips, with the reason, elsewhere."""
    path = SHARED / relative
    if path.exists():
        return path
    reason = f"reference data missing: expected {relative} in the folder 'shared' beside the checkout"
    if os.environ.get("CI", "").lower() in ("true", "1"):
        pytest.fail(reason)
    pytest.skip(reason)
