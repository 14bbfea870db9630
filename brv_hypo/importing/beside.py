"""What a log holds beside its channels: the attitude that its recorder found, and further inertial units.

Attitude: an angle of the nose from the vertical, or a quaternion, scalar first. Whether a quaternion turns body axes to
the ground's or back shows by the gyros, which it must follow (`attitude_of`); its ground is that of the pad.
Further units: brought to the axes of the first, compared with it by least squares as a check of the stated tolerances
(`together`), and averaged.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from brv_hypo import thresholds as limits
from brv_hypo.arrays import FloatArray
from brv_hypo.flight.clock import joined
from brv_hypo.flight.record import ACCELEROMETERS, GYROS, INERTIAL_CHANNELS, Channels, RecordFault
from brv_hypo.flight.tolerances import Instruments
from brv_hypo.flight.units import Dimension

QUATERNION = ("qw", "qx", "qy", "qz")
ATTITUDE: Mapping[str, Dimension] = {"lean": "angle", **dict.fromkeys(QUATERNION, "dimensionless")}
NORM_WITHIN = 0.1  # of 1: beyond, a quaternion lies between two of opposite sign, or is missing
TURNED_OVER = 0.05  # s over which quaternions and gyros turn, compared
SAME_AXES = np.radians(5.0)  # rad between the gyros of two units, below which the difference is misalignment
BLOCK = 0.1  # s of the means by which units are compared: vibration is no difference


@dataclass(frozen=True)
class Attitude:
    """Turns (n) of the unit since it was at rest, or the lean (n,) rad alone, NaN where unknown."""

    turns: Rotation | None
    known: FloatArray
    """Samples (m,) at which the turns are known."""
    lean: FloatArray | None
    faults: tuple[RecordFault, ...] = ()

    def leans(self, time: FloatArray, matrix: FloatArray, up: FloatArray | None) -> FloatArray | None:
        """Lean (n,) rad of the nose, x of `matrix` (3, 3) times the unit's axes; `up` (3,) at rest."""
        if self.turns is None or up is None:
            return self.lean
        leans = np.arccos(np.clip(self.turns.apply(matrix.T @ up) @ matrix[0], -1.0, 1.0))
        return np.asarray(np.interp(time, time[self.known], leans))


