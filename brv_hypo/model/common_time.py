"""The time that several flights of one design share: that of one of them, the reference, at the same Mach number.

What a boundary layer or a wake does begins at flight conditions, which two flights meet at different times. Knots and
time bases are in the common time, and every flight has its own times for them. The reference is the flight that flew
the widest range of Mach numbers, in whatever order flights are given.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import Polynomial
from scipy.interpolate import BSpline, CubicSpline
from scipy.optimize import nnls

from brv_hypo.arrays import FloatArray

# Held by `tests.studies.independent.joint` and `tests.studies.independent.two_flights`.
COMMON_SPLINES = (4, 6, 8, 12, 16)  # by which a Mach number falls or rises over a record: as many as it needs, by BIC
COMMON_MEANS = 400  # of neighbouring samples, that are fitted
COMMON_CHECKED = 40  # of neighbouring samples, by which the fit is checked
COMMON_DEGREE = 5  # the highest in its own time of what a flight's common time is tried as
COMMON_ROUNDS = 4  # of its least squares
# Share of its range by which those means may stray (rms) from what only falls or only rises, if Mach number is to give
# time: a fifth of what lies between two of the usual seven knots.
COMMON_STRAYING = 0.025
COMMON_SLOWEST = 0.02  # pace of a Mach number over its mean: where it is constant, it does not give time at all


@dataclass(frozen=True)
class OwnTime:
    """A flight's samples: its own `time` and the `common` time (n,) s, both rising, and its smooth `mach` (n,)."""

    time: FloatArray
    common: FloatArray
    mach: FloatArray

    def common_at(self, time: FloatArray) -> FloatArray:
        """Common time (s) at the flight's own time (s), any shape; beyond the record that of its end."""
        return np.asarray(np.interp(time, self.time, self.common), dtype=float)

    def own_at(self, common: float) -> float:
        """The flight's own time at a common time, s; beyond the record as many seconds from its end."""
        inside = min(max(common, float(self.common[0])), float(self.common[-1]))
        return float(np.interp(inside, self.common, self.time)) + common - inside

    def pace_at(self, time: FloatArray) -> FloatArray:
        """Common time that goes by in one of the flight's own, at its own time (s), any shape."""
        return np.asarray(np.interp(time, self.time, np.gradient(self.common, self.time)), dtype=float)

    def flies(self, common: float) -> bool:
        """Whether the flight comes by that common time (s)."""
        return bool(self.common[0] <= common <= self.common[-1])


@dataclass(frozen=True)
class CommonTime:
    """The flights' own times; common time is that of flight `reference` (from 0), and `late` is as of `aligned`."""

    flights: tuple[OwnTime, ...]
    reference: int
    late: FloatArray | None = None

    @property
    def mach_span(self) -> tuple[float, float]:
        """The lowest and the highest Mach number of any flight."""
        ends = [float(own.mach[k]) for own in self.flights for k in (0, -1)]
        return min(ends), max(ends)

    def mach(self, common: float) -> float:
        """The Mach number of a common time, s: that of the flight of the widest range that comes by it."""
        there = (own for own in self.flights if own.flies(common))
        own = max(there, key=lambda own: abs(float(own.mach[-1] - own.mach[0])), default=None)
        if own is not None:
            return float(np.interp(common, own.common, own.mach))
        # Between flights that share nothing, or beyond all: at the reference flight's mean pace.
        reference = self.flights[self.reference]
        end = 0 if common < reference.common[0] else -1
        beyond = common - reference.common[end]
        return float(reference.mach[end] + beyond / _mean_pace(reference.time, reference.mach))

    @property
    def span(self) -> tuple[float, float]:
        """The earliest and the latest common time of any flight, s."""
        ends = [float(own.common[k]) for own in self.flights for k in (0, -1)]
        return min(ends), max(ends)

    def aligned(self, late: FloatArray) -> CommonTime | None:
        """The common time in which events of flights come together that are `late` (flights, 2) by Mach number: s at
        the ends of the span, linear between; nothing on the reference. None where a flight's time would not rise.
        """
        moved = tuple(
            replace(own, common=own.common - np.interp(own.common, self.span, each))
            for own, each in zip(self.flights, late, strict=True)
        )
        rises = all(np.all(np.diff(own.common) > 0.0) for own in moved)
        return CommonTime(moved, self.reference, late) if rises else None

    def late_at(self, common: float) -> FloatArray:
        """By how much events at a common time (s) are late on each flight by its Mach number, s (flights,)."""
        if self.late is None:
            return np.zeros(len(self.flights))
        return np.array([np.interp(common, self.span, each) for each in self.late])

    def apart(self) -> tuple[int, ...]:
        """Flights that share no Mach number with any other."""
        spans = [(own.common[0], own.common[-1]) for own in self.flights]
        return tuple(
            k
            for k, (a, b) in enumerate(spans)
            if all(other == k or b <= c or d <= a for other, (c, d) in enumerate(spans))
        )


