"""The conformance kit: named checks that every plugin must pass, for authors to run in their own tests.

    @pytest.mark.parametrize("check", MECHANISM_CHECKS, ids=str)
    def test_keeps_the_contract(check):
        check(Ablation())

A check is a function whose docstring is the requirement; it raises Nonconformity with what was found. They run
on the motion and the record of conformance_samples.py. `conformance(item)` runs all that apply,
`relied_on(item)` has those without which an analysis could not use the plugin, and `renamed` gives a mechanism
under other names and units of its parameters, with which every result must be the same.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Generic, NamedTuple, TypeVar, get_args

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import FlightRecordError
from brv_hypo.flight.record import CHANNELS, Flight
from brv_hypo.flight.units import is_unit
from brv_hypo.mechanisms.checked import read_only, unchecked
from brv_hypo.mechanisms.conformance_samples import sample_flight, sample_motion, uniform_time
from brv_hypo.mechanisms.contract import Mechanism, Parameter, RecordEffect, Term, TimeVariation
from brv_hypo.motion.motion import Motion

# ---- What a check is, and what comes of it ----


Item = TypeVar("Item")


class Nonconformity(AssertionError):  # noqa: N818 - the field's word for a failed conformance check
    """A plugin breaks the contract: what was found, what is expected."""


@dataclass(frozen=True)
class Outcome:
    """What came of one check; `detail` says what was found where it failed."""

    check: str
    passed: bool
    detail: str = ""


@dataclass(frozen=True)
class Check(Generic[Item]):
    """One named requirement; calling it raises Nonconformity where the item breaks it."""

    name: str
    requirement: str
    test: Callable[[Item], None]

    def __call__(self, item: Item) -> None:
        """Run the check."""
        self.test(item)

    def __str__(self) -> str:
        return self.name

    def outcome(self, item: Item) -> Outcome:
        """Run the check; whatever it raises is a failure, an error in the plugin's own code included."""
        try:
            with np.errstate(all="ignore"):  # what is not finite is a finding, not a warning
                self.test(item)
        except Nonconformity as broken:
            return Outcome(self.name, False, str(broken))
        except Exception as error:  # any error of foreign code is a finding, and the other checks go on
            return Outcome(self.name, False, f"it raised {type(error).__name__}: {error}")
        return Outcome(self.name, True)


def named(test: Callable[[Item], None]) -> Check[Item]:
    """The check that a function is: its name, and its docstring's first line as the requirement."""
    requirement = (test.__doc__ or "").strip().splitlines()[0].rstrip(".")
    return Check(test.__name__, requirement, test)


def expect(condition: bool, found: str) -> None:
    """Raise Nonconformity with `found` unless `condition` holds."""
    if not condition:
        raise Nonconformity(found)


# ---- The checks of a mechanism: what the engine relies on when it fits, simulates and compares it ----


_NAME = re.compile(r"[a-z][a-z0-9_]*")
_RESERVED = ("none",)
# What times at which coefficients change are called, and what parts `mechanisms.0.theta.NAME`.
_KNOTS, _OF_A_PATH = ("knot", "start", "stop"), (".", "/")


