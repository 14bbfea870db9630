"""What a log holds beside its channels: the attitude that its recorder found, and further inertial units.

Attitude: an angle of the nose from the vertical, or a quaternion, scalar first. Whether a quaternion turns body axes to
the ground's or back shows by the gyros, which it must follow (`attitude_of`); its ground is that of the pad.
Further units: brought to the axes of the first, compared with it by least squares as a check of the stated tolerances
(`differences`), then averaged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from brv_hypo import thresholds as limits
from brv_hypo.arrays import FloatArray
from brv_hypo.flight.clock import joined
from brv_hypo.flight.record import ACCELEROMETERS, GYROS, Channels, RecordFault
from brv_hypo.flight.tolerances import Instruments
from brv_hypo.flight.units import Dimension

LEAN = "lean"  # of the nose from the vertical
QUATERNION = ("qw", "qx", "qy", "qz")
ATTITUDE: Mapping[str, Dimension] = {LEAN: "angle", **dict.fromkeys(QUATERNION, "dimensionless")}
NORM_WITHIN = 0.1  # of 1: beyond, a quaternion lies between two of opposite sign, or is missing
TURNED_OVER = 0.05  # s over which quaternions and gyros turn, compared
BLOCK = 0.1  # s of the means by which units are compared: vibration is no difference


@dataclass(frozen=True)
class Attitude:
    """Where up is in the unit's axes, (3, n), of a quaternion; or the lean (n,) rad alone. NaN where unknown."""

    ups: FloatArray | None
    lean: FloatArray | None
    faults: tuple[RecordFault, ...] = ()

    def leans(self, matrix: FloatArray, up: FloatArray | None) -> FloatArray | None:
        """Lean (n,) rad of the nose, x of `matrix` (3, 3) times the unit's axes; `up` (3,) at the first sample."""
        if self.ups is None or up is None:
            return self.lean
        turns = self.ups.reshape(3, 3, -1)
        ups = np.einsum("ijn,j->in", turns, matrix.T @ up)
        return np.asarray(np.arccos(np.clip((matrix @ ups)[0], -1.0, 1.0)))


def attitude_of(time: FloatArray, channels: Channels, still_s: float) -> Attitude | None:
    """The attitude of a log, taken out of `channels` (n,), SI, whose gyros it is checked against.

    The turns of a quaternion count from its mean up to `still_s`. None where the log has none.
    """
    found = {name: channels.pop(name) for name in ATTITUDE if name in channels}
    lean = found.get(LEAN)
    if not set(QUATERNION) <= set(found):
        return None if lean is None else Attitude(None, lean)
    quaternion = np.stack([found[name] for name in QUATERNION])
    known = np.flatnonzero(np.abs(np.linalg.norm(quaternion, axis=0) - 1.0) < NORM_WITHIN)
    if known.size < limits.MINIMUM_SAMPLES:
        return None if lean is None else Attitude(None, lean)
    turns = Rotation.from_quat(quaternion[[1, 2, 3, 0]][:, known].T)
    shares, faults = (0.0, 1.0), tuple[RecordFault, ...]()
    if set(GYROS) <= set(channels):
        shares, faults = _follows(time[known], turns, np.stack([channels[name][known] for name in GYROS]))
    to_ground = turns if shares[0] <= shares[1] else turns.inv()
    first = to_ground[: max(int(np.searchsorted(time[known], still_s)), 1)].mean()
    ups = np.full((9, time.size), np.nan)
    ups[:, known] = (to_ground.inv() * first).as_matrix().reshape(-1, 9).T
    return Attitude(ups, lean, faults)


