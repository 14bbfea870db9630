"""A simulation's configuration with some of its numbers changed, by dotted path."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from brv_hypo.simulation import SimulationConfig


def varied(config: SimulationConfig, changes: Mapping[str, float]) -> SimulationConfig:
    """`config` with each number at its path, as in 'mechanisms.0.terms.eps' or 'instruments.errors.gyro_bias.q'."""
    data = config.model_dump(mode="json")
    for path, value in changes.items():
        *parents, leaf = path.split(".")
        node: Any = data
        for part in parents:
            node = node[int(part)] if isinstance(node, list) else node.setdefault(part, {})
        node[leaf] = float(value)
    return SimulationConfig.model_validate(data)
