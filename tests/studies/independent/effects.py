"""Every effect that `trace` tries, planted into an independent flight at 3 to 10 times its limit in the record.

A moment, an error of an instrument or of the vehicle beside those that are drawn, a step of the wind. The limit (F of
25) counts the motion and the errors of record and vehicle as unknown, the latter within their tolerances: an instrument
has to be off by more than five of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.mechanisms import RecordEffect
from brv_hypo.mechanisms.registry import find, find_installed
from brv_hypo.tracing import Trace
from brv_hypo.tracing.families import RECORD_EFFECT_LARGEST
from brv_hypo.tracing.result import Baseline
from tests.studies.independent.dynamics import PAD
from tests.studies.independent.flights import Made, draw_flight, make_flight
from tests.studies.independent.instruments import Errors, inertia_tensor, no_errors
from tests.studies.independent.mechanisms import LISTED, THROUGHOUT, WIND_STEP, Planted
from tests.studies.independent.oracle import DETECTED
from tests.studies.independent.record_oracle import (
    baseline_state,
    f_ratio_of_error,
    f_ratio_of_moment,
    f_ratios_in_record,
)

TIMES = (3.0, 10.0)  # detection limits between which a size is drawn
# Tolerances that an instrument, the vehicle or the wind is off by at most: with what is drawn besides it stays
# below the most that the loop believes of any.
MOST = RECORD_EFFECT_LARGEST - 5.0
ROUGH = 0.5  # limits by which a size may miss: what is planted changes the motion that decides its limit
FIRST = 0.1  # of its nominal amplitude, at which a moment's limit is calculated
BENDING = "cubic_stiffness"
# Moments of the vehicle's own errors: a c.g. off the axis, a tilted principal axis.
VEHICLE = {"trim": "cg_offset", "dynamic_imbalance": "principal_axis"}
# What a baseline with a schedule has already; it is planted into a slope that nothing else changes.
SCHEDULED = ("mach_stiffness", "reynolds_stiffness")
_GYROS, _AXES = ("p", "q", "r"), ("x", "y", "z")
COMPONENTS = {
    "gyro_bias": _GYROS,
    "gyro_scale": _GYROS,
    "accel_bias": _AXES,
    "accel_scale": _AXES,
    "accel_position": _AXES,
    "time_skew": ("gyros",),
}
SECOND = 500_000  # of a pair the second moment is drawn under a seed of its own, so many further
ROUNDS = 2  # of sizing a pair: either moment changes the motion that decides the other's limit
EFFECTS = (*LISTED, "magnus", *THROUGHOUT, *VEHICLE, *COMPONENTS, WIND_STEP)
_SIZE = 13  # the stream of what is drawn here


@dataclass(frozen=True)
class Sized:
    """A flight with an effect, at how many detection limits in its record; `values` are what a trace should find (SI).

    They are by term or component; those of an instrument include what was drawn besides.
    """

    made: Made
    times: float
    values: dict[str, float]


def baseline_for(effect: str) -> Baseline:
    """What a trace that has to find the effect starts from."""
    return "constant" if effect in SCHEDULED else "scheduled"


def sized(seed: int, effect: str) -> Sized:
    """The flight of a seed with the effect.

    Raises RuntimeError or ValueError where none can be flown, or no effect so large.
    """
    plain, rng = draw_flight(seed, truth="none"), np.random.default_rng([seed, _SIZE])
    wanted = float(np.exp(rng.uniform(*np.log(TIMES))))
    if effect == WIND_STEP:
        found = _with_gust(plain, wanted, rng)
    elif effect in VEHICLE:
        found = _of_vehicle(plain, effect, wanted, rng)
    elif effect in COMPONENTS:
        found = _with_error(plain, effect, wanted, rng)
    else:
        found = _with_moment(plain, effect, wanted)
    if found.times < TIMES[0] - ROUGH:
        raise ValueError(f"at most {found.times:.1f} detection limits on this record")
    return found


def sized_pair(seed: int, first: str, second: str) -> tuple[Made, tuple[float, float]]:
    """The flight of a seed with two moments, each at 3 to 10 times its limit in the record beside the other.

    And how many times it is of either.

    Raises RuntimeError or ValueError where none can be flown, or one of them cannot be so large.
    """
    wanted = np.exp(np.random.default_rng([seed, _SIZE]).uniform(*np.log(TIMES), size=2))

    def flown(amplitudes: np.ndarray) -> tuple[Made, np.ndarray]:
        made = with_pair(seed, first, second, (float(amplitudes[0]), float(amplitudes[1])))
        return made, np.sqrt(np.array(f_ratios_in_record(made)) / DETECTED)

    amplitudes = np.full(2, FIRST)
    made, times = flown(amplitudes)
    for _ in range(ROUNDS):
        amplitudes = np.minimum(wanted * amplitudes / times, 1.0)
        made, times = flown(amplitudes)
    if min(times) < TIMES[0] - ROUGH:
        raise ValueError(f"at most {min(times):.1f} detection limits on this record")
    return made, (float(times[0]), float(times[1]))


def with_pair(seed: int, first: str, second: str, amplitudes: tuple[float, float]) -> Made:
    """The flight of a seed with two moments of these shares of their nominal amplitudes."""
    plain = draw_flight(seed, truth="none")
    craft, start = plain.true.craft, plain.true.start
    other = make_flight(craft, second, amplitudes[1], seed + SECOND, start=start).true.planted
    return make_flight(craft, first, amplitudes[0], seed, start=start, beside=other)


def deviations(found: Trace, sized: Sized, effect: str) -> tuple[float, ...]:
    """Errors of the sizes that a trace gives the effect, in standard errors; of jumps, those that it begins with.

    None where it has not the planted terms, each once: what is reported of others is not the size that was planted.
    """
    region = sized.made.true.region or (0.0, np.inf)
    middle, out = 0.5 * (region[0] + min(region[1], float(sized.made.true.time[-1]))), []
    for name, value in sized.values.items():
        own = [t for t in found.model.terms if t.mechanism == effect and t.name.removeprefix("jump in ") == name]
        own = [t for t in own if t.region_s is None or t.region_s[0] <= middle <= t.region_s[1]]
        if len(own) != 1:
            return ()
        out.append((own[0].value - value) / own[0].std_error)
    return tuple(out)


def _with_moment(plain: Made, effect: str, wanted: float) -> Sized:
    craft, start, seed = plain.true.craft, plain.true.start, plain.seed
    if effect in SCHEDULED:
        craft = replace(craft, stiffness_drift=0.0)
    region = (-2.0 * PAD, craft.duration + 2.0 * PAD) if effect == "magnus" else None

    def flown(amplitude: float) -> tuple[Made, float]:
        made = make_flight(craft, effect, amplitude, seed, region=region, start=start)
        (f_ratio,) = f_ratios_in_record(made, baseline_for(effect), bent=effect != BENDING)
        return made, float(np.sqrt(f_ratio / DETECTED))

    _, times = flown(FIRST)
    made, times = flown(min(wanted * FIRST / times, 1.0))
    return Sized(made, times, _values(made))


def _values(made: Made) -> dict[str, float]:
    """The coefficients of a moment, by the program's terms; none where it has no one number."""
    planted = made.true.planted
    size, angle = planted.amplitude, planted.values.get("angle", 0.0)
    return {
        "bodyfixed": {"C_b cos(phi_b)": size * np.cos(angle), "C_b sin(phi_b)": size * np.sin(angle)},
        "stiffness_asymmetry": {"pitch-yaw": size * np.cos(angle), "diagonal": size * np.sin(angle)},
        "damping": {"C_damping": size},
        "inplane": {"C_m0": size * planted.values.get("offset", 0.0), "C_malpha": size},
        "sticking": {"eps": size},
        "magnus": {"C_npalpha": size},
        BENDING: {"C_malpha3": size},
        "mach_damping": {"C_mq * Mach/10": size},
        "reynolds_damping": {"C_mq * log10(Re/1e6)": size},
    }.get(planted.name, {})


