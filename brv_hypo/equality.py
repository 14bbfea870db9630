"""When two results are the same: arrays value by value, and what is not a number like what is not a number."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from inspect import isclass, isroutine
from typing import Any

import numpy as np


def alike(one: Any, other: Any) -> bool:
    """True where both are of one type and hold the same, whatever depth it lies at."""
    if one is other:
        return True
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=one.dtype.kind in "fc")
    if isinstance(one, float):
        return bool(one == other or (np.isnan(one) and np.isnan(other)))
    if isinstance(one, Mapping):
        return one.keys() == other.keys() and all(alike(value, other[key]) for key, value in one.items())
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(alike, one, other))
    if is_dataclass(one):
        return all(alike(getattr(one, field.name), getattr(other, field.name)) for field in fields(one))
    if hasattr(one, "__dict__") and not (isroutine(one) or isclass(one)):
        return alike(vars(one), vars(other))  # settings and splines, whose own definitions stop at arrays
    return bool(one == other)
