"""Channels that follow from others, and means of a record that is sampled far more finely than its motion needs.

Any planet: q_inf = rho V^2 / 2; Re = rho V d / mu, with d the reference length. The Earth alone (ICAO standard
atmosphere, by `ambiance`): density from altitude, altitude from density, speed of sound and viscosity. It ends at
81 km: above, density is never extrapolated, and the temperature of its end is that for Mach and Reynolds numbers.

Means lose nothing of what white noise lets the data say. All channels are damped alike, by (pi / n)^2 / 6 where n
samples are left to a cycle: 2e-4 of the fastest motion at `AVERAGED_PER_CYCLE`, in rates as in accelerations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.clock import transverse_frequency
from brv_hypo.flight.record import Channels, Flight
from brv_hypo.thresholds import PRESSURE_CONSISTENT

AVERAGED_PER_CYCLE = 96  # samples left to a cycle of the fastest motion
AVERAGED_BEYOND = 20_000  # samples up to which a record is analysed as it is; bounds the time
AVERAGED_LEFT = 4_000  # samples left of a longer one at least

# Notes of what follows from the speed, and so is no witness of its units.
DENSITY_FOLLOWS = "density derived from dynamic pressure and velocity"
PRESSURE_FOLLOWS = "dynamic pressure derived from density and velocity"
ALTITUDE_FOLLOWS = "altitude derived as that of the density"

LOWEST_ALTITUDE = -5000.0
HIGHEST_ALTITUDE = 81000.0
# Where the temperature's gradient changes, m of geopotential altitude, and the radius that makes them geometric (ICAO).
_LAYERS = np.array([0.0, 11e3, 20e3, 32e3, 47e3, 51e3, 71e3])
_EARTH_RADIUS = 6356766.0


def derive(channels: Mapping[str, FloatArray], planet: str, reference_length: float) -> tuple[Channels, list[str]]:
    """The channels (n,) with those derived added, NaN where a source is NaN, and a note for each. `reference_length` in
    m. What cannot be derived stays absent; a note says why.
    """
    known = dict(channels)
    notes = []
    if {"dynamic_pressure", "density", "velocity"} <= set(known):
        computed = 0.5 * known["density"] * known["velocity"] ** 2
        usable = computed > 0.0
        ratios = known["dynamic_pressure"][usable] / computed[usable]
        ratio = float(np.nanmedian(ratios)) if ratios.size else 1.0
        if abs(ratio - 1.0) > PRESSURE_CONSISTENT:  # units, or different sources
            said = f"recorded dynamic pressure is {ratio:.4g} times density * velocity^2 / 2"
            notes.append(f"{said}: check their units")
    earth = planet == "earth"
    if "density" not in known and "dynamic_pressure" in known:
        moving = np.where(known["velocity"] > 0.0, known["velocity"], np.nan)
        known["density"] = np.asarray(2.0 * known["dynamic_pressure"] / moving**2)
        notes.append(DENSITY_FOLLOWS)
    if earth and "density" not in known and "altitude" in known:
        known["density"] = atmosphere(known["altitude"], "density")
        beyond = _beyond(known["altitude"])
        notes.append(f"density derived from altitude by the Earth standard atmosphere{beyond}")
    if "dynamic_pressure" not in known and "density" in known:
        known["dynamic_pressure"] = 0.5 * known["density"] * known["velocity"] ** 2
        notes.append(PRESSURE_FOLLOWS)
    wanted = [name for name in ("altitude", "mach", "reynolds") if name not in known]
    if wanted and not earth:
        notes.append(
            f"{', '.join(wanted)} missing and not derived: the planet is {planet}, and the only atmosphere "
            "model is Earth's"
        )
    if not (wanted and earth and "density" in known):
        return known, notes
    if "altitude" in wanted:
        # Log-linear on a 50 m grid and at the bends between layers, within 0.1 m of the exact inverse; else the ends.
        bends = _EARTH_RADIUS * _LAYERS / (_EARTH_RADIUS - _LAYERS)
        grid = np.union1d(np.arange(LOWEST_ALTITUDE, HIGHEST_ALTITUDE + 1.0, 50.0), bends)
        with np.errstate(divide="ignore"):
            fallen = -np.log(known["density"])
        known["altitude"] = np.interp(fallen, -np.log(atmosphere(grid, "density")), grid)
        beyond = _beyond(known["altitude"])
        notes.append(f"{ALTITUDE_FOLLOWS} in the Earth standard atmosphere{beyond}")
    end = np.clip(known["altitude"], LOWEST_ALTITUDE, HIGHEST_ALTITUDE)
    outside = _beyond(known["altitude"]) and ", with the temperature of its end where the flight is beyond it"
    if "mach" in wanted:
        known["mach"] = known["velocity"] / atmosphere(end, "speed_of_sound")
        notes.append(f"Mach number derived with the speed of sound of the Earth standard atmosphere{outside}")
    if "reynolds" in wanted:
        viscosity = atmosphere(end, "dynamic_viscosity")
        known["reynolds"] = known["density"] * known["velocity"] * reference_length / viscosity
        notes.append(f"Reynolds number derived with the viscosity of the Earth standard atmosphere{outside}")
    return known, notes


def atmosphere(altitude: FloatArray, quantity: str) -> FloatArray:
    """`quantity`, such as "density", of the Earth standard atmosphere at `altitude` (n,) m, SI; NaN beyond its ends."""
    from ambiance import Atmosphere

    result = np.full(altitude.shape, np.nan)
    inside = (altitude >= LOWEST_ALTITUDE) & (altitude <= HIGHEST_ALTITUDE)
    if np.any(inside):
        result[inside] = getattr(Atmosphere(altitude[inside]), quantity)
    return result


def _beyond(altitude: FloatArray) -> str:
    """What to say of samples beyond the ends of the standard atmosphere; empty where there are none."""
    outside = int(np.count_nonzero((altitude <= LOWEST_ALTITUDE) | (altitude >= HIGHEST_ALTITUDE)))
    return f" ({outside} samples lie beyond its range of -5 to 81 km)" if outside else ""


def averaged(flight: Flight) -> Flight:
    """The flight as means of as many samples as its motion can spare; itself where it is short, or has few to spare."""
    # Of the fastest motion in body axes, coning or spin, a cycle keeps enough.
    coning, spin = transverse_frequency(flight.q, flight.r, flight.step), np.max(np.abs(flight.p)) / (2.0 * np.pi)
    fastest = max(coning, float(spin))
    spare = int(flight.sample_rate / (AVERAGED_PER_CYCLE * fastest)) if fastest > 0.0 else 1
    every = min(spare, flight.samples // AVERAGED_LEFT)
    if flight.samples <= AVERAGED_BEYOND or every < 2:
        return flight
    ranges = ((-(-a // every), b // every) for a, b in flight.segments)
    segments = tuple((first, last) for first, last in ranges if first < last)
    if not segments:
        return flight
    arrays: dict[str, Any] = {}
    for name, values in flight.arrays().items():
        whole = values[: values.shape[0] // every * every]
        arrays[name] = np.asarray(whole.reshape(-1, every, *values.shape[1:]).mean(axis=1), dtype=float)
    rate = flight.sample_rate / every
    note = f"analysed as means of {every} samples each, at {rate:.6g} Hz: the motion needs no more"
    return replace(flight, segments=segments, notes=(*flight.notes, note), **arrays)