def _with_error(plain: Made, effect: str, wanted: float, rng: np.random.Generator) -> Sized:
    """One component, drawn of those that can be off by so many limits; else the one that shows first, at MOST."""
    item, state = find_installed(effect), baseline_state(plain.flight)
    assert isinstance(item, RecordEffect)
    tolerance = plain.flight.instruments.values()[effect][0]
    names = COMPONENTS[effect]
    ratios = [f_ratio_of_error(state, item, name, tolerance) for name in names]
    limits = tolerance * np.sqrt(DETECTED / np.array(ratios))
    fit = np.flatnonzero(wanted * limits <= MOST * tolerance)
    place = int(rng.choice(fit)) if fit.size else int(np.argmin(limits))
    size = min(wanted * limits[place], MOST * tolerance)
    errors = _further(plain.true.errors, effect, place, float(size * rng.choice([-1.0, 1.0])))
    made = _with_errors(plain, errors, effect)
    return Sized(made, float(size / limits[place]), _as_reported(made.true.errors, effect, place))


def _as_reported(errors: Errors, effect: str, place: int) -> dict[str, float]:
    """The whole error of a component, as a trace reports it."""
    whole = float(np.ravel(getattr(errors, effect))[place])
    if effect == "time_skew":
        return {"accelerometers": -whole}  # where the gyros are late: theirs is the record's clock
    if effect == "accel_position":
        whole -= float(np.array([0.0, *errors.cg_offset])[place])  # what they sense is where they are off the c.g.
    return {COMPONENTS[effect][place]: whole}


