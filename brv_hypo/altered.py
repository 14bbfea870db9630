"""Copies of frozen dataclasses, made by the thousand."""

from __future__ import annotations

from dataclasses import fields
from functools import lru_cache
from typing import Any, TypeVar

Data = TypeVar("Data")


def altered(data: Data, /, **changes: Any) -> Data:
    """What `dataclasses.replace` gives, at half its cost; for fields that need no check of their own.

    What was found from the fields (`cached_property`) is not copied. Raises TypeError for what is no field.
    """
    kind: Any = type(data)
    names, known = _names(kind), vars(data)
    if not names.keys() >= changes.keys():
        raise TypeError(f"{kind.__name__} has no field {', '.join(sorted(changes.keys() - names.keys()))}")
    out: Data = object.__new__(kind)
    vars(out).update({name: known[name] for name in names}, **changes)
    return out


@lru_cache(maxsize=64)
def _names(kind: Any) -> dict[str, None]:
    """The names of the fields, in their order."""
    return {field.name: None for field in fields(kind)}
