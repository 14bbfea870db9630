"""Flights of the independent simulation: `make_flight` for one case, `draw_flight` for a case from a seed.

By hand: python -m tests.studies.independent.flights --seed 1 --flights 4 -o DIR
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from brv_hypo.flight.record import Flight
from brv_hypo.flight.tolerances import of_grade
from tests.studies.independent.air import atmosphere, sound_speed, viscosity
from tests.studies.independent.dynamics import PAD, Body, History, Snapshot, flown, stack
from tests.studies.independent.imperfections import ordinary
from tests.studies.independent.instruments import (
    GRADES,
    Errors,
    Noise,
    draw_errors,
    no_errors,
    sensed_force,
    sensed_rates,
)
from tests.studies.independent.mechanisms import THROUGHOUT, TRUTHS, Planted
from tests.studies.independent.vehicles import CRAFTS, Craft, Start, draw_start

SHARE = (0.1, 0.4)  # of the moment's rms, that a nominal amplitude changes in its region
LARGEST_GROWTH = 0.7  # e-folds that a nominal amplitude may add to the coning over its region
SMALLEST_AMPLITUDE = 3e-3  # of a nominal one, drawn by `draw_flight`
# What feeds or brakes the coning in proportion to it, rather than pushing it.
_GROWING = ("damping", "lag", "sticking", "magnus", "vortex", "mach_damping", "reynolds_damping")
OF_AN_INERTIAL_UNIT = (
    *("gyro_bias", "gyro_scale", "gyro_misalignment", "time_skew"),
    *("accel_bias", "accel_scale", "accel_misalignment", "accel_position"),
)
_STREAMS = {"start": 1, "mechanism": 2, "errors": 3, "noise": 4, "imperfections": 6}


@dataclass(frozen=True)
class TrueMotion:
    """What was so at the record's times, SI; moments and contributions complex.

    `moment` is C_m + i C_n of all, about the stated c.g.; `turning` what turns the stated inertias, trim and imbalance
    with it; `contribution` C_N' + i C_Z' of what is planted, `parts` that
    of each effect (n, effects), `claim` that of the first, region or no. `share`
    is the contribution's rms in its region over the moment's rms over the record, `nominal_share` what amplitude 1
    was meant to give.
    """

    time: np.ndarray
    alpha: np.ndarray
    meridian: np.ndarray
    meridian_rate: np.ndarray
    alpha_rate: np.ndarray
    velocity: np.ndarray
    mach: np.ndarray
    altitude: np.ndarray
    dynamic_pressure: np.ndarray
    static_slope: np.ndarray  # at alpha = 0
    rates: np.ndarray
    force: np.ndarray
    moment: np.ndarray
    turning: np.ndarray
    contribution: np.ndarray
    parts: np.ndarray
    claim: np.ndarray
    planted: Planted
    errors: Errors
    craft: Craft
    start: Start
    noise: Noise
    share: float
    nominal_share: float

    def static(self, alpha: np.ndarray) -> np.ndarray:
        """Static moment (n,) at angles of attack (n,) at the record's times."""
        craft = self.craft
        return np.asarray(self.static_slope * alpha * craft.bent(craft.static_bend, alpha))

    @property
    def region(self) -> tuple[float, float] | None:
        """Where the contribution acts, s."""
        return None if self.planted.name == "none" else (self.planted.start, self.planted.stop)


@dataclass(frozen=True)
class Made:
    """One flight with what is true of it."""

    flight: Flight
    truth: str
    amplitude: float
    vehicle: str
    seed: int
    grade: str
    true: TrueMotion

    def truth_group(self) -> dict[str, Any]:
        """For `save_flight`."""
        true = self.true
        values = {
            "mechanism": self.truth,
            "vehicle": self.vehicle,
            "grade": self.grade,
            "seed": self.seed,
            "amplitude": self.amplitude,
            "share": true.share,
            "alpha": true.alpha,
            "meridian": true.meridian,
            "C_m": true.moment.real,
            "C_n": true.moment.imag,
            "planted_in_plane": true.contribution.real,
            "planted_out_of_plane": true.contribution.imag,
            "errors": true.errors.values(),
            "values": {"amplitude": true.planted.amplitude, **true.planted.values},
        }
        return values if true.region is None else {**values, "region_s": np.array(true.region)}