def _of_vehicle(plain: Made, effect: str, wanted: float, rng: np.random.Generator) -> Sized:
    """The c.g. lies off the axis along body y or z, or the principal axis is tilted about either."""
    key, item, place = VEHICLE[effect], find(effect), int(rng.integers(2))
    state, tolerance = baseline_state(plain.flight), plain.flight.instruments.values()[key][0]
    moment = _coefficients(plain, effect, no_errors().changed(key, place, tolerance))
    limit = tolerance * float(np.sqrt(DETECTED / f_ratio_of_moment(state, item, moment)))
    size = min(wanted * limit, MOST * tolerance)
    size = float(size * rng.choice([-1.0, 1.0]))
    errors = _further(plain.true.errors, key, place, size)
    if effect == "trim":  # accelerometers that kept their declared place would be as far off the c.g., and be found too
        errors = _further(errors, "accel_position", place + 1, size)
    made = _with_errors(plain, errors, key, "accel_position")
    names = [term.name for term in item.terms(state.data.frame.motions[0], {})]
    return Sized(made, abs(size) / limit, dict(zip(names, _coefficients(plain, effect, made.true.errors), strict=True)))


def _coefficients(plain: Made, effect: str, errors: Errors) -> tuple[float, float]:
    """C_m0 and C_n0 of the axial force on its lever; or -I_xz and I_xy over S d, elements of the tensor."""
    craft = plain.true.craft
    if effect == "trim":
        y, z = errors.cg_offset * craft.axial / craft.vehicle.reference_length
        return float(z), float(-y)
    tensor = inertia_tensor(craft.vehicle.ixx, craft.vehicle.iyy, errors)
    tensor = tensor / (craft.vehicle.reference_area * craft.vehicle.reference_length)
    return float(tensor[0, 2]), float(-tensor[0, 1])


def _further(errors: Errors, key: str, place: int, size: float) -> Errors:
    """The errors with one component further off."""
    return errors.changed(key, place, float(np.ravel(getattr(errors, key))[place]) + size)


def _with_errors(plain: Made, errors: Errors, *keys: str) -> Made:
    changed = {key: getattr(errors, key) for key in keys}
    return make_flight(plain.true.craft, seed=plain.seed, start=plain.true.start, errors=changed)


def _with_gust(plain: Made, wanted: float, rng: np.random.Generator) -> Sized:
    """A step of the wind across the track, in any direction; its limit is that of the direction that shows last."""
    craft, state = plain.true.craft, baseline_state(plain.flight)
    time, angle = float(rng.uniform(0.25, 0.7) * craft.duration), rng.uniform(-np.pi, np.pi)
    step = find_installed(WIND_STEP)
    assert isinstance(step, RecordEffect)
    step, tolerance = step.model_copy(update={"time": time}), plain.flight.instruments.wind[0]
    least = min(f_ratio_of_error(state, step, name, tolerance) for name in ("y", "z"))
    limit = tolerance * float(np.sqrt(DETECTED / least))
    size = min(wanted * limit, MOST * tolerance)
    pitch = craft.flight_path
    across = np.cos(angle) * np.array([0.0, 1.0, 0.0]) + np.sin(angle) * np.array([np.sin(pitch), 0.0, np.cos(pitch)])
    planted = Planted(WIND_STEP, size, time, craft.duration + 2.0 * PAD, {"across": tuple(across)})
    made = make_flight(craft, seed=plain.seed, start=plain.true.start, planted=planted)
    return Sized(made, size / limit, {})
