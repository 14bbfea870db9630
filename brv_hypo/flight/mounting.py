"""How an inertial unit stands in the vehicle, from the whole record: thrust, drag and spin lie along the nose.

    transverse force = tilt * axial force + c V^2 + bias       trim grows with V^2, thrust does not
    transverse rate  = tilt * spin                             coning and swinging average out

Each `tilt` from a first guess of the nose is of least squares, its error from sums over blocks longer than a swing. A
turn about the nose is a convention, which nothing shows. Without thrust (`coasting_axis`), mean spin and drag lean by
the trim as well, the drag k times as much, k being the slope of the normal force over the axial: both together tell
tilt and trim apart. How gyros stand to accelerometers the flow shows
(`relative_axes`): the transverse force opposes the crossflow that follows from rates and speed (`path_into_force`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray, Values
from brv_hypo.flight.clock import joined, runs
from brv_hypo.thresholds import MINIMUM_SAMPLES

GRAVITY = 9.80665  # m/s^2, standard gravity (CGPM 1901)
THRUST = 1.5 * GRAVITY  # m/s^2 sensed, beyond what any instrument's bias makes of gravity
THRUST_SHORTEST, THRUST_SMOOTHED = 0.2, 0.05  # s
REST_OFF = 0.15 * GRAVITY  # m/s^2 by which a reading at rest may be off, or spread
DRAGGED, DRAGGED_SHARE = 0.5, 0.3  # m/s^2 of drag, and the part of what follows a thrust that senses it
BLOCK = 0.4  # s, about half a swing of a sounding rocket: residuals of blocks further apart are independent
THRUST_OFF = np.radians(0.4)  # rad, 1-sigma between mean thrust, with the crosswind at the rail, and the nose
SPIN_OFF = np.radians(0.3)  # rad, 1-sigma between the axis of spin and the nose: trim, principal axis
LEAST_SPIN, LEAST_TURNED = 0.5, 4.0 * np.pi  # rad/s and rad of roll that show the axis of spin
COAST_ROUNDS, COAST_PARTS = 5, ((0.0, 0.5), (0.25, 0.75), (0.5, 1.0), (0.0, 1.0))  # parts of a coast; the last is all
COAST_UNEXPLAINED = 0.1  # share of the transverse force that need not follow from the rates
COAST_AMBIGUOUS = 0.1  # |k - 1| below which mean spin and drag lean by as much, and tilt is no other than trim
SLOW = 0.35  # of the highest speed, below which a coast shows little
FADED = 0.05  # s after the highest speed, until which thrust fades
RELATIVE_SMOOTHED = 0.02  # s: a mean over this takes vibration out
SCALE_HEIGHT = 8500.0  # m over which the air's density falls by e
FIT_MOST_SAMPLES = 300  # that a relation is thinned to; bounds the time


@dataclass(frozen=True)
class Tilt:
    """The nose in the unit's axes, (3,), the 1-sigma error of its direction, rad, and what lies along it."""

    nose: FloatArray
    sigma: float
    by: str = "thrust and drag"

    @property
    def angle(self) -> float:
        """Between nose and the x axis of the unit, rad."""
        return float(np.arccos(np.clip(self.nose[0], -1.0, 1.0)))

    @property
    def matrix(self) -> FloatArray:
        """The smallest turn (3, 3) of what the unit reads that brings the nose to x."""
        from scipy.spatial.transform import Rotation

        axis = np.cross(self.nose, [1.0, 0.0, 0.0])
        if (size := float(np.linalg.norm(axis))) <= 1e-9:
            axis, size = np.array([0.0, 0.0, 1.0]), 1.0  # reversed: about z
        return np.asarray(Rotation.from_rotvec(axis * self.angle / size).as_matrix())