def _thetas(mechanism: Mechanism) -> list[dict[str, float]]:
    """Every theta at the ends and the middle of the bounds of each parameter."""
    axes = [
        [(p.name, value) for value in (p.bounds[0], p.grid[len(p.grid) // 2], p.bounds[1])]
        for p in mechanism.parameters()
    ]
    return [dict(point) for point in itertools.product(*axes)]


def _grid(mechanism: Mechanism) -> list[dict[str, float]]:
    """Every theta that the engine searches."""
    axes = [[(p.name, value) for value in p.grid] for p in mechanism.parameters()]
    return [dict(point) for point in itertools.product(*axes)]


def _columns(terms: tuple[Term, ...]) -> FloatArray:
    """In-plane and out-of-plane columns, (terms, 2, *shape)."""
    return np.array([(term.in_plane, term.out_of_plane) for term in terms], dtype=float)


def is_declared(mechanism: Mechanism) -> None:
    """It has a name, a title, claims and a source, and its class says what it computes."""
    kind = type(mechanism)
    for attribute in ("name", "title", "claims", "source"):
        value = getattr(kind, attribute, None)
        expect(
            isinstance(value, str) and bool(value.strip()), f"`{attribute}` is {value!r}: set a line of text"
        )
    expect(
        _NAME.fullmatch(mechanism.name) is not None and mechanism.name not in _RESERVED,
        f"the name {mechanism.name!r}: use lower case letters, digits and _, and not 'none'",
    )
    expect(
        bool(kind.__dict__.get("__doc__")), "the class has no docstring: state the equation and its source"
    )


def is_configurable(mechanism: Mechanism) -> None:
    """Its options have defaults, and a configuration can set them."""
    again = type(mechanism).model_validate(mechanism.model_dump())
    expect(
        again == mechanism, f"its options do not survive being written and read: {again!r} for {mechanism!r}"
    )
    type(mechanism)()


def varies_in_known_ways(mechanism: Mechanism) -> None:
    """Its time variation is one or more of constant, jump and ramp."""
    known, stated = get_args(TimeVariation), mechanism.time_variation
    expect(bool(stated) and set(stated) <= set(known), f"`time_variation` is {stated!r}: choose from {known}")


def has_sane_parameters(mechanism: Mechanism) -> None:
    """Its nonlinear parameters have names, units, and an increasing grid inside their bounds."""
    parameters = mechanism.parameters()
    names = [parameter.name for parameter in parameters]
    expect(len(set(names)) == len(names), f"two parameters share a name: {names}")
    for parameter in parameters:
        expect(
            parameter.name.isprintable() and parameter.name.strip() == parameter.name != "",
            f"the parameter {parameter.name!r}: a name is one or more characters that can be printed",
        )
        expect(
            parameter.name not in _KNOTS and not set(parameter.name) & set(_OF_A_PATH),
            f"the parameter '{parameter.name}': every name will do but {', '.join(_KNOTS)}, which are what times of "
            f"change are called, and any with {' or '.join(_OF_A_PATH)}, which parts the names of a path",
        )
        low, high = parameter.bounds
        grid = np.asarray(parameter.grid, dtype=float)
        expect(grid.size > 0, f"the grid of '{parameter.name}' is empty")
        expect(
            bool(np.all(np.isfinite([low, high, *grid]))),
            f"'{parameter.name}': grid or bounds are not finite",
        )
        expect(bool(np.all(np.diff(grid) > 0)), f"the grid of '{parameter.name}' does not increase: {grid}")
        expect(
            low < high and low <= grid[0] and grid[-1] <= high,
            f"the grid of '{parameter.name}', {grid[0]} to {grid[-1]}, leaves its bounds {low} to {high}",
        )
        expect(is_unit(parameter.units), f"'{parameter.name}': '{parameter.units}' is not a unit")
        expect(
            not parameter.is_delay or _is_of_time(parameter),
            f"the delay '{parameter.name}' is in '{parameter.units}': use a unit of time",
        )
        expect(bool(parameter.meaning.strip()), f"'{parameter.name}' does not say what it means")


def _is_of_time(parameter: Parameter) -> bool:
    try:
        return parameter.seconds > 0.0
    except FlightRecordError:
        return False


def keeps_the_shape(mechanism: Mechanism) -> None:
    """Its columns have the motion's shape: (n,) over a record, (batch,) and (batch, 1) in a simulation."""
    time = uniform_time(60)
    for sampled in (time, time[:1], time[:, np.newaxis]):
        for term in mechanism.terms(sample_motion(sampled), _thetas(mechanism)[0]):
            for side in ("in_plane", "out_of_plane"):
                shape = np.shape(getattr(term, side))
                expect(
                    shape == sampled.shape,
                    f"`{side}` of '{term.name}' has shape {shape} for a motion of shape {sampled.shape}",
                )


def is_finite(mechanism: Mechanism) -> None:
    """Its columns are finite for every theta inside the bounds."""
    motion = sample_motion(uniform_time())
    for theta in [*_grid(mechanism), *_thetas(mechanism)]:
        for term in mechanism.terms(motion, theta):
            finite = np.isfinite(term.in_plane) & np.isfinite(term.out_of_plane)
            expect(
                bool(finite.all()),
                f"'{term.name}' has {np.sum(~finite)} values that are not finite at {theta}",
            )


def has_the_same_terms_for_every_theta(mechanism: Mechanism) -> None:
    """The number, order, names and units of its terms do not depend on theta."""
    motion = sample_motion(uniform_time(60))
    signatures = {
        tuple((term.name, term.units) for term in mechanism.terms(motion, theta))
        for theta in _grid(mechanism)
    }
    expect(len(signatures) == 1, f"the terms change with theta: {sorted(signatures)}")
    names = [name for name, _ in signatures.pop()]
    expect(bool(names) and len(set(names)) == len(names), f"terms need names, each its own: {names}")
    unknown = set(mechanism.characteristic) - set(names)
    expect(not unknown, f"`characteristic` names {sorted(unknown)}, which is none of the terms {names}")


def states_its_units(mechanism: Mechanism) -> None:
    """The unit of every coefficient can be read."""
    for term in mechanism.terms(sample_motion(uniform_time(60)), _thetas(mechanism)[0]):
        expect(
            is_unit(term.units), f"'{term.name}': '{term.units}' is not a unit; '1' is that of a pure number"
        )


def is_elementwise(mechanism: Mechanism) -> None:
    """A part of the motion gives that part of the columns, so a simulated instant agrees with the record."""
    time = uniform_time(90)
    chosen = np.array([3, 4, 40, 77])
    for theta in _thetas(mechanism):
        whole = _columns(mechanism.terms(sample_motion(time), theta))
        part = _columns(mechanism.terms(sample_motion(time[chosen]), theta))
        scale = np.max(np.abs(whole)) or 1.0
        worst = float(np.max(np.abs(whole[..., chosen] - part))) / scale
        expect(
            worst < 1e-9,
            f"four samples alone differ from the same four in a record by {worst:.1e} of the largest value; "
            "use each sample alone, and `motion.delayed` for the past",
        )


def is_pure(mechanism: Mechanism) -> None:
    """The same motion gives the same columns, and the motion is left as it was."""
    motion = read_only(sample_motion(uniform_time(60)))
    for theta in _thetas(mechanism):
        first = _columns(mechanism.terms(motion, theta))
        again = _columns(mechanism.terms(motion, theta))
        expect(
            bool(np.array_equal(first, again)),
            "two calls with the same motion differ: let nothing be remembered",
        )


def takes_the_meridian_as_an_angle(mechanism: Mechanism) -> None:
    """A whole turn of the windward meridian changes nothing."""
    motion = sample_motion(uniform_time(60))
    for theta in _thetas(mechanism):
        before = _columns(mechanism.terms(motion, theta))
        after = _columns(mechanism.terms(_turned(motion), theta))
        worst = float(np.max(np.abs(before - after)))
        expect(
            worst <= 1e-9 * (float(np.max(np.abs(before))) or 1.0),
            f"adding 2 pi to the windward meridian moves a column by {worst:.1e}; "
            "use its sine, its cosine or differences",
        )


def _turned(motion: Motion) -> Motion:
    """The same motion with its meridian counted from one turn further on."""
    return replace(
        motion,
        windward_meridian=motion.windward_meridian + 2.0 * np.pi,
        history=lambda tau: _turned(motion.delayed(tau)),
    )


def acts_on_the_moments(mechanism: Mechanism) -> None:
    """Every term moves a moment somewhere in the sample motion."""
    for theta in _thetas(mechanism)[-1:]:
        for term in mechanism.terms(sample_motion(uniform_time()), theta):
            expect(
                bool(np.any(term.in_plane) or np.any(term.out_of_plane)),
                f"'{term.name}' is zero throughout a motion of 2 to 4 deg, Mach 22, Reynolds 1e5 to 1e7",
            )


def flags_its_delays(mechanism: Mechanism) -> None:
    """A parameter that reaches into the past is flagged as a delay, in a unit of time, and never into the future."""
    theta = _thetas(mechanism)[0]
    requested = _delays_requested(mechanism, theta)
    expect(
        all(tau >= 0.0 for tau in requested), f"it requests the motion {-min(requested, default=0.0)} s in the future"
    )
    for parameter in mechanism.parameters():
        moved = _delays_requested(mechanism, {**theta, parameter.name: parameter.bounds[1]}) != requested
        expect(
            moved == parameter.is_delay,
            f"'{parameter.name}' {'sets a delay: flag it' if moved else 'sets no delay but is flagged'} "
            "(`is_delay`)",
        )
        if parameter.is_delay:
            _check_delay(mechanism, parameter, theta)


def _check_delay(mechanism: Mechanism, parameter: Parameter, theta: Mapping[str, float]) -> None:
    """The past that it requests is earlier by the parameter's value in its unit."""
    expect(parameter.bounds[0] >= 0.0, f"the delay '{parameter.name}' may become negative")
    value, seconds = parameter.bounds[1], parameter.seconds
    requested = _delays_requested(mechanism, {**theta, parameter.name: value})
    expect(
        any(np.isclose(tau, value * seconds, rtol=1e-9, atol=0.0) for tau in requested),
        f"at '{parameter.name}' = {value:g} {parameter.units} it requests the motion "
        f"{', '.join(f'{tau:g}' for tau in requested)} s earlier, not {value * seconds:g} s",
    )


def _delays_requested(mechanism: Mechanism, theta: Mapping[str, float]) -> list[float]:
    """The delays at which `terms` requests the motion."""
    requested: list[float] = []
    motion = sample_motion(uniform_time(60))

    def past(tau: float) -> Motion:
        requested.append(tau)
        return motion.delayed(tau)

    mechanism.terms(replace(motion, history=past), theta)
    return requested


def has_sane_knots(mechanism: Mechanism) -> None:
    """Its knots, if it sets any, are increasing times inside the record."""
    motion = sample_motion(uniform_time())
    knots = mechanism.knots(motion)
    if knots is None:
        return
    expect(np.ndim(knots) == 1, f"knots of shape {np.shape(knots)}: give a vector of times")
    inside = (knots >= motion.time[0]) & (knots <= motion.time[-1])
    expect(
        bool(np.all(np.diff(knots) > 0) and np.all(inside)),
        f"knots outside the record or out of order: {knots}",
    )


def derives_with_uncertainty(mechanism: Mechanism) -> None:
    """What it derives from coefficients is finite, has a unit, and its sigma follows the covariance."""
    terms = mechanism.terms(sample_motion(uniform_time(60)), _thetas(mechanism)[0])
    draw = np.random.default_rng(7)
    values = {
        term.name: float(value) for term, value in zip(terms, draw.normal(size=len(terms)), strict=True)
    }
    root = draw.normal(size=(len(terms), len(terms)))
    covariance = 1e-4 * root @ root.T
    for one, four in zip(
        mechanism.derived(values, covariance), mechanism.derived(values, 4.0 * covariance), strict=True
    ):
        expect(bool(np.isfinite(one.value)), f"'{one.name}' is {one.value}")
        expect(is_unit(one.units), f"'{one.name}': '{one.units}' is not a unit")
        expect(
            one.std_error >= 0.0 and bool(np.isclose(four.std_error, 2.0 * one.std_error)),
            f"'{one.name}': four times the covariance takes sigma from {one.std_error} "
            f"to {four.std_error}, where twice is expected",
        )


def has_a_sane_likelihood(mechanism: Mechanism) -> None:
    """Its likelihood is finite and falls as the innovations grow."""
    innovations = np.random.default_rng(7).normal(size=200)
    near, far = (mechanism.log_likelihood(scale * innovations, 1.0) for scale in (1.0, 3.0))
    expect(bool(np.isfinite([near, far]).all()), f"log-likelihoods of {near} and {far}")
    expect(far < near, f"innovations three times as large are likelier: {far} against {near}")


def documents_its_terms(mechanism: Mechanism) -> None:
    """`terms` says in its docstring which terms it gives."""
    expect(bool(type(mechanism).terms.__doc__), "`terms` has no docstring of its own")


MECHANISM_CHECKS: tuple[Check[Mechanism], ...] = tuple(
    named(check)
    for check in (
        is_declared,
        documents_its_terms,
        is_configurable,
        varies_in_known_ways,
        has_sane_parameters,
        keeps_the_shape,
        is_finite,
        has_the_same_terms_for_every_theta,
        states_its_units,
        is_elementwise,
        is_pure,
        takes_the_meridian_as_an_angle,
        acts_on_the_moments,
        flags_its_delays,
        has_sane_knots,
        derives_with_uncertainty,
        has_a_sane_likelihood,
    )
)
"""Every check of a mechanism, in the order in which an author wants to read them."""


class Alias(NamedTuple):
    """Another name of a parameter and other units, one of which is `scale` of its own."""

    name: str
    units: str
    scale: float = 1.0


def renamed(mechanism: Mechanism, aliases: Mapping[str, Alias]) -> Mechanism:
    """The same mechanism with those of its parameters under other names and in other units."""
    own = unchecked(mechanism)
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
    attributes = {"__module__": kind.__module__, "__doc__": kind.__doc__, "parameters": parameters, "terms": terms}
    made: type[Mechanism] = type(kind.__name__, (kind,), attributes)
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


# ---- The checks of a record effect: a perturbation of the record that is small, pure and linear ----


# Units in which wind (m/s) and the place of the accelerometers (m) are compared.
_WIND, _PLACE = 10.0, 0.1


def _channels(flight: Flight) -> FloatArray:
    """All that an effect may act on, (rows, samples): channels by their size in the sample, wind, place, inertia."""
    channels = np.array([getattr(flight, name) for name in CHANNELS], dtype=float)
    sizes = np.array([np.max(np.abs(getattr(sample_flight(), name))) for name in CHANNELS], dtype=float)
    wind = np.zeros((3, flight.samples)) if flight.wind is None else flight.wind.T / _WIND
    place = np.array(flight.vehicle.accelerometer_position)[:, np.newaxis] * np.ones(flight.samples) / _PLACE
    known = sample_flight().vehicle
    inertia = np.array([[flight.vehicle.ixx / known.ixx], [flight.vehicle.iyy / known.iyy]])
    return np.concatenate([channels / sizes[:, np.newaxis], wind, place, inertia * np.ones(flight.samples)])


def declares_itself(effect: RecordEffect) -> None:
    """It has a name, a title, claims, a source and a kind."""
    for attribute in ("name", "title", "claims", "source"):
        value = getattr(type(effect), attribute, None)
        expect(
            isinstance(value, str) and bool(value.strip()), f"`{attribute}` is {value!r}: set a line of text"
        )
    expect(effect.kind in ("instrument", "environment"), f"`kind` is {effect.kind!r}")


def has_sane_components(effect: RecordEffect) -> None:
    """Each component has a name of its own, a unit and a typical size above zero."""
    components = effect.components(sample_flight())
    names = [name for name, _, _ in components]
    expect(bool(names) and len(set(names)) == len(names), f"components need names, each its own: {names}")
    for name, units, size in components:
        expect(is_unit(units), f"'{name}': '{units}' is not a unit")
        expect(bool(np.isfinite(size)) and size > 0.0, f"'{name}': the typical size is {size}")


def leaves_the_record_alone_at_zero(effect: RecordEffect) -> None:
    """The value zero changes nothing."""
    flight = sample_flight()
    for name, _, _ in effect.components(sample_flight()):
        change = np.max(np.abs(_channels(effect.perturb(flight, name, 0.0)) - _channels(flight)))
        expect(bool(change < 1e-12), f"'{name}' = 0 changes the record by {change:.1e} of its size")


def changes_the_record(effect: RecordEffect) -> None:
    """The typical size changes the record, keeps the number of samples and leaves all finite."""
    flight = sample_flight()
    for name, _, size in effect.components(sample_flight()):
        changed = _channels(effect.perturb(flight, name, size))
        expect(changed.shape == _channels(flight).shape, f"'{name}' changes the number of samples")
        expect(bool(np.isfinite(changed).all()), f"'{name}' leaves values that are not finite")
        expect(bool(np.any(changed != _channels(flight))), f"'{name}' = {size} changes nothing")


def is_linear_for_small_values(effect: RecordEffect) -> None:
    """Half the typical size does half of what the typical size does, within 5 %."""
    flight = sample_flight()
    for name, _, size in effect.components(sample_flight()):
        whole = _channels(effect.perturb(flight, name, size)) - _channels(flight)
        half = _channels(effect.perturb(flight, name, 0.5 * size)) - _channels(flight)
        off = float(np.max(np.abs(whole - 2.0 * half)) / np.max(np.abs(whole)))
        expect(off < 0.05, f"'{name}' departs from linear by {100 * off:.0f} % at its typical size {size}")


def leaves_its_input_alone(effect: RecordEffect) -> None:
    """The given record is left as it was, and the same call gives the same record."""
    flight = sample_flight()
    for name, _, size in effect.components(sample_flight()):
        first, again = (_channels(effect.perturb(flight, name, size)) for _ in range(2))
        expect(bool(np.array_equal(first, again)), f"two calls with the same '{name}' differ")
        expect(
            bool(np.array_equal(_channels(flight), _channels(sample_flight()))),
            f"'{name}' writes into its input",
        )


EFFECT_CHECKS: tuple[Check[RecordEffect], ...] = tuple(
    named(check)
    for check in (
        declares_itself,
        has_sane_components,
        leaves_the_record_alone_at_zero,
        changes_the_record,
        is_linear_for_small_values,
        leaves_its_input_alone,
    )
)
"""Every check of a record effect."""


# ---- Runs the checks that apply to an item ----


# What an analysis relies on; the other checks are for the author.
_MECHANISM_RELIED_ON = (
    has_sane_parameters,
    keeps_the_shape,
    has_the_same_terms_for_every_theta,
    is_finite,
    has_sane_knots,
    has_a_sane_likelihood,
)
_EFFECT_RELIED_ON = (has_sane_components, changes_the_record)


def relied_on(item: Mechanism | RecordEffect) -> tuple[Callable[[], None], ...]:
    """The checks that an analysis relies on, bound to the item; each raises Nonconformity where it is broken."""
    if isinstance(item, Mechanism):
        return tuple(partial(check, item) for check in _MECHANISM_RELIED_ON)
    return tuple(partial(check, item) for check in _EFFECT_RELIED_ON)


def conformance(item: Mechanism | RecordEffect) -> tuple[Outcome, ...]:
    """The outcome of every check, in order; none stops the others."""
    tested = unchecked(item)
    if isinstance(tested, Mechanism):
        return tuple(check.outcome(tested) for check in MECHANISM_CHECKS)
    return tuple(check.outcome(tested) for check in EFFECT_CHECKS)

__all__ = [
    "EFFECT_CHECKS",
    "MECHANISM_CHECKS",
    "Alias",
    "Check",
    "Nonconformity",
    "Outcome",
    "conformance",
    "relied_on",
    "renamed",
    "sample_flight",
    "sample_motion",
]
