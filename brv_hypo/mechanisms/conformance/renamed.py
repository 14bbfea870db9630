"""A mechanism under other names and units of its nonlinear parameters: nothing found with it may differ."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from brv_hypo.mechanisms.contract import Mechanism, Parameter, Term
from brv_hypo.mechanisms.isolation import plain
from brv_hypo.motion.motion import Motion


class Alias(NamedTuple):
    """Another name of a parameter and other units, one of which is `scale` of its own."""

    name: str
    units: str
    scale: float = 1.0


def renamed(mechanism: Mechanism, aliases: Mapping[str, Alias]) -> Mechanism:
    """The same mechanism with those of its parameters under other names and in other units."""
    own = plain(mechanism)
    known = {parameter.name: aliases.get(parameter.name) for parameter in own.parameters()}

    def parameters(_: Mechanism) -> tuple[Parameter, ...]:
        return tuple(_under(parameter, aliases.get(parameter.name)) for parameter in own.parameters())

    def terms(_: Mechanism, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        return own.terms(
            motion,
            {name: theta[name] if a is None else theta[a.name] * a.scale for name, a in known.items()},
        )

    kind: type[Any] = type(own)
    terms.__doc__ = kind.terms.__doc__
    told = {"__module__": kind.__module__, "__doc__": kind.__doc__, "parameters": parameters, "terms": terms}
    made: type[Mechanism] = type(kind.__name__, (kind,), told)
    return made.model_validate(own.model_dump())


def _under(parameter: Parameter, alias: Alias | None) -> Parameter:
    if alias is None:
        return parameter
    low, high = parameter.bounds
    return Parameter(
        alias.name,
        alias.units,
        tuple(value / alias.scale for value in parameter.grid),
        (low / alias.scale, high / alias.scale),
        parameter.meaning,
        parameter.is_delay,
    )