def make_flight(
    vehicle: str | Craft,
    truth: str = "none",
    amplitude: float = 1.0,
    seed: int = 0,
    grade: str = "tactical",
    factor: float | Mapping[str, float] = 1.0,
    *,
    errors: Mapping[str, Any] | None = None,
    noise: Noise = Noise(),  # noqa: B008 - immutable
    noise_factor: float = 1.0,
    duration: float | None = None,
    sample_rate: float | None = None,
    region: tuple[float, float] | None = None,
    values: Mapping[str, Any] | None = None,
    start: Start | None = None,
    beside: Planted | None = None,
    planted: Planted | None = None,
    imperfect: tuple[str, ...] = (),
    imperfect_size: float = 1.0,
    unit: int = 0,
) -> Made:
    """Fly and record one case.

    `amplitude` times the nominal amplitude that the seed draws (SHARE of the moment's rms); `factor` times the
    grade's tolerances, a number or a mapping by key; `errors` sets actual errors by key, SI (a number fills the
    vector); `region`, `values` (angle, delay, ...) and `start` replace what is drawn; `beside` acts as well; `planted`
    in place of all that would be drawn; `imperfect` names kinds of `imperfections.KINDS`, at `imperfect_size` times
    their ordinary size. The same seed gives the same start, errors and noise whatever is planted; an inertial `unit`
    with another number has errors and noise of its own.
    """
    if truth not in (*TRUTHS, *THROUGHOUT):
        raise ValueError(f"got the truth '{truth}', expected one of {', '.join((*TRUTHS, *THROUGHOUT))}")
    craft = CRAFTS[vehicle] if isinstance(vehicle, str) else vehicle
    craft = replace(craft, duration=duration or craft.duration, sample_rate=sample_rate or craft.sample_rate)
    start = start or draw_start(craft, stream(seed, "start"))
    drawn = draw_errors(grade, factor, stream(seed, "errors"), errors)
    if unit:
        other = draw_errors(grade, factor, stream(seed, "errors", unit), errors)
        drawn = replace(drawn, **{key: getattr(other, key) for key in OF_AN_INERTIAL_UNIT})
    noise = noise.times(noise_factor)
    time = np.arange(round(craft.duration * craft.sample_rate) + 1) / craft.sample_rate
    share = 0.0
    if planted is None:
        nominal, share = _nominal(craft, start, truth, time, stream(seed, "mechanism"), region, values)
        planted = replace(nominal, amplitude=amplitude * nominal.amplitude, beside=beside)
    flaws = ordinary(craft, imperfect, stream(seed, "imperfections"), imperfect_size) if imperfect else None
    if flaws is not None:
        planted = replace(planted, onset=flaws.onset)
    body = flown(craft, start, drawn, planted, max(PAD, 1.5 * abs(drawn.time_skew)), flaws)
    true = _truth(body, time, drawn, noise, share)
    rng = stream(seed, "noise", unit)
    flight = _record(true, body.history, grade, rng, f"independent {craft.name}, seed {seed}")
    if flaws is not None:
        flight = flaws.recorded(flight, rng, (noise.gyro, noise.accel))
    return Made(flight, planted.name, amplitude, craft.name, seed, grade, true)


def draw_flight(seed: int, **options: Any) -> Made:
    """A case from the seed: vehicle, truth and amplitude (log-uniform) are drawn where `options` leave them."""
    rng = np.random.default_rng([seed, 0])
    vehicle, truth = rng.choice(sorted(CRAFTS)), rng.choice(TRUTHS)
    amplitude = float(np.exp(rng.uniform(np.log(SMALLEST_AMPLITUDE), 0.0)))
    drawn = {"vehicle": str(vehicle), "truth": str(truth), "amplitude": amplitude}
    return make_flight(**{**drawn, "seed": seed, **options})


def stream(seed: int, purpose: str, unit: int = 0) -> np.random.Generator:
    return np.random.default_rng([seed, _STREAMS[purpose], *([unit] if unit else [])])


