"""Flights that differ in a few numbers: dotted paths into the configuration, one value per flight."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.simulation.config import SimulationConfig
from brv_hypo.simulation.loading import validated

# These shape the arrays of a batch, so all its flights share them.
_COMMON = ("duration", "step", "sample_rate", "start.time")
_ERRORS = "instruments.errors."


def varied(
    config: SimulationConfig, flights: int, variations: Mapping[str, ArrayLike] | None
) -> tuple[SimulationConfig, ...]:
    """One configuration per flight; `variations` maps dotted paths to a value or to (flights,) values.

    Paths read like 'start.alpha', 'mechanisms.0.terms.eps', 'vehicle.accelerometer_position.1',
    'instruments.errors.EFFECT.COMPONENT'.
    Raises UsageError for an unknown path, a wrong number of values, or a value out of range.
    """
    if not variations:
        return (config,) * flights
    columns = {path: _column(path, values, flights) for path, values in variations.items()}
    base = config.model_dump()
    found = []
    for flight in range(flights):
        data = copy.deepcopy(base)
        for path, column in columns.items():
            _put(data, path, float(column[flight]))
        found.append(validated(data, f"flight {flight} of the batch"))
    return tuple(found)


def per_flight(configs: Sequence[SimulationConfig], *path: str | int, missing: float = np.nan) -> FloatArray:
    """The number at `path` of each configuration, (flights,); `missing` where the way there holds None."""
    return np.array([_at(config, path, missing) for config in configs], dtype=float)


def numbers(config: SimulationConfig) -> dict[str, float]:
    """Every number of a configuration by its dotted path; `plantable` sets left out."""
    found: dict[str, float] = {}
    _collect(config.model_dump(exclude={"plantable"}), "", found)
    return found


def _at(node: Any, path: Sequence[str | int], missing: float) -> float:
    for part in path:
        inside: Any = part
        node = node[inside] if isinstance(node, Mapping | tuple) else getattr(node, inside)
        if node is None:
            return missing
    return float(node)


def _collect(node: Any, path: str, found: dict[str, float]) -> None:
    if isinstance(node, Mapping):
        for key, value in node.items():
            _collect(value, f"{path}.{key}" if path else str(key), found)
    elif isinstance(node, tuple | list):
        for index, value in enumerate(node):
            _collect(value, f"{path}.{index}", found)
    elif isinstance(node, int | float) and not isinstance(node, bool):
        found[path] = float(node)


def _column(path: str, values: ArrayLike, flights: int) -> FloatArray:
    if path in _COMMON:
        raise UsageError(
            f"'{path}' cannot vary within a batch: its flights share one time grid. Simulate it apart."
        )
    column = np.asarray(values, dtype=float)
    if column.shape not in ((), (flights,)):
        raise UsageError(
            f"variation '{path}' has shape {column.shape}, expected one value or ({flights},), one per seed"
        )
    return np.broadcast_to(column, (flights,))


def _put(data: dict[str, Any], path: str, value: float) -> None:
    """Set a leaf of nested mappings and tuples; tuples become lists on the way."""
    if path.startswith(_ERRORS):  # any effect and component: those that are absent are zero
        effect, _, component = path.removeprefix(_ERRORS).partition(".")
        data["instruments"]["errors"].setdefault(effect, {})[component] = value
        return
    node: Any = data
    *parents, leaf = path.split(".")
    try:
        for part in parents:
            child = node[int(part)] if isinstance(node, list) else node[part]
            if isinstance(child, tuple):
                child = list(child)
                node[int(part) if isinstance(node, list) else part] = child
            node = child
        key: Any = int(leaf) if isinstance(node, list) else leaf
        if isinstance(node[key], str | Mapping | tuple | list):
            raise TypeError
        node[key] = value
    except (KeyError, IndexError, ValueError, TypeError):
        raise UsageError(
            f"variation '{path}' does not lead to a number of the configuration; paths read like "
            "'start.alpha' or 'mechanisms.0.terms.eps', and the mechanism must be in `mechanisms` or planted"
        ) from None
