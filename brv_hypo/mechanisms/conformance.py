"""The conformance kit: named checks that every plugin must pass, for authors to run in their own tests.

    @pytest.mark.parametrize("check", MECHANISM_CHECKS)
    def test_keeps_the_contract(check):
        check(Ablation())

A check is a function whose docstring is the requirement; it raises Nonconformity with what was found. They run on
a closed-form motion and record (`sample_motion`, `sample_flight`). `conformance(item)` runs all that apply,
`relied_on(item)` has those without which an analysis could not use the plugin.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import FlightRecordError, MechanismError
from brv_hypo.flight.record import CHANNELS, Flight, Vehicle
from brv_hypo.flight.units import is_unit
from brv_hypo.mechanisms.checked import checked, read_only, unchecked
from brv_hypo.mechanisms.contract import FAMILIES, Mechanism, Process, RecordEffect, RecordProcess, Term, TimeVariation
from brv_hypo.motion.interpolation import time_splines
from brv_hypo.motion.motion import Motion, angle_of_attack, angle_rates

DURATION = 6.0  # seconds of the sample motion and of the sample record
_SLOW, _FAST = 0.05, 0.012  # crossflow amplitudes of the two epicyclic arms; unequal, so alpha stays above zero
_SLOW_RATE, _FAST_RATE = 7.3, -11.9  # rad/s
_FORCE_SLOPE, _MOMENT_SLOPE = 2.0, -0.3  # 1/rad
_SHORT = 60  # samples where few will do
_GAP = 5  # samples
Checks = tuple[Callable[[Any], None], ...]


def sample_motion(time: FloatArray) -> Motion:
    """An epicyclic entry motion at `time` (s, any shape), 0 to DURATION; `delayed` is exact. alpha goes from 2 to 4
    deg, the meridian turns at 5 to 12 rad/s, Mach falls from 22 and Reynolds grows from 1e5, for mechanisms of any.
    """
    arm = _FAST / _SLOW * np.exp(1j * (_FAST_RATE - _SLOW_RATE) * time)
    turn = np.exp(1j * _SLOW_RATE * time)
    crossflow = _SLOW * turn * (1.0 + arm)
    crossflow_rate = 1j * _SLOW * turn * (_SLOW_RATE + _FAST_RATE * arm)
    alpha = angle_of_attack(crossflow)
    alpha_rate, meridian_rate = angle_rates(crossflow, crossflow_rate)
    velocity = 6900.0 - 40.0 * time
    return Motion(
        time=time,
        alpha=alpha,
        alpha_rate=alpha_rate,
        windward_meridian=0.5 * np.pi - (_SLOW_RATE * time + np.angle(1.0 + arm)),
        windward_meridian_rate=meridian_rate,
        p=12.0 + 0.1 * time,
        q=0.4 * np.cos(7.0 * time),
        r=0.4 * np.sin(7.0 * time),
        velocity=velocity,
        dynamic_pressure=2e4 * np.exp(0.3 * time),
        mach=velocity / 310.0,
        reynolds=1e5 * np.exp(0.8 * time),
        in_plane_moment=-0.001 + _MOMENT_SLOPE * alpha,
        reference_length=0.4,
        history=lambda tau: sample_motion(time - tau),
    )


def uniform_time(samples: int = 600) -> FloatArray:
    """Sample times over the whole sample motion, s."""
    return np.linspace(0.0, DURATION, samples, endpoint=False)


def sample_flight() -> Flight:
    """A short record of the sample motion: what its instruments would read, without noise."""
    motion, sizes = sample_motion(uniform_time()), {"reference_length": 0.4, "reference_area": 0.125}
    vehicle = Vehicle(mass=100.0, ixx=1.5, iyy=10.0, accelerometer_position=(0.1, 0.02, -0.01), **sizes)
    normal = motion.dynamic_pressure * vehicle.reference_area * _FORCE_SLOPE * motion.alpha / vehicle.mass
    shared = ("time", "p", "q", "r", "velocity", "dynamic_pressure", "mach", "reynolds")
    return Flight(
        **{name: getattr(motion, name) for name in shared},
        ax=-0.1 * motion.dynamic_pressure * vehicle.reference_area / vehicle.mass,
        ay=-normal * np.sin(motion.windward_meridian),
        az=-normal * np.cos(motion.windward_meridian),
        vehicle=vehicle,
        title="sample of the conformance kit",
    )


class Nonconformity(AssertionError):  # noqa: N818 - the field's word for a failed conformance check
    """A plugin breaks the contract: what was found, what is expected."""


@dataclass(frozen=True)
class CheckOutcome:
    """What came of one check; `detail` says what was found where it failed."""

    check: str
    passed: bool
    detail: str


def expect(condition: bool | np.bool_, found: str) -> None:
    """Raise Nonconformity with `found` unless `condition` holds."""
    if not condition:
        raise Nonconformity(found)


# ---- The checks of a mechanism: what the engine relies on when it fits, simulates and compares it ----


def _thetas(mechanism: Mechanism, *, searched: bool = False) -> list[dict[str, float]]:
    """Every theta at the ends and the middle of each parameter's bounds; or those that the engine searches."""
    known = mechanism.parameters()
    values = [p.grid if searched else (p.bounds[0], p.grid[len(p.grid) // 2], p.bounds[1]) for p in known]
    return [dict(zip([p.name for p in known], point, strict=True)) for point in itertools.product(*values)]


def _columns(terms: Sequence[Term]) -> FloatArray:
    """In-plane and out-of-plane columns, (terms, 2, *shape)."""
    return np.array([(term.in_plane, term.out_of_plane) for term in terms], dtype=float)


def is_declared(item: Mechanism | RecordEffect) -> None:
    """It has a name, a title, claims, a source and a kind; a process of the record channels, units and a size too."""
    for attribute in ("name", "title", "claims", "source"):
        value = getattr(item, attribute, None)
        expect(isinstance(value, str) and bool(value.strip()), f"`{attribute}` is {value!r}: set a line of text")
    sound = re.fullmatch(r"[a-z][a-z0-9_]*", item.name) is not None and item.name != "none"
    expect(sound, f"the name {item.name!r}: use lower case letters, digits and _, and not 'none'")
    moments = ("process",) if isinstance(item, Process) else ("mechanism", "aerodynamic")
    kinds = moments if isinstance(item, Mechanism) else ("instrument", "environment")
    kind = getattr(item, "kind", None)
    expect(kind in kinds, f"`kind` is {kind!r}, expected one of {kinds}")
    examples = {"channels": '("velocity",)', "units": '"m/s"', "size": "2.0"}
    for name, example in examples.items() if isinstance(item, RecordProcess) else ():
        expect(hasattr(item, name), f"`{name}` is missing: set it in the class, as in {name} = {example}")


def documents_its_terms(mechanism: Mechanism) -> None:
    """Its class says what it computes, and `terms` which terms it gives, in their docstrings."""
    kind = mechanism.__class__
    expect(bool(vars(kind).get("__doc__")), "the class has no docstring: state the equation and its source")
    expect(bool(kind.terms.__doc__), "`terms` has no docstring of its own")


def is_configurable(mechanism: Mechanism) -> None:
    """Its options have defaults, and a configuration can set them."""
    options, kind = mechanism.model_dump(), mechanism.__class__
    again = kind.model_validate(options).model_dump()
    expect(again == options, f"its options do not survive being written and read: {again} for {options}")
    kind()


def varies_in_known_ways(mechanism: Mechanism) -> None:
    """Its time variation is one or more of constant, jump and ramp."""
    known, stated = get_args(TimeVariation), mechanism.time_variation
    sound = bool(stated) and set(stated) <= set(known)
    expect(sound, f"`time_variation` is {stated!r}, expected a tuple of some of {known}")


def has_sane_parameters(mechanism: Mechanism) -> None:
    """Its nonlinear parameters have names, units, and an increasing grid inside their bounds."""
    names = [parameter.name for parameter in mechanism.parameters()]
    expect(len(set(names)) == len(names), f"two parameters share a name: {names}")
    for parameter in mechanism.parameters():
        name, units, (low, high) = parameter.name, parameter.units, parameter.bounds
        sound = name.isprintable() and name.strip() == name != ""
        expect(sound, f"the parameter {name!r}: a name is one or more characters that can be printed")
        expect(
            name not in ("knot", "start", "stop") and not set(name) & set("./"),
            f"the parameter '{name}': every name will do but knot, start, stop, which are what times of change are "
            "called, and any with . or /, which parts the names of a path",
        )
        grid = np.asarray(parameter.grid, dtype=float)
        expect(grid.size > 0, f"the grid of '{name}' is empty")
        expect(np.all(np.isfinite([low, high, *grid])), f"'{name}': grid or bounds are not finite")
        expect(np.all(np.diff(grid) > 0), f"the grid of '{name}' does not increase: {grid}")
        inside = low < high and low <= grid[0] and grid[-1] <= high
        expect(inside, f"the grid of '{name}', {grid[0]} to {grid[-1]}, leaves its bounds {low} to {high}")
        expect(is_unit(units), f"'{name}': '{units}' is not a unit")
        if parameter.is_delay:
            try:
                expect(parameter.seconds > 0.0, f"the delay '{name}' is in '{units}', which is no time")
            except FlightRecordError:
                raise Nonconformity(f"the delay '{name}' is in '{units}': use a unit of time") from None
        expect(bool(parameter.meaning.strip()), f"'{name}' does not say what it means")


def keeps_the_shape(mechanism: Mechanism) -> None:
    """Its columns have the motion's shape: (n,) over a record, (1,) in a simulation, or any other."""
    time = uniform_time(_SHORT)
    for sampled in (time, time[:1], time[:, np.newaxis]):
        checked(mechanism).terms(sample_motion(sampled), _thetas(mechanism)[0])


def is_finite(mechanism: Mechanism) -> None:
    """Its columns are finite for every theta inside the bounds."""
    for theta in [*_thetas(mechanism, searched=True), *_thetas(mechanism)]:
        checked(mechanism).terms(sample_motion(uniform_time()), theta)


def has_the_same_terms_for_every_theta(mechanism: Mechanism) -> None:
    """The number, order, names and units of its terms do not depend on theta."""
    motion = sample_motion(uniform_time(_SHORT))
    every = (checked(mechanism).terms(motion, theta) for theta in _thetas(mechanism, searched=True))
    signatures = {tuple((term.name, term.units) for term in terms) for terms in every}
    expect(len(signatures) == 1, f"the terms change with theta: {sorted(signatures)}")
    names = [name for name, _ in signatures.pop()]
    unknown = set(mechanism.characteristic) - set(names)
    expect(not unknown, f"`characteristic` names {sorted(unknown)}, which is none of the terms {names}")


def states_its_units(mechanism: Mechanism) -> None:
    """The unit of every coefficient can be read."""
    for term in mechanism.terms(sample_motion(uniform_time(_SHORT)), _thetas(mechanism)[0]):
        expect(is_unit(term.units), f"'{term.name}': '{term.units}' is not a unit; '1' is that of a pure number")


def is_elementwise(mechanism: Mechanism) -> None:
    """A part of the motion gives that part of the columns, so a simulated instant agrees with the record."""
    time, chosen = uniform_time(90), np.array([3, 4, 40, 77])
    for theta in _thetas(mechanism):
        whole, part = (_columns(mechanism.terms(sample_motion(times), theta)) for times in (time, time[chosen]))
        apart = _apart(whole, whole[..., chosen], part)
        found = f"four samples alone differ from the same four in a record by {apart:.1e} of the largest value; "
        expect(apart < 1e-9, found + "use each sample alone, and `motion.delayed` for the past")


def _apart(whole: FloatArray, one: FloatArray, other: FloatArray) -> float:
    """The largest difference of two, over the largest value of `whole`."""
    return float(np.max(np.abs(one - other)) / (np.max(np.abs(whole)) or 1.0))


def is_pure(mechanism: Mechanism) -> None:
    """The same motion gives the same columns, and the motion is left as it was."""
    motion = read_only(sample_motion(uniform_time(_SHORT)))
    for theta in _thetas(mechanism):
        first, again = (_columns(mechanism.terms(motion, theta)) for _ in range(2))
        expect(np.array_equal(first, again), "two calls with the same motion differ: let nothing be remembered")


def takes_the_meridian_as_an_angle(mechanism: Mechanism) -> None:
    """A whole turn of the windward meridian changes nothing."""

    def turned(motion: Motion) -> Motion:
        meridian = motion.windward_meridian + 2.0 * np.pi
        return replace(motion, windward_meridian=meridian, history=lambda tau: turned(motion.delayed(tau)))

    motion = sample_motion(uniform_time(_SHORT))
    for theta in _thetas(mechanism):
        before, after = (_columns(mechanism.terms(each, theta)) for each in (motion, turned(motion)))
        apart = _apart(before, before, after)
        found = f"adding 2 pi to the windward meridian moves a column by {apart:.1e} of its size; "
        expect(apart <= 1e-9, found + "use its sine, its cosine or differences")


def acts_on_the_moments(mechanism: Mechanism) -> None:
    """Every term moves a moment somewhere in the sample motion, at some Mach number of any flight."""
    motion = sample_motion(uniform_time())
    swept = replace(motion, mach=np.linspace(0.5, 25.0, motion.time.size))
    for term in mechanism.terms(swept, _thetas(mechanism)[-1]):
        found = f"'{term.name}' is zero throughout a motion of 2 to 4 deg, Mach 0.5 to 25, Reynolds 1e5 to 1e7"
        expect(bool(np.any(term.in_plane) or np.any(term.out_of_plane)), found)


def flags_its_delays(mechanism: Mechanism) -> None:
    """A parameter that reaches into the past is flagged as a delay, in a unit of time, and never into the future."""

    def requested(theta: Mapping[str, float]) -> list[float]:
        """The delays (s) at which `terms` requests the motion."""
        found: list[float] = []
        motion = sample_motion(uniform_time(_SHORT))

        def past(tau: float) -> Motion:
            found.append(tau)
            return motion.delayed(tau)

        mechanism.terms(replace(motion, history=past), theta)
        return found

    theta = _thetas(mechanism)[0]
    at_first = requested(theta)
    expect(min(at_first, default=0.0) >= 0.0, f"it requests the motion {-min(at_first, default=0.0)} s in the future")
    for parameter in mechanism.parameters():
        name, value = parameter.name, parameter.bounds[1]
        found = requested({**theta, name: value})
        moved = found != at_first
        flaw = "sets a delay: flag it" if moved else "sets no delay but is flagged"
        expect(moved == parameter.is_delay, f"'{name}' {flaw} (`is_delay`)")
        if parameter.is_delay:
            expect(parameter.bounds[0] >= 0.0, f"the delay '{name}' may become negative")
            seconds, earlier = value * parameter.seconds, ", ".join(f"{tau:g}" for tau in found)
            wrong = f"at '{name}' = {value:g} {parameter.units} it requests the motion {earlier} s earlier"
            expect(np.any(np.isclose(found, seconds, rtol=1e-9, atol=0.0)), f"{wrong}, not {seconds:g} s")


def has_sane_knots(mechanism: Mechanism) -> None:
    """Its knots, if it sets any, are increasing times inside the record."""
    motion = sample_motion(uniform_time())
    knots = checked(mechanism).knots(motion)
    if knots is None:
        return
    inside = (knots >= motion.time[0]) & (knots <= motion.time[-1])
    expect(np.all(np.diff(knots) > 0) and np.all(inside), f"knots outside the record or out of order: {knots}")


def derives_with_uncertainty(mechanism: Mechanism) -> None:
    """What it derives from coefficients is finite, has a unit, and its sigma follows the covariance."""
    terms = mechanism.terms(sample_motion(uniform_time(_SHORT)), _thetas(mechanism)[0])
    draw = np.random.default_rng(7)
    values = {t.name: float(value) for t, value in zip(terms, draw.normal(size=len(terms)), strict=True)}
    root = draw.normal(size=(len(terms), len(terms)))
    once, twice = (mechanism.derived(values, scale * root @ root.T) for scale in (1e-4, 4e-4))
    for one, four in zip(once, twice, strict=True):
        expect(np.isfinite(one.value), f"'{one.name}' is {one.value}")
        expect(is_unit(one.units), f"'{one.name}': '{one.units}' is not a unit")
        found = f"four times the covariance takes sigma from {one.std_error} to {four.std_error}, expected twice"
        expect(one.std_error >= 0.0 and np.isclose(four.std_error, 2.0 * one.std_error), f"'{one.name}': {found}")


def has_a_sane_tolerance(mechanism: Mechanism) -> None:
    """Its tolerance, if it has one, is a finite size of each term's coefficient, and no term has a parameter."""
    sizes = mechanism.tolerance(sample_flight())
    if sizes is None:
        return
    expect(not mechanism.parameters(), "a mechanism with a tolerance is linear: give it no parameters")
    terms = mechanism.terms(sample_motion(uniform_time(_SHORT)), {})
    sound = len(sizes) == len(terms) and all(np.isfinite(size) and size >= 0.0 for size in sizes)
    expect(sound, f"a tolerance of {sizes} for {len(terms)} terms: give each its 1-sigma size")


# In the order in which an author wants to read them.
MECHANISM_CHECKS: tuple[Callable[[Mechanism], None], ...] = (
    *(is_declared, documents_its_terms, is_configurable, varies_in_known_ways, has_sane_parameters),
    *(keeps_the_shape, is_finite, has_the_same_terms_for_every_theta, states_its_units, is_elementwise, is_pure),
    *(takes_the_meridian_as_an_angle, acts_on_the_moments, flags_its_delays, has_sane_knots),
    *(derives_with_uncertainty, has_a_sane_tolerance),
)


# ---- The checks of a record effect: a perturbation of the record that is small, pure and linear ----


def _channels(flight: Flight) -> FloatArray:
    """All that an effect may act on, (rows, samples): channels by their size in the sample, wind, place, inertia."""
    known = sample_flight()
    channels = [getattr(flight, name) / np.max(np.abs(getattr(known, name))) for name in CHANNELS]
    wind = np.zeros((3, flight.samples)) if flight.wind is None else flight.wind.T / 10.0  # m/s
    place = [value / 0.1 for value in flight.vehicle.accelerometer_position]  # m
    inertia = [flight.vehicle.ixx / known.vehicle.ixx, flight.vehicle.iyy / known.vehicle.iyy]
    constant = np.array([*place, *inertia])[:, np.newaxis] * np.ones(flight.samples)
    return np.concatenate([np.array(channels, dtype=float), wind, constant])


def _record() -> Flight:
    """The sample with a gap, of which some effects are."""
    flight = sample_flight()
    middle = flight.samples // 2
    return replace(flight, segments=((0, middle), (middle + _GAP, flight.samples)))


def _changes(effect: RecordEffect, share: float) -> Iterator[tuple[str, float, FloatArray]]:
    """Name and size of each component, and what a share of that changes in the sample's channels."""
    flight = _record()
    for name, _, size in effect.components(flight):
        yield name, size, _channels(effect.perturb(flight, name, share * size)) - _channels(flight)


def has_sane_components(effect: RecordEffect) -> None:
    """Each component has a name of its own, a unit and a typical size above zero."""
    components = effect.components(_record())
    names = [name for name, _, _ in components]
    expect(bool(names) and len(set(names)) == len(names), f"components need names, each its own: {names}")
    for name, units, size in components:
        expect(is_unit(units), f"'{name}': '{units}' is not a unit")
        expect(np.isfinite(size) and size > 0.0, f"'{name}': the typical size is {size}")


def leaves_the_record_alone_at_zero(effect: RecordEffect) -> None:
    """The value zero changes nothing."""
    for name, _, change in _changes(effect, 0.0):
        largest = np.max(np.abs(change))
        expect(largest < 1e-12, f"'{name}' = 0 changes the record by {largest:.1e} of its size")


def changes_the_record(effect: RecordEffect) -> None:
    """The typical size changes the record and leaves all finite; the number of samples stays."""
    for name, size, change in _changes(effect, 1.0):
        expect(np.isfinite(change).all(), f"'{name}' leaves values that are not finite")
        expect(np.any(change), f"'{name}' = {size} changes nothing")


def is_linear_for_small_values(effect: RecordEffect) -> None:
    """Half the typical size does half of what the typical size does, within 5 %."""
    for (name, size, whole), (_, _, half) in zip(_changes(effect, 1.0), _changes(effect, 0.5), strict=True):
        off = _apart(whole, whole, 2.0 * half)
        expect(off < 0.05, f"'{name}' departs from linear by {100 * off:.0f} % at its typical size {size}")


def leaves_its_input_alone(effect: RecordEffect) -> None:
    """The given record is left as it was, and the same call gives the same record."""
    flight = _record()
    for name, _, size in effect.components(flight):
        first, again = (_channels(effect.perturb(flight, name, size)) for _ in range(2))
        expect(np.array_equal(first, again), f"two calls with the same '{name}' differ")
        expect(np.array_equal(_channels(flight), _channels(sample_flight())), f"'{name}' writes into its input")


EFFECT_CHECKS: tuple[Callable[[RecordEffect], None], ...] = (
    *(is_declared, has_sane_components, leaves_the_record_alone_at_zero, changes_the_record),
    *(is_linear_for_small_values, leaves_its_input_alone),
)


def has_a_family_and_splines(process: Process) -> None:
    """It is of a known family, and has one spline, a constant, or at least four."""
    family, count = (getattr(process, key, None) for key in ("family", "splines"))
    expect(family in FAMILIES, f"`family` is {family!r}, expected one of {', '.join(FAMILIES)}")
    sound = isinstance(count, int) and (count == 1 or count >= 4)
    expect(sound, f"`splines` is {count!r}, expected 1, a constant, or at least 4, for they are cubic")


def has_an_estimated_size(process: Process) -> None:
    """Its amplitude is estimated: no tolerance bounds it, and nothing in it is nonlinear."""
    if isinstance(process, RecordEffect):
        expect(not process.carried, "`carried` is True: leave it out, every hypothesis has a process anyway")
    else:
        expect(process.tolerance(sample_flight()) is None, "it has a `tolerance`: leave it out, its size is estimated")
        expect(not process.parameters(), "it has parameters, but a process is linear: make one of each value")


def multiplies_shapes_by_splines(process: Process) -> None:
    """The terms of a process of the moment are shapes, each as long as the motion, times splines from start to stop."""
    if isinstance(process, RecordEffect):
        return
    process = process.model_copy(update={"start": 1.0, "stop": DURATION})
    time = uniform_time(_SHORT)[:, np.newaxis]
    motion, splines = sample_motion(time), time_splines(time, 1.0, DURATION, process.splines)
    shapes, columns = process.shapes(motion), _columns(process.terms(motion, {}))
    found = [np.shape(shape) for shape in shapes]
    expect(set(found) == {time.shape}, f"`shapes` have the shapes {found} for a motion of shape {time.shape}")
    products = np.array([shape * splines[..., k] for shape in shapes for k in range(process.splines)])
    same = len(columns) == len(products) and np.allclose(columns[:, 0] + 1j * columns[:, 1], products)
    expect(same, "its terms are not its shapes times the splines: write `shapes`, and no `terms`")


def _of_a_process(item: Mechanism | RecordEffect) -> Checks:
    own = (has_a_family_and_splines, has_an_estimated_size, multiplies_shapes_by_splines)
    return own if isinstance(item, Process) else ()


def relied_on(item: Mechanism | RecordEffect) -> Checks:
    """The checks that an analysis relies on, the others being for the author; each raises Nonconformity."""
    own = (is_declared, *_of_a_process(item))
    if isinstance(item, Mechanism):
        terms = (keeps_the_shape, has_the_same_terms_for_every_theta, is_finite)
        return (*own, has_sane_parameters, *terms, has_sane_knots, has_a_sane_tolerance)
    linear = (is_linear_for_small_values,) if isinstance(item, Process) else ()
    return (*own, has_sane_components, changes_the_record, *linear)


def checks_of(item: Mechanism | RecordEffect) -> Checks:
    """Every check that applies to an item."""
    return (*(MECHANISM_CHECKS if isinstance(item, Mechanism) else EFFECT_CHECKS), *_of_a_process(item))


def conformance(item: Mechanism | RecordEffect) -> tuple[CheckOutcome, ...]:
    """The outcome of every check, in order; none stops the others, and whatever one raises is its failure."""
    plain, outcomes = unchecked(item), []
    for check in checks_of(item):
        found = ""
        try:
            with np.errstate(all="ignore"):  # what is not finite is a finding, not a warning
                check(plain)
        except (Nonconformity, MechanismError) as broken:
            found = str(broken)
        except Exception as error:  # of foreign code
            found = f"it raised {type(error).__name__}: {error}"
        outcomes.append(CheckOutcome(check.__name__, not found, found))
    return tuple(outcomes)