def _nominal(
    craft: Craft,
    start: Start,
    truth: str,
    time: np.ndarray,
    rng: np.random.Generator,
    region: tuple[float, float] | None,
    values: Mapping[str, Any] | None,
) -> tuple[Planted, float]:
    """The mechanism at amplitude 1, and the share of the moment's rms that it was sized for."""
    share, span = rng.uniform(*SHARE), craft.duration
    begin = rng.uniform(0.15, 0.45) * span
    if truth in THROUGHOUT:
        region = region or (-2.0 * PAD, span + 2.0 * PAD)
    first, last = region or (begin, min(begin + rng.uniform(0.25, 0.45) * span, 0.95 * span))
    angle, sign, other_sign, turn = (
        rng.uniform(-np.pi, np.pi),
        rng.choice([-1.0, 1.0]),
        rng.choice([-1.0, 1.0]),
        rng.uniform(0.3, 0.9),
    )
    if truth == "none":
        return Planted(), 0.0
    if truth == "mach_step" and region is None:
        last = span + PAD
    plain = flown(craft, start, no_errors(), Planted())
    if truth in _GROWING:
        share = min(share, 2.0 * LARGEST_GROWTH / (plain.frequency * (last - first)))
    snapshots = [plain.snapshot(float(t), state) for t, state in zip(time, plain.history.many(time), strict=True)]
    alpha, rate = _of_running(snapshots, "alpha"), _of_running(snapshots, "meridian_rate")
    # The meridian's rate where the moment is large: at alpha = 0 it has no bound.
    meridian_rate = math.sqrt(np.mean((alpha * rate) ** 2) / np.mean(alpha**2))
    mach_at = np.interp([first, first + 0.1 * span], time, stack(snapshots, "mach"))
    drawn: dict[str, dict[str, float]] = {
        "bodyfixed": {"angle": angle},
        "rotating": {"angle": angle},
        "third_harmonic": {"angle": angle},
        "stiffness_asymmetry": {"angle": angle},
        "sticking": {"delay": turn / meridian_rate},
        "inplane": {"offset": float(other_sign * np.sqrt(np.mean(alpha**2))), "slope": 1.0},
        "mach_step": {"mach": float(mach_at[1]), "width": float(abs(mach_at[1] - mach_at[0]) / 3.0)},
        **{f"mach_{what}": {"mach": snapshots[0].running.mach} for what in ("stiffness", "damping")},
        **{f"reynolds_{what}": {"decades": snapshots[0].running.decades} for what in ("stiffness", "damping")},
    }
    # All but the lag are linear in their amplitude; it nearly is where it starts from.
    unit_amplitude = share / meridian_rate if truth == "lag" else 1.0
    unit = Planted(truth, unit_amplitude, first, last, {**drawn.get(truth, {}), **(values or {})})
    inside = (time >= first) & (time < last)
    made = [unit.claim(snapshot.running) for snapshot, use in zip(snapshots, inside, strict=True) if use]
    moment = np.sqrt(np.mean(np.abs(stack(snapshots, "moment")) ** 2))
    size = unit_amplitude * share * moment / np.sqrt(np.mean(np.abs(made) ** 2))
    # What lags or sticks trails; everything else is as likely of either sign.
    return replace(unit, amplitude=float(size if truth in ("lag", "sticking") else sign * size)), share


def _of_running(snapshots: list[Snapshot], name: str) -> np.ndarray:
    return np.array([getattr(snapshot.running, name) for snapshot in snapshots])


def _truth(body: Body, time: np.ndarray, errors: Errors, noise: Noise, nominal_share: float) -> TrueMotion:
    states = body.history.many(time)
    snapshots = [body.snapshot(float(t), state) for t, state in zip(time, states, strict=True)]
    rates, change, force = (stack(snapshots, name) for name in ("rates", "rates_change", "force"))
    # The accelerometers are off the stated c.g.; the vehicle turns about the true one.
    arm = np.array(body.craft.vehicle.accelerometer_position) + errors.accel_position - np.array(body.centre)
    force = force + np.cross(change, arm) + np.cross(rates, np.cross(rates, arm))
    moment, contribution = stack(snapshots, "moment"), stack(snapshots, "contribution")
    vehicle, pressure = body.craft.vehicle, stack(snapshots, "dynamic_pressure")
    across, turned = rates[:, 1] + 1j * rates[:, 2], change[:, 1] + 1j * change[:, 2]
    turning = vehicle.iyy * turned + 1j * (vehicle.iyy - vehicle.ixx) * rates[:, 0] * across  # Euler's equations
    turning /= pressure * vehicle.reference_area * vehicle.reference_length
    acting = np.abs(contribution) > 0.0
    rms = np.sqrt(np.mean(np.abs(moment) ** 2))
    share = float(np.sqrt(np.mean(np.abs(contribution[acting]) ** 2)) / rms) if np.any(acting) else 0.0
    return TrueMotion(
        time=time,
        alpha=stack(snapshots, "alpha"),
        meridian=np.unwrap(stack(snapshots, "meridian")),
        meridian_rate=_of_running(snapshots, "meridian_rate"),
        alpha_rate=_of_running(snapshots, "alpha_rate"),
        velocity=stack(snapshots, "speed"),
        mach=stack(snapshots, "mach"),
        altitude=-states[:, 2],
        dynamic_pressure=pressure,
        static_slope=np.array([body.static_slope(snapshot.speed) for snapshot in snapshots]),
        rates=rates,
        force=force,
        moment=moment,
        turning=turning,
        contribution=contribution,
        parts=_parts(body.planted, snapshots),
        claim=np.array([body.planted.claim(snapshot.running) for snapshot in snapshots]),
        planted=body.planted,
        errors=errors,
        craft=body.craft,
        start=body.start,
        noise=noise,
        share=share,
        nominal_share=nominal_share,
    )