def powered_flight(time: FloatArray, forces: FloatArray) -> tuple[FloatArray, FloatArray, tuple[int, int, int]] | None:
    """Mean direction (3,) of the first thrust in forces (3, n) m/s^2, the speed (n,) m/s it makes, and three samples.

    Those of ignition, highest speed, and where drag has brought it down to a part of that. None without thrust, which
    comes after a rest, that senses gravity, or before a drag the other way: an entry's force does neither.
    """
    from scipy.ndimage import uniform_filter1d

    known, step = np.stack([joined(each) for each in forces]), float(np.median(np.diff(time)))
    size = uniform_filter1d(np.linalg.norm(known, axis=0), max(1, round(THRUST_SMOOTHED / step)), mode="nearest")
    least = max(2, round(THRUST_SHORTEST / step))
    for start, stop in (run for run in runs(size > THRUST) if run[1] - run[0] >= least):
        axis = known[:, start:stop].sum(axis=1)
        axis /= np.linalg.norm(axis)
        along = axis @ known
        rest = np.percentile(size[: start - least], (10, 50, 90)) if start > 2 * least else np.array([0.0, 0.0, 1e9])
        rested = abs(rest[1] - GRAVITY) < REST_OFF and rest[2] - rest[0] < REST_OFF
        if rested or float(np.mean(np.append(along[stop:], 0.0) < -DRAGGED)) > DRAGGED_SHARE:
            speed = integral(time, np.where(np.arange(time.size) < start, 0.0, along - GRAVITY))
            if (top := start + int(np.argmax(speed[start:]))) - start >= least:  # else what is felt drives nothing
                slow = np.flatnonzero(speed[top:] < SLOW * speed[top])
                return axis, speed, (start, top, top + int(slow[0]) if slow.size else time.size)
    return None


Air = tuple[FloatArray, FloatArray, FloatArray]
"""Speed (n,) m/s, what is proportional to the dynamic pressure (n,), and the unit's place (3,) m from the c.g."""


def nose_axis(time: FloatArray, rates: FloatArray, forces: FloatArray, air: Air | None = None) -> Tilt | None:
    """The nose by thrust, drag and much spin of `rates` (3, n) rad/s and `forces` (3, n) m/s^2, else by a coast."""
    flown = powered_flight(time, forces)
    if flown is None:
        return None if air is None else coasting_axis(time, rates, forces, air)
    first, speed, (ignition, top, end) = flown
    used = slice(ignition, end)
    square = (speed[used] / max(speed[top], 1.0)) ** 2
    pushed = _tilted(time[used], first, forces[:, used], (square, np.ones_like(square)), THRUST_OFF)
    spun = _spun(time[used], rates[:, used], pushed.nose)
    if spun is None:
        return pushed
    weights = np.array([pushed.sigma, spun.sigma]) ** -2.0
    nose = weights @ np.stack([pushed.nose, spun.nose]) / np.sum(weights)
    apart = 0.5 * float(np.linalg.norm(pushed.nose - spun.nose))  # where the two disagree, their error is of that size
    return Tilt(nose / np.linalg.norm(nose), max(float(np.sum(weights)) ** -0.5, apart), "thrust, drag and spin")


def _spun(time: FloatArray, rates: FloatArray, first: FloatArray) -> Tilt | None:
    """The axis of spin near `first` (3,); None without much of a spin."""
    spin = joined(first @ rates)
    enough = abs(float(np.trapezoid(spin, time))) > LEAST_TURNED and abs(np.median(spin)) > LEAST_SPIN
    return _tilted(time, first, rates, (), SPIN_OFF) if enough else None


def _tilted(
    time: FloatArray, first: FloatArray, vectors: FloatArray, beside: tuple[FloatArray, ...], floor: float
) -> Tilt:
    """The axis near `first` along which `vectors` (3, n) lie, but for multiples of `beside` across it."""
    known = np.stack([joined(each) for each in vectors])
    axes = np.linalg.svd(first[None])[2]
    across = (axes[1:] @ known).T
    columns = np.stack([first @ known, *beside], axis=1)
    inverse = np.linalg.pinv(columns.T @ columns)
    answer = inverse @ (columns.T @ across)
    score = columns[:, :, None] * (across - columns @ answer)[:, None]
    edges = np.unique(np.searchsorted(time, np.arange(time[0], time[-1], BLOCK)))
    sums = np.add.reduceat(score, edges, axis=0)
    variance = [(inverse @ (part.T @ part) @ inverse)[0, 0] for part in np.moveaxis(sums, 2, 0)]
    nose = first + axes[1:].T @ answer[0]
    return Tilt(nose / np.linalg.norm(nose), float(np.sqrt(np.mean(variance) + floor**2)))