def attitude_of(time: FloatArray, channels: Channels, still_s: float) -> Attitude | None:
    """The attitude of a log, taken out of `channels` (n,), SI, whose gyros it is checked against.

    The vehicle is at rest up to `still_s`. None where the log has none.
    """
    found = {name: channels.pop(name) for name in ATTITUDE if name in channels}
    lean, known = found.get("lean"), np.array([], dtype=int)
    if {*QUATERNION} <= {*found}:
        quaternion = np.stack([found[name] for name in QUATERNION])
        known = np.flatnonzero(np.abs(np.linalg.norm(quaternion, axis=0) - 1.0) < NORM_WITHIN)
    if known.size < limits.MINIMUM_SAMPLES or not {*GYROS} <= {*channels}:
        return None if lean is None else Attitude(None, known, lean)
    turns, at = Rotation.from_quat(quaternion[[1, 2, 3, 0]][:, known].T), time[known]
    every = max(1, round(TURNED_OVER / float(np.median(np.diff(time)))))
    gyros = np.stack([uniform_filter1d(joined(channels[name]), every)[known][every // 2 :: every] for name in GYROS])
    steps = np.diff(at[::every])
    both = [turns[::every], turns[::every].inv()]  # to the ground, or from it
    rates = [(each[:-1].inv() * each[1:]).as_rotvec().T / steps for each in both]
    gyros = gyros[:, : steps.size]
    shares = [float(np.sum((each - gyros) ** 2)) / max(float(np.sum(gyros**2)), 1e-12) for each in rates]
    best = int(np.argmin(shares))
    faults = tuple[RecordFault, ...]()
    if shares[best] > limits.ATTITUDE_FOLLOWS:
        turned, read = (np.degrees(np.sqrt(np.mean(np.sum(each**2, axis=0)))) for each in (rates[best], gyros))
        words = (
            f"the log's attitude turns at {turned:.3g} deg/s and the gyros at {read:.3g} deg/s (rms), "
            f"{100.0 * shares[best]:.0f} % of which it does not follow: axes, signs or units of the gyros, or order "
            "of the quaternion; correct the map"
        )
        faults = (RecordFault("p, q, r", "attitude", float(at[0]), float(at[-1]), words, decisive=False),)
    ground = turns if best == 0 else turns.inv()
    first = ground[: max(int(np.searchsorted(at, still_s)), 1)].mean()
    return Attitude(ground.inv() * first, known, lean, faults)


def together(
    time: FloatArray, first: Channels, further: Sequence[Channels], stated: Instruments
) -> tuple[Channels, dict[str, float], list[str], list[RecordFault]]:
    """Means of the channels (n,), SI, over all units; half of what these differ by where `stated` errors allow less.

    Also a note for each further unit, and faults of those that differ by more than is stated.
    """
    larger, notes, faults = dict[str, float](), list[str](), list[RecordFault]()
    units = [first, *(_in_axes_of(first, unit) for unit in further)]
    for number, unit in enumerate(units[1:], 2):
        worst = (0.0, "")
        elsewhere = unit is not further[number - 2]  # turned by an estimate, which says nothing of misalignment
        for key, size, sigma in _differences(time, first, unit) if {*GYROS} <= {*first} else ():
            if elsewhere and key.endswith("misalignment"):
                continue
            allowed = float(np.sqrt(2.0)) * max(getattr(stated, key))
            ratio = size / float(np.hypot(allowed, sigma))
            words = f"units {number} and 1 differ by {size:.3g} (SI) in {key}, stated {allowed:.3g}"
            worst = max(worst, (ratio, words))
            if ratio > limits.UNITS_DIFFER and 0.5 * size > larger.get(key, 0.0):
                larger[key] = 0.5 * size
                words += ": half of that is taken; check their units, or state larger tolerances"
                channels = "p, q, r" if key.startswith("gyro") else "ax, ay, az"
                faults.append(
                    RecordFault(channels, "tolerance", float(time[0]), float(time[-1]), words, decisive=False)
                )
        notes += [f"{worst[1]}: the most, in stated errors"] if worst[1] else []
    several = {name: [unit[name] for unit in units if name in unit] for name in INERTIAL_CHANNELS if name in first}
    mean = {name: np.ma.masked_invalid(np.stack(each)).mean(axis=0).filled(np.nan) for name, each in several.items()}
    return first | mean, larger, notes, faults


def _in_axes_of(first: Channels, unit: Channels) -> Channels:
    """The unit in the axes of the first, by the gyros of both where these are elsewhere."""
    rates = [np.stack([each[name] for name in GYROS]) for each in (first, unit) if {*GYROS} <= {*each}]
    if len(rates) < 2:
        return unit
    known = np.all(np.isfinite(rates), axis=(0, 1))
    spread = [each[:, known] - np.mean(each[:, known], axis=1, keepdims=True) for each in rates]
    turn, _ = Rotation.align_vectors(spread[0].T, spread[1].T)
    if turn.magnitude() < SAME_AXES:
        return unit
    triads = [names for names in (GYROS, ACCELEROMETERS) if {*names} <= {*unit}]
    turned = [turn.as_matrix() @ np.stack([unit[name] for name in names]) for names in triads]
    return unit | {
        name: row for names, rows in zip(triads, turned, strict=True) for name, row in zip(names, rows, strict=True)
    }


def _differences(time: FloatArray, first: Channels, unit: Channels) -> Iterator[tuple[str, float, float]]:
    """Differences of bias, scale and misalignment of each axis, and their standard errors, by tolerance."""
    edges = np.unique(np.searchsorted(time, np.arange(time[0], time[-1], BLOCK)))[:-1]
    counts = np.diff(edges, append=time.size)
    one, other = (
        {name: np.add.reduceat(joined(each[name]), edges) / counts for name in INERTIAL_CHANNELS if name in each}
        for each in (first, unit)
    )
    # Of the mean of both the noise is no more the one's than the other's: it bends no slope.
    mean = {name: 0.5 * (one[name] + other[name]) if name in other else one[name] for name in one}
    p, q, r = (mean[name] for name in GYROS)
    dp, dq, dr = (np.gradient(each, time[edges]) for each in (p, q, r))
    swings = {  # accelerometers lie apart, by an arm that is open
        "ax": (-(q**2 + r**2), p * q - dr, p * r + dq),
        "ay": (p * q + dr, -(p**2 + r**2), q * r - dp),
        "az": (p * r - dq, q * r + dp, -(p**2 + q**2)),
    }
    for kind, triad in (("gyro", GYROS), ("accel", ACCELEROMETERS)):
        for axis in (name for name in triad if {*triad} <= {*one} and name in other):
            table = np.stack([np.ones_like(p), *(mean[name] for name in triad), *swings.get(axis, ())], axis=1)
            apart, each = other[axis] - one[axis], joined(unit[axis]) - joined(first[axis])
            noise = np.sqrt(np.add.reduceat(each**2, edges) / counts - apart**2)  # a motor shakes, a coast does not
            weights = 1.0 / np.maximum(noise, np.median(noise))
            table, apart = table * weights[:, None], apart * weights
            inverse = np.linalg.pinv(table.T @ table)
            answer = inverse @ (table.T @ apart)
            spread = float(np.sum((apart - table @ answer) ** 2)) / max(apart.size - answer.size, 1)
            keys = ("bias", *("scale" if name == axis else "misalignment" for name in triad))
            for key, size, variance in zip(keys, answer[:4], np.diag(inverse)[:4], strict=True):
                yield f"{kind}_{key}", abs(float(size)), float(np.sqrt(variance * spread))