def _parts(planted: Planted, snapshots: list[Snapshot]) -> np.ndarray:
    """What each of the planted effects contributes (n, effects)."""
    running = [snapshot.running for snapshot in snapshots]
    return np.array([[part.claim(now) * part.weight(now.time) for part in planted.parts] for now in running])


def _record(true: TrueMotion, history: History, grade: str, rng: np.random.Generator, title: str) -> Flight:
    """What the instruments write down."""
    noise, errors, time = true.noise, true.errors, true.time
    vehicle = true.craft.vehicle
    rates = sensed_rates(lambda times: history.many(times)[:, 10:13], time, errors)
    rates = rates + noise.gyro * noise.inertial(rng, time.size)
    force = sensed_force(true.force, errors) + noise.accel * noise.inertial(rng, time.size)
    velocity = true.velocity + noise.velocity * rng.standard_normal(time.size)
    scale = 1.0 + errors.dynamic_pressure_scale
    pressure = true.dynamic_pressure * scale * (1.0 + noise.dynamic_pressure * rng.standard_normal(time.size))
    altitude = true.altitude + noise.altitude * rng.standard_normal(time.size)
    density = 2.0 * pressure / velocity**2
    warmth = [atmosphere(float(height))[1] for height in altitude]
    sound = np.array([sound_speed(value) for value in warmth])
    thickness = np.array([viscosity(value) for value in warmth])
    return Flight(
        time=time,
        p=rates[:, 0],
        q=rates[:, 1],
        r=rates[:, 2],
        ax=force[:, 0],
        ay=force[:, 1],
        az=force[:, 2],
        velocity=velocity,
        dynamic_pressure=pressure,
        vehicle=vehicle,
        altitude=altitude,
        density=density,
        mach=velocity / sound,
        reynolds=density * velocity * vehicle.reference_length / thickness,
        instruments=of_grade(grade),
        title=title,
        source="independent simulation",
    )


def main(arguments: list[str] | None = None) -> int:
    """Write flights for use by hand, one line each."""
    from brv_hypo.flight.format import save_flight

    parser = argparse.ArgumentParser(description="Flights of the independent simulation, as HDF5.")
    parser.add_argument("--seed", type=int, default=0, help="of the first flight; the next has the next")
    parser.add_argument("--flights", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    parser.add_argument("--vehicle", choices=sorted(CRAFTS))
    parser.add_argument("--truth", choices=TRUTHS)
    parser.add_argument("--amplitude", type=float, help="of the nominal one")
    parser.add_argument("--grade", choices=GRADES, default="tactical")
    parser.add_argument("--factor", type=float, default=1.0, help="errors in tolerances of the grade")
    chosen = parser.parse_args(arguments)
    options = {
        name: value
        for name in ("vehicle", "truth", "amplitude", "grade", "factor")
        if (value := getattr(chosen, name)) is not None
    }
    chosen.output.mkdir(parents=True, exist_ok=True)
    for seed in range(chosen.seed, chosen.seed + chosen.flights):
        made = draw_flight(seed, **options)
        path = chosen.output / f"{made.vehicle}_{made.truth}_{seed}.h5"
        save_flight(made.flight, path, truth=made.truth_group(), overwrite=True)
        print(f"{path}  amplitude {made.amplitude:.4g}, share of moment {made.true.share:.4g}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