def coasting_axis(time: FloatArray, rates: FloatArray, forces: FloatArray, air: Air) -> Tilt | None:
    """The nose in the longest part without a gap; None without two turns, or where forces follow from no rates."""
    known = np.isfinite(air[0] + air[1] + np.sum(rates, axis=0) + np.sum(forces, axis=0))
    longest = slice(*max(runs(known), key=lambda run: run[1] - run[0], default=(0, 0)))
    time, rates, forces, speed, scale = (each[..., longest] for each in (time, rates, forces, air[0], air[1]))
    turned = np.trapezoid(rates, time, axis=1) if time.size >= MINIMUM_SAMPLES else np.zeros(3)
    size = float(np.linalg.norm(turned))
    if size < LEAST_TURNED:
        return None
    nose = np.asarray(turned / (-size if turned @ forces.sum(axis=1) > 0.0 else size))  # drag points backward
    tilts = np.zeros((len(COAST_PARTS), 2))
    for _ in range(COAST_ROUNDS):
        matrix = Tilt(nose, 0.0).matrix
        omega = matrix @ rates
        force = matrix @ forces - np.cross(omega.T, np.cross(omega.T, air[2])).T
        squares, slope = path_into_force(time - time[0], omega, force, speed, scale)
        axial = -float(force[0] @ scale) / float(scale @ scale)
        times = slope / axial if axial > 0.0 else 0.0
        if times <= 0.0 or abs(times - 1.0) < COAST_AMBIGUOUS or squares[1] > COAST_UNEXPLAINED * squares[0]:
            return None
        for k, (start, stop) in enumerate(COAST_PARTS):
            part = slice(round(start * time.size), round(stop * time.size))
            window = np.hanning(part.stop - part.start)
            spun, dragged = (
                (each[1:, part] * each[0, part]) @ window / (each[0, part] ** 2 @ window) for each in (omega, force)
            )
            tilts[k] = (times * spun - dragged) / (times - 1.0)
        nose = np.asarray(matrix.T @ np.array([1.0, *tilts[-1]]))
        nose /= np.linalg.norm(nose)
    # The whole is twice as long as its parts, and its error half of theirs.
    apart = 0.5 * float(np.max(np.linalg.norm(np.diff(tilts[:-1], axis=0), axis=1)))
    return Tilt(nose, float(np.hypot(apart, SPIN_OFF)), "mean spin and drag")


# ---- Gyros against accelerometers: the transverse force opposes the crossflow that follows from the rates ----


def integral(time: FloatArray, values: Values) -> Values:
    """Integral of `values` (n,) from the first sample on, by trapezoids."""
    from scipy.integrate import cumulative_trapezoid

    return np.asarray(cumulative_trapezoid(values, time, initial=0))


def path_into_force(
    time: FloatArray, rates: FloatArray, forces: FloatArray, speed: FloatArray, scale: FloatArray, noise: float = 0.0
) -> tuple[tuple[float, float, float], float]:
    """Relation 1: the transverse of `forces` (3, n) m/s^2, by the crossflow of `rates` (3, n) rad/s at `speed` (n,).

    `scale` (n,) is proportional to the dynamic pressure, `time` (n,) s begins at nought. Squares and slope as of
    `fitted_slopes`; the path starts anywhere, and gravity and wind bend it slowly.
    """
    turn = np.exp(1j * integral(time, rates[0]))
    force = forces[1] + 1j * forces[2]
    xi = integral(time, (1j * speed * (rates[1] + 1j * rates[2]) + force) * turn) * np.conj(turn) / speed
    tau = 2.0 * time / time[-1] - 1.0
    powers = (np.ones_like(tau), tau, tau**2)
    start = [scale / speed * np.conj(turn) * power for power in powers]
    fixed = [each.astype(complex) for each in (powers[0], forces[0], scale, tau)]
    return fitted_slopes(noise, force, [-scale * xi * power for power in powers], [*start, *fixed])