def decimals(values: Sequence[float]) -> int:
    """Decimals that distinguish values to a thousandth of the range that they span."""
    span = max(values) - min(values) if values else 0.0
    return max(0, 2 - int(np.floor(np.log10(span)))) if span > 0.0 else 2


def at(common: CommonTime | None, time: float) -> str:
    """A common time (s) in words: where flights share it by Mach number, to a thousandth of all those flown."""
    return f"{time:.2f} s" if common is None else f"Mach {common.mach(time):.{decimals(common.mach_span)}f}"


def common_time(records: Sequence[tuple[FloatArray, FloatArray | None]]) -> CommonTime | str:
    """The common time of flights, each given by its time (n,) s and measured Mach number (n,). In words why not, where
    Mach number does not determine time: where a flight has none, or one that neither only falls nor only rises (see
    `COMMON_STRAYING`), or where it falls on one flight and rises on another.
    """
    smooth = []
    for number, (time, mach) in enumerate(records, start=1):
        if mach is None or not np.all(np.isfinite(mach)):
            return f"flight {number} has no Mach number. Add mach, or altitude, to its record"
        if (found := running(time, mach)) is None:
            return f"that of flight {number} neither only falls nor only rises. Cut the flights to where it does"
        smooth.append(found)
    if len({float(np.sign(mach[-1] - mach[0])) for mach in smooth}) > 1:
        return "it falls on some flights and rises on others. Compare those of either kind alone"
    reference = max(range(len(smooth)), key=lambda k: (abs(smooth[k][-1] - smooth[k][0]), -records[k][0][0]))
    alone = OwnTime(records[reference][0], records[reference][0], smooth[reference])
    own = [
        alone if k == reference else OwnTime(time, _common(alone, time, np.asarray(measured), mach), mach)
        for k, ((time, measured), mach) in enumerate(zip(records, smooth, strict=True))
    ]
    return CommonTime(tuple(own), reference)


