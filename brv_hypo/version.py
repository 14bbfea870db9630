"""The version that is installed, or that the checkout states."""

from __future__ import annotations

from functools import cache
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed


@cache
def version() -> str:
    """The version of brv-hypo; "unknown" where it runs without having been installed."""
    try:
        return installed("brv-hypo")
    except PackageNotFoundError:
        return "unknown"
