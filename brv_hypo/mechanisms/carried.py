"""What is part of every hypothesis: the errors that a record may have, and the tolerances of its vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.mechanisms.loading import OWN
from brv_hypo.mechanisms.registry import installed
from brv_hypo.motion.perturbation import Perturbation, superposed


def carried_effects() -> tuple[RecordEffect, ...]:
    """The record effects of this distribution that are part of every hypothesis.

    Those of other distributions are hypotheses, tried where asked for: what is installed changes no result.
    """
    return tuple(item for item in _own() if isinstance(item, RecordEffect) and item.carried)


def carried_mechanisms(flight: Flight) -> tuple[Mechanism, ...]:
    """The mechanisms of this distribution whose coefficients the record's tolerances of the vehicle bound."""
    return tuple(item for item in _own() if isinstance(item, Mechanism) and item.tolerance(flight) is not None)


def perturbations(flight: Flight) -> tuple[Perturbation, ...]:
    """Every component of every carried effect, with the size that the tolerances of `flight` give it."""
    return tuple(
        Perturbation(
            effect.name,
            component.name,
            component.units,
            component.size,
            partial(_applied, effect, component.name),
        )
        for effect in carried_effects()
        for component in effect.components(flight)
    )


def without(flight: Flight, errors: Mapping[tuple[str, str], float]) -> Flight:
    """The record with what is known of carried effects' components (SI) taken out; other names are passed over."""
    changed = (
        effect.perturb(flight, component.name, -errors[effect.name, component.name])
        for effect in carried_effects()
        for component in effect.components(flight)
        if (effect.name, component.name) in errors
    )
    return superposed(flight, changed)


def _own() -> list[Mechanism | RecordEffect]:
    """All that this distribution brings."""
    return [entry.item for entry in installed().values() if entry.package == OWN]


def _applied(effect: RecordEffect, component: str, flight: Flight, value: float) -> Flight:
    return effect.perturb(flight, component, value)
