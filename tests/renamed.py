"""Mechanisms under other names and units of their parameters, with which every result must be the same."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple, cast

from brv_hypo.mechanisms import Mechanism, Parameter, Term
from brv_hypo.mechanisms.checked import Checked, unchecked
from brv_hypo.motion.motion import Motion


class Alias(NamedTuple):
    """Another name of a parameter and other units, one of which is `scale` of its own."""

    name: str
    units: str
    scale: float = 1.0


class Renamed(Checked):
    """A mechanism of whose parameters some have an alias."""

    def __init__(self, item: Mechanism, aliases: Mapping[str, Alias]) -> None:
        super().__init__(item, "")
        self.aliases = aliases

    def parameters(self) -> tuple[Parameter, ...]:
        found = []
        for own in self.item.parameters():
            name, units, scale = self._alias(own)
            low, high = (bound / scale for bound in own.bounds)
            grid = tuple(value / scale for value in own.grid)
            found.append(replace(own, name=name, units=units, grid=grid, bounds=(low, high)))
        return tuple(found)

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        aliases = {own.name: self._alias(own) for own in self.item.parameters()}
        return tuple(self.item.terms(motion, {name: theta[a.name] * a.scale for name, a in aliases.items()}))

    def _alias(self, own: Parameter) -> Alias:
        return self.aliases.get(own.name, Alias(own.name, own.units))


def renamed(mechanism: Mechanism, aliases: Mapping[str, Alias]) -> Mechanism:
    """The same mechanism with those of its parameters under other names and in other units."""
    return cast(Mechanism, Renamed(unchecked(mechanism), aliases))
