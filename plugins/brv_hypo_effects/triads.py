"""What errors of three sensors along the body axes do to their channels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.flight.record import Flight


def turned(flight: Flight, channels: Sequence[str], axis: str, angle: float) -> Flight:
    """The record with the sensors of these three channels turned by `angle` rad about a body axis: v gains v x m."""
    x, y, z = (np.asarray(getattr(flight, name), dtype=float) for name in channels)
    if axis == "x":
        read = (x, y + angle * z, z - angle * y)
    elif axis == "y":
        read = (x - angle * z, y, z + angle * x)
    else:
        read = (x + angle * y, y - angle * x, z)
    return replace(flight, **dict(zip(channels, read, strict=True)))  # type: ignore[arg-type]


def sheared(flight: Flight, channels: Sequence[str], pair: str, angle: float) -> Flight:
    """The record with the sensors of two body axes turned by `angle` rad toward each other: each reads of the other."""
    first, second = (channels["xyz".index(axis)] for axis in pair)
    one, other = (np.asarray(getattr(flight, name), dtype=float) for name in (first, second))
    return replace(flight, **{first: one + angle * other, second: other + angle * one})  # type: ignore[arg-type]