def _common(reference: OwnTime, time: FloatArray, measured: FloatArray, mach: FloatArray) -> FloatArray:
    """The reference flight's time (n,) s at a flight's own time (n,) s, from its measured and smooth Mach number (n,).
    By Mach number alone, or as a polynomial of its own time where the means of its Mach number want no more by BIC:
    where Mach number hardly changes it determines time badly; a shift or pace between flights is then better known.
    """
    first, last = reference.mach[[0, -1]]
    sign, slow = float(np.sign(last - first)), abs(_mean_pace(reference.time, reference.mach))
    beyond = np.minimum(sign * (mach - first), 0.0) + np.maximum(sign * (mach - last), 0.0)  # there at its mean pace
    raw: FloatArray = np.interp(sign * mach, sign * reference.mach, reference.time) + beyond * slow
    means = _means(time, measured, COMMON_MEANS)
    pace, by_mach = np.gradient(reference.mach, reference.time), np.interp(means[:, 0], time, raw)
    inside = (by_mach > reference.time[0]) & (by_mach < reference.time[-1])
    at, measured = means[inside].T
    if at.size <= 2 * COMMON_DEGREE:
        return raw
    weight = np.abs(np.interp(by_mach[inside], reference.time, pace))
    rest = measured - np.interp(at, time, mach)
    best, found = _bic(float(rest @ rest), at.size, COMMON_DEGREE + 2), None
    for degree in range(COMMON_DEGREE + 1):
        powers = Polynomial.fit(at, by_mach[inside] - at, degree, w=weight)
        for _ in range(COMMON_ROUNDS):
            common = at + powers(at)
            rest = measured - np.interp(common, reference.time, reference.mach)
            powers = powers + Polynomial.fit(at, rest / np.interp(common, reference.time, pace), degree, w=weight)
        common = at + powers(at)
        rest = measured - np.interp(common, reference.time, reference.mach)
        bic = _bic(float(rest @ rest), at.size, degree + 1)
        if bic < best and np.all(np.diff(common) > 0.0):
            best, found = bic, common
    if found is None:
        return raw
    line = CubicSpline(at, found, bc_type="natural")  # and straight on beyond the means
    slopes = line(at[[0, -1]], 1)
    before, after = np.minimum(time - at[0], 0.0), np.maximum(time - at[-1], 0.0)
    return np.asarray(line(np.clip(time, at[0], at[-1])) + before * slopes[0] + after * slopes[1], dtype=float)


def _bic(squares: float, size: int, parameters: int) -> float:
    """Of the sum of squares that so many parameters leave of so many means."""
    return float(size * np.log(max(squares, 1e-300) / size) + parameters * np.log(size))


def _mean_pace(time: FloatArray, mach: FloatArray) -> float:
    """Seconds in which a Mach number changes by one, of its sign."""
    return float((time[-1] - time[0]) / (mach[-1] - mach[0]))


def running(time: FloatArray, mach: FloatArray) -> FloatArray | None:
    """A smooth Mach number (n,) that strictly falls or strictly rises; None where the measured one does neither. Least
    squares of monotone splines (Ramsay, Statistical Science 3:425, 1988), as many as their BIC wants.
    """
    place = (time - time[0]) / (time[-1] - time[0])
    means = _means(place, mach, COMMON_MEANS)
    sign = float(np.sign(means[-1, 1] - means[0, 1]))
    if sign == 0.0:
        return None
    fits = [_monotone(means, sign, count) for count in COMMON_SPLINES if 2 * count <= len(means)]
    if not fits:
        return None
    _, best = min(fits, key=lambda fit: fit[0])
    smooth = best(place)
    stray = _means(place, mach - smooth, COMMON_CHECKED)[:, 1]
    return smooth if np.sqrt(np.mean(stray**2)) <= COMMON_STRAYING * abs(smooth[-1] - smooth[0]) else None


def _monotone(means: FloatArray, sign: float, count: int) -> tuple[float, Callable[[FloatArray], FloatArray]]:
    """BIC and the function of place of the best curve through means (n, 2) whose slope has one sign everywhere."""
    place, mach = means.T
    slowest = COMMON_SLOWEST * (mach[-1] - mach[0]) / (place[-1] - place[0])
    knots = np.concatenate([[0.0] * 2, np.linspace(0.0, 1.0, count - 1), [1.0] * 2])
    rises = BSpline(knots, np.eye(count), 2).antiderivative()
    design = np.column_stack([np.ones(place.size), sign * rises(place)])
    weights, left = nnls(design, mach - slowest * place)
    bic = _bic(float(left) ** 2, place.size, count + 1)

    def curve(at: FloatArray) -> FloatArray:
        return np.asarray(weights[0] + slowest * at + sign * (rises(at) @ weights[1:]), dtype=float)

    return bic, curve


def _means(place: FloatArray, values: FloatArray, most: int) -> FloatArray:
    """Means of place and value over as many stretches of the samples as there may be at most (stretches, 2)."""
    parts = np.array_split(np.stack([place, values], axis=1), min(most, place.size))
    return np.array([part.mean(axis=0) for part in parts])