def _follows(
    time: FloatArray, turns: Rotation, rates: FloatArray
) -> tuple[tuple[float, float], tuple[RecordFault, ...]]:
    """Shares of the `rates` (3, n) rad/s that turns to the ground, and from it, do not explain; a fault of both."""
    every = max(1, round(TURNED_OVER / float(np.median(np.diff(time)))))
    sparse, steps = turns[::every], np.diff(time[::every])
    gyros = np.stack([uniform_filter1d(joined(each), every)[every // 2 :: every] for each in rates])[:, : steps.size]
    power = max(float(np.sum(gyros**2)), 1e-12)
    both = [
        (one.inv() * other).as_rotvec()
        for one, other in ((sparse[:-1], sparse[1:]), (sparse[:-1].inv(), sparse[1:].inv()))
    ]
    found = [each.T / steps for each in both]
    shares = [float(np.sum((each - gyros) ** 2)) / power for each in found]
    if min(shares) < limits.ATTITUDE_FOLLOWS:
        return (shares[0], shares[1]), ()
    best = found[int(np.argmin(shares))]
    seen, read = (np.degrees(np.sqrt(np.mean(np.sum(each**2, axis=0)))) for each in (best, gyros))
    words = (
        f"the log's attitude turns at {seen:.3g} deg/s and the gyros at {read:.3g} deg/s (rms), "
        f"{100.0 * min(shares):.0f} % of which it does not follow: axes, signs or units of the gyros, or the order of "
        "the quaternion; correct the map"
    )
    fault = RecordFault("p, q, r", "attitude", float(time[0]), float(time[-1]), words, decisive=False)
    return (shares[0], shares[1]), (fault,)


# ---- Further inertial units ----


def aligned(first: FloatArray, further: FloatArray) -> FloatArray:
    """The turn (3, 3) of the rates `further` (3, n) that brings them to those of the `first` (3, n) unit."""
    known = np.all(np.isfinite(first) & np.isfinite(further), axis=0)
    spread = [each[:, known] - np.mean(each[:, known], axis=1, keepdims=True) for each in (first, further)]
    return np.asarray(Rotation.align_vectors(spread[0].T, spread[1].T)[0].as_matrix())


def differences(
    time: FloatArray, units: Sequence[Channels], instruments: Instruments
) -> tuple[dict[str, float], list[str], tuple[RecordFault, ...]]:
    """Half of what the units (channels (n,), SI, of one set of axes) differ by, SI, where tolerances allow less.

    Also a note for each further unit, and a fault where two differ by more than the stated tolerances allow.
    """
    larger: dict[str, float] = {}
    notes, faults = list[str](), tuple[RecordFault, ...]()
    for number, unit in enumerate(units[1:], 2):
        worst = []
        for kind, triad in (("gyro", GYROS), ("accel", ACCELEROMETERS)):
            if not {*triad, *GYROS} <= set(unit):
                continue
            for key, (size, sigma) in _differ(time, kind, triad, units[0], unit).items():
                allowed = float(np.sqrt(2.0)) * max(getattr(instruments, key))
                worst.append((size / float(np.hypot(allowed, sigma)), key, size, allowed))
        for ratio, key, size, allowed in worst:
            if ratio > limits.UNITS_DIFFER:
                larger[key] = max(larger.get(key, 0.0), 0.5 * size)
                words = (
                    f"unit {number} and the first differ by {size:.3g} (SI) in {key}, where the stated tolerance "
                    f"allows {allowed:.3g}: half of that is taken; check their units, or state larger tolerances"
                )
                where = "p, q, r" if key.startswith("gyro") else "ax, ay, az"
                faults += (RecordFault(where, "tolerance", float(time[0]), float(time[-1]), words, decisive=False),)
        if worst:
            ratio, key, size, _ = max(worst)
            notes.append(
                f"unit {number} against the first: at most {ratio:.2g} stated errors apart ({key}, {size:.3g} SI)"
            )
    return larger, notes, faults


def _differ(
    time: FloatArray, kind: str, triad: Sequence[str], first: Channels, unit: Channels
) -> dict[str, tuple[float, float]]:
    """Largest difference of bias, scale and misalignment over the axes, and its standard error, by tolerance."""
    edges = np.unique(np.searchsorted(time, np.arange(time[0], time[-1], BLOCK)))[:-1]
    counts = np.diff(edges, append=time.size)

    def means(values: FloatArray) -> FloatArray:
        return np.asarray(np.add.reduceat(joined(values), edges) / counts)

    one, other = ([means(each[name]) for name in triad] for each in (first, unit))
    columns = [np.ones(edges.size), *one]
    if kind == "accel":  # units lie apart, by an arm that is open
        p, q, r = (means(first[name]) for name in GYROS)
        at = means(time)
        change = [np.gradient(each, at) for each in (p, q, r)]
        swings = [
            [-(q**2 + r**2), p * q - change[2], p * r + change[1]],
            [p * q + change[2], -(p**2 + r**2), q * r - change[0]],
            [p * r - change[1], q * r + change[0], -(p**2 + q**2)],
        ]
    found: dict[str, tuple[float, float]] = {}
    for axis in range(3):
        table = np.stack([*columns, *(swings[axis] if kind == "accel" else [])], axis=1)
        inverse = np.linalg.pinv(table.T @ table)
        answer = inverse @ (table.T @ (other[axis] - one[axis]))
        left = other[axis] - one[axis] - table @ answer
        sigmas = np.sqrt(np.diag(inverse) * float(left @ left) / max(edges.size - table.shape[1], 1))
        for column, key in enumerate(("bias", *("scale" if each == axis else "misalignment" for each in range(3)))):
            before = found.get(f"{kind}_{key}", (0.0, 1.0))
            here = (abs(float(answer[column])), float(sigmas[column]))
            found[f"{kind}_{key}"] = max(before, here, key=lambda each: each[0] / max(each[1], 1e-300))
    return found


def averaged_units(units: Sequence[Channels]) -> Channels:
    """The mean of each inertial channel over the units that have it; other channels are those of the first."""
    mean = dict(units[0])
    for name in (*GYROS, *ACCELEROMETERS):
        values = [unit[name] for unit in units if name in unit]
        if len(values) > 1:
            mean[name] = np.asarray(np.nanmean(np.stack(values), axis=0))
    return mean
