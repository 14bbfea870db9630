"""How often what comes in is right, said to be unsure, or named as wrong: `python -m tests.studies.soundness`.

Rockets of tests.importing.rockets lean by 1 to 15 deg (of the speeds: 1 to 30), rest for 0.3 to 3 s and spin. Guesses:
the unit's axes are swapped and reversed at random and turned by up to 5 deg, names lack units, or lie. Mistakes: one
wrong unit, sign, axis or mounting in the whole log, and in its coast. Coasts: altitudes in wrong units where nothing
else says the speed. Speeds: share of samples within 1.96 sigma.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from brv_hypo.errors import BrvHypoError
from brv_hypo.flight.plausibility import contradictions, nose_axis
from brv_hypo.flight.record import ACCELEROMETERS, GYROS
from brv_hypo.flight.units import to_si
from brv_hypo.importing import bring_in
from brv_hypo.importing.guess import Guess, guess_map
from brv_hypo.importing.rocket_log import ascent, take_out_biases
from brv_hypo.motion import try_record
from tests.importing.rockets import Log, fly
from tests.importing.test_foreign import write_csv, write_map
from tests.studies.independent.imperfect_study import count

UNITS = {"time": {"s": 1.0, "ms": 1e-3}, "gyro": {"rad/s": 1.0, "deg/s": np.pi / 180.0, "rpm": np.pi / 30.0},
         "acc": {"m/s^2": 1.0, "g": 9.80665, "ft/s^2": 0.3048}, "alt": {"m": 1.0, "ft": 0.3048}}  # fmt: skip
FEET, DEGREE, G = 0.3048, np.pi / 180.0, 9.80665


def tilted(rng: Any, degrees: float) -> Any:
    """A turn by so much about any axis across the nose."""
    angle = rng.uniform(0, 2 * np.pi)
    return Rotation.from_rotvec(np.radians(degrees) * np.array([0.0, np.cos(angle), np.sin(angle)])).as_matrix()


def foreign(log: Log, rng: Any) -> dict[str, Any]:
    """Columns as some recorder writes them."""
    axes = np.eye(3)[rng.permutation(3)] * rng.choice((-1.0, 1.0), 3)[:, None]
    axes[0] *= np.linalg.det(axes)
    read = log.read(rng, axes @ tilted(rng, rng.uniform(0.0, 5.0)))
    units = {kind: str(rng.choice(list(sizes))) for kind, sizes in UNITS.items()}
    sign = rng.choice((-1.0, 1.0), p=(0.2, 0.8))  # of all accelerometers
    words = {kind: {"right": f"_{unit}", "none": "", "wrong": f"_{rng.choice(list(UNITS[kind]))}"}[
        rng.choice(("right", "none", "wrong"), p=(0.5, 0.3, 0.2))] for kind, unit in units.items()}  # fmt: skip
    columns = {f"time{words['time']}": read["time"] / UNITS["time"][units["time"]]}
    for kind, triad, factor in (("gyro", GYROS, 1.0), ("acc", ACCELEROMETERS, sign)):
        for axis, name in zip("xyz", triad, strict=True):
            columns[f"{kind}_{axis}{words[kind]}"] = factor * read[name] / UNITS[kind][units[kind]]
    return {**columns, f"alt{words['alt']}": read["altitude"] / UNITS["alt"][units["alt"]]}


def wrong(guess: Guess, columns: dict[str, Any], log: Log) -> list[str]:
    """Which of nose, rates and altitude a guess has wrong; a turn about the nose and a mirror are conventions."""
    mapping = yaml.safe_load(guess.text)
    entries = mapping["channels"]
    units = {**dict.fromkeys(GYROS, "angular rate"), **dict.fromkeys(ACCELEROMETERS, "acceleration")}
    found = {}
    for name, dimension in {**units, "altitude": "length"}.items():
        entry = entries[name]
        found[name] = to_si(entry.get("scale", 1.0) * columns[entry["column"]], entry["units"], dimension, name)
    if mapping.get("rotation") == "auto":
        nose = nose_axis(log.time, *(np.stack([found[name] for name in triad]) for triad in (GYROS, ACCELEROMETERS)))
        for triad in (GYROS, ACCELEROMETERS):
            found |= dict(zip(triad, nose.matrix @ np.stack([found[name] for name in triad]), strict=True))
    maps = [np.linalg.lstsq(truth.T, np.stack([found[name] for name in triad]).T, rcond=None)[0].T
            for triad, truth in ((ACCELEROMETERS, log.forces), (GYROS, log.rates))]  # fmt: skip
    bad = ["nose"] if not 0.9 < maps[0][0, 0] < 1.1 or np.linalg.norm(maps[0][0, 1:]) > 0.2 else []
    bad += ["rates"] if not np.allclose(maps[1], np.linalg.det(maps[0]) * maps[0], atol=0.25) else []
    rise = np.ptp(found["altitude"]) / np.ptp(log.altitude)
    return bad + (["altitude"] if not 0.9 < rise < 1.1 else [])


def is_unsure(guess: Guess, what: str) -> bool:
    """Whether a guess doubts what it has of nose, rates or altitude."""
    words = {"nose": ("ax:", "axes", "rest"), "rates": ("p:", "gyros"), "altitude": ("altitude",)}[what]
    return any(word in doubt for doubt in guess.unsure for word in words)


ANY = (*GYROS, *ACCELEROMETERS)
MISTAKES: dict[str, tuple[float, Sequence[str], Sequence[str]]] = {  # factor, channels, and what is read in them
    "sound": (1.0, (), ()),
    "altitude: feet as metres": (1.0 / FEET, ("altitude",), ("altitude",)),
    "altitude: metres as feet": (FEET, ("altitude",), ("altitude",)),
    "accelerometers: g as m/s^2": (1.0 / G, ACCELEROMETERS, ACCELEROMETERS),
    "accelerometers: m/s^2 as ft/s^2": (FEET, ACCELEROMETERS, ACCELEROMETERS),
    "gyros: deg/s as rad/s": (1.0 / DEGREE, GYROS, GYROS),
    "gyros: rad/s as deg/s": (DEGREE, GYROS, GYROS),
    "nose on y": (1.0, ANY, ("q", "r", "p", "ay", "az", "ax")),
    "ax reversed": (-1.0, ("ax",), ("ax",)),
    "p reversed": (-1.0, ("p",), ("p",)),
    "q reversed": (-1.0, ("q",), ("q",)),
    "q and r exchanged": (1.0, ("q", "r"), ("r", "q")),
    "turned by 3 deg": (1.0, (), ()),
    "turned by 45 deg": (1.0, (), ()),
}


def mistaken(log: Log, name: str, rng: Any) -> dict[str, Any]:
    """What a recorder writes with one of the mistakes."""
    turns = {"turned by 3 deg": 3.0, "turned by 45 deg": 45.0}
    read = log.read(rng, tilted(rng, turns.get(name, 0.0)))
    factor, channels, sources = MISTAKES[name]
    return read | {channel: factor * read[source] for channel, source in zip(channels, sources, strict=True)}


def log_map(log: Log) -> dict[str, Any]:
    """A map for what `Log.read` gives."""
    units = {"time": "s", **dict.fromkeys(GYROS, "rad/s"), **dict.fromkeys(ACCELEROMETERS, "m/s^2"), "altitude": "m"}
    sizes = dict(zip(log.vehicle, ("kg", "kg*m^2", "kg*m^2", "m", "m^2"), strict=True))
    return {
        "channels": {name: {"column": name, "units": unit} for name, unit in units.items()},
        "vehicle": {name: {"value": float(log.vehicle[name]), "units": unit} for name, unit in sizes.items()},
        "instruments": {"grade": "industrial", "accel_position": [0.5, 0.02, 0.02]},
        "pad": [float(log.time[0]), -0.05],
        "derive": {"velocity": "ascent"},
        "window": "coast",
        "rate": "auto",
    }


def named(log: Log, read: dict[str, Any], folder: Path) -> list[str]:
    """The kinds of decisive faults that import and the compatibility check find in a log; what import refuses."""
    try:
        flight = bring_in(write_csv(folder / "a.csv", read), write_map(folder, log_map(log))).flight
    except BrvHypoError as error:
        return [f"refused: {error}"]
    return [f"{fault.fault}: {fault.action}" for fault in try_record(flight)[1].faults if fault.decisive]


def bends(log: Log, read: dict[str, Any], factor: float) -> bool:
    """Whether units of altitude that are off by a factor are named in the coast alone, whose speed nothing says."""
    coast = np.flatnonzero(log.time > log.time[np.argmax(log.speed)] + 1.0)
    channels = {name: values[coast] for name, values in read.items()}
    return bool(contradictions(channels.pop("time"), channels | {"altitude": factor * channels["altitude"]}))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m tests.studies.soundness", description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--flights", type=int, default=50)
    parser.add_argument("--guesses", action="store_true", help="guesses, coasts and speeds alone: no mistakes")
    options = parser.parse_args(arguments)
    rng = np.random.default_rng(options.seed)
    logs = [fly(seed) for seed in np.random.SeedSequence(options.seed).generate_state(options.flights)]
    tally = {name: [0, 0] for name in MISTAKES}
    right, unsure, inside, coasts = 0, 0, [], dict.fromkeys((1.0, FEET, 1.0 / FEET), 0)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for log in logs:
            columns = foreign(log, rng)
            guess = guess_map(write_csv(folder / "a.csv", columns))
            bad = wrong(guess, columns, log)
            right, unsure = right + (not bad), unsure + (bool(bad) and all(is_unsure(guess, what) for what in bad))
            for name in () if options.guesses else tally:
                found = named(log, mistaken(log, name, rng), folder)
                tally[name][0] += bool(found)
                tally[name][1] += bool(found) and not any(entry.startswith("refused") for entry in found)
    for log in (*logs, *(fly(seed, lean=30.0) for seed in range(options.flights // 3))):
        read = log.read(rng)
        coasts = {factor: named + bends(log, read, factor) for factor, named in coasts.items()}
        time = read.pop("time")
        rested, rest, _, _ = take_out_biases(time, read, (float(time[0]), -0.05), 0.02)
        speed, _, sigma, _ = ascent(time, rested["ax"], rested["altitude"], rest)
        known = speed > 3.0 * sigma
        inside.append(float(np.mean(np.abs(speed - log.speed)[known] < 1.96 * sigma[known])))
    print(f"guesses: {right} right, {unsure} wrong but said to be unsure, of {len(logs)}")
    print(count("guesses right, or said to be unsure", [k < right + unsure for k in range(len(logs))]))
    print(f"speed within 1.96 sigma: {100.0 * np.mean(inside):.1f} % of samples")
    sound, *others = coasts.values()
    print(f"coasts of unknown speed: altitudes as feet, as metres named in {others} of {len(inside)}, sound in {sound}")
    for name, (found, faults) in ({} if options.guesses else tally).items():
        print(f"{name:35s} named in {found} of {len(logs)}, {faults} of them by a fault, else refused")


if __name__ == "__main__":
    main()