def fitted_slopes(
    noise: float, observed: ComplexArray, slopes: Sequence[ComplexArray], nuisances: Sequence[ComplexArray]
) -> tuple[tuple[float, float, float], float]:
    """`observed` by real slopes, after complex nuisances: the slope on average, and three squares.

    Those are of what nuisances do not explain, of what slopes do not explain either, and of noise of that variance.
    """
    every = max(1, observed.size // FIT_MOST_SAMPLES)
    table = np.stack([*nuisances, *(1j * column for column in nuisances), *slopes, observed], axis=1)[::every]
    rows = np.concatenate([table.real, table.imag])
    count = 2 * len(nuisances)
    norms = np.linalg.norm(rows, axis=0)
    scaled = rows / np.where(norms > 0.0, norms, 1.0)
    basis, values, _ = np.linalg.svd(scaled[:, :count], full_matrices=False)
    basis = basis[:, values > 1e-8 * max(float(values[0]), 1e-300)]
    rest = scaled[:, count:] - basis @ (basis.T @ scaled[:, count:])
    answer = np.linalg.lstsq(rest[:, :-1], rest[:, -1], rcond=1e-8)[0]
    residual = rest[:, -1] - rest[:, :-1] @ answer
    power = float(norms[-1]) ** 2
    fitted = rows[:, count:-1] @ (answer / np.where(norms[count:-1] > 0.0, norms[count:-1], 1.0))
    first = rows[:, count]
    slope = float(first @ fitted / max(float(first @ first), 1e-300)) * float(norms[-1])
    squares = power * float(rest[:, -1] @ rest[:, -1]), power * float(residual @ residual), noise * table.shape[0]
    return squares, slope


def relative_axes(
    time: FloatArray, rates: FloatArray, forces: FloatArray, units: Mapping[str, float]
) -> tuple[str, FloatArray, float] | None:
    """Units and turn (3, 3) of the gyros under which the accelerometers follow from them best, and how surely.

    `rates` (3, n) in any of `units` (their sizes in rad/s) less their biases, `forces` (3, n) m/s^2, x to the nose. The
    last value is the unexplained share of the best over that of the next. None without thrust and a coast of a second.
    """
    from scipy.ndimage import uniform_filter1d

    flown, step = powered_flight(time, forces), float(np.median(np.diff(time)))
    if flown is None:
        return None
    used = slice(flown[2][1] + round(FADED / step), flown[2][2])
    if (used.stop - used.start) * step < 1.0:
        return None
    scale = flown[1] ** 2 * np.exp(-integral(time, flown[1]) / SCALE_HEIGHT)
    width = max(1, round(RELATIVE_SMOOTHED / step))
    smooth = np.stack([uniform_filter1d(joined(each), width)[used] for each in (*rates, *forces)])
    since, speed = time[used] - time[used.start], flown[1][used]
    found = []
    for name, size in units.items():
        for swapped, *signs in product((False, True), (1.0, -1.0), (1.0, -1.0), (1.0, -1.0)):
            matrix = np.diag(signs)[:, [0, 2, 1] if swapped else [0, 1, 2]]
            turned = size * matrix @ smooth[:3]
            squares, slope = path_into_force(since, turned, smooth[3:], speed, scale[used])
            found.append((squares[1] / squares[0] if slope > 0.0 else 1.0, name, matrix))
    found.sort(key=lambda each: each[0])
    return found[0][1], found[0][2], found[0][0] / max(found[1][0], 1e-300)
