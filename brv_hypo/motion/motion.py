"""Axes and angles, as CONVENTIONS defines them; `Motion`: all that a mechanism may know of a flight, over time.

A transverse pair (y, z) in body axes is one complex number y + i z. With it the conventions read

    crossflow        xi = (v + i w) / V = i sin(alpha) exp(-i phi_w)
    moment           C_m + i C_n = (C_N' + i C_Z') exp(-i phi_w)
    transverse rate  omega = q + i r

`recorded` gives a motion its past: every quantity tau seconds earlier, by cubic interpolation; angles by way of the
crossflow, because alpha has a cusp and the meridian jumps by pi where alpha passes through zero. `with_crossflow`
sets the angles from a crossflow. `quadrature` and `at_nodes` evaluate a motion between its samples, where the
windward meridian turns too fast for any rule of integration on samples alone (half a turn where alpha is zero).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from typing import Any

import numpy as np
from scipy import sparse
from scipy.interpolate import CubicSpline

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.motion.interpolation import Quadrature, lagrange

# Way of the crossflow from node to node, of its least distance from zero on that way: the meridian turns by no more,
# rad. Splines through a damping or a constant moment that turns so err by some 1e-5 of it.
NODE_TURN = 0.4
# What the crossflow moves by in a usual delay, of its size; how much the turn of the meridian in it may change by from
# node to node, rad: what is late turns by it.
NODE_LATE = 0.5
NODE_WOUND = 0.5
NODE_HALVINGS = 7  # of a sample: what turns faster does so in less than a hundredth of a sample
NODE_MOST = 8  # added to a stretch at most, of its samples: noise passes by zero all the time

KEPT_PAST = 100_000  # samples of earlier motions that are kept of one: 100 bytes each

# ---- Angles, elementwise over arrays of any one shape ----


# Below this crossflow (rad) the meridian rate is damped towards zero: it is undefined at alpha = 0.
CROSSFLOW_FLOOR = 1e-6
SMOOTH = (
    *("alpha_rate", "windward_meridian_rate", "p", "q", "r"),
    *("velocity", "dynamic_pressure", "mach", "reynolds", "in_plane_moment"),
)
"""Quantities of a motion that vary smoothly and are no angles: those may jump or turn."""
DERIVED = ("roll_acceleration", "transverse_acceleration", "axial_share", "common_time")


def angle_of_attack(crossflow: ComplexArray) -> FloatArray:
    """Total angle of attack in rad, >= 0, from the crossflow (v + i w) / V (Eq. 3.3)."""
    return np.asarray(np.arcsin(np.clip(np.abs(crossflow), 0.0, 1.0)), dtype=float)


def windward_meridian(crossflow: ComplexArray) -> FloatArray:
    """phi_w = atan2(v, w) in rad, from body z toward body y (Eq. 3.4, erratum E5); wrapped to (-pi, pi]."""
    return np.arctan2(crossflow.real, crossflow.imag)


def crossflow(alpha: FloatArray, phi_w: FloatArray) -> ComplexArray:
    """(v + i w) / V of an angle of attack and a windward meridian, both in rad (Eq. 2.5, erratum E1)."""
    return np.asarray(1j * np.sin(alpha) * np.exp(-1j * phi_w), dtype=complex)


def unit(xi: ComplexArray) -> ComplexArray:
    """Unit numbers of the same direction; zero stays zero."""
    return np.asarray(xi / np.maximum(np.abs(xi), 1e-12))


def effective(xi: ComplexArray) -> ComplexArray:
    """Crossflow of size alpha rather than sin(alpha): what a force linear in alpha follows."""
    size = np.abs(xi)
    return np.asarray(xi * (np.arcsin(np.minimum(size, 1.0)) / np.maximum(size, 1e-12)))


def angle_rates(xi: ComplexArray, xi_rate: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """Rates of alpha and phi_w, rad/s, from the crossflow and its rate (1/s)."""
    product = xi_rate * np.conj(xi)
    size_squared = np.abs(xi) ** 2
    size = np.sqrt(size_squared + CROSSFLOW_FLOOR**2)
    cos_alpha = np.sqrt(np.maximum(1.0 - size_squared, 1e-12))
    return product.real / (size * cos_alpha), -product.imag / size**2


def body_from_plane(in_plane: FloatArray, out_of_plane: FloatArray, phi_w: FloatArray) -> ComplexArray:
    """C_m + i C_n from C_N' and C_Z' (Eq. 2.6, erratum E2)."""
    return np.asarray((in_plane + 1j * out_of_plane) * np.exp(-1j * phi_w), dtype=complex)


def plane_from_body(moment: ComplexArray, phi_w: FloatArray) -> ComplexArray:
    """C_N' + i C_Z' from C_m + i C_n: the inverse of `body_from_plane`."""
    return np.asarray(moment * np.exp(1j * phi_w), dtype=complex)


@dataclass(frozen=True)
class Motion:
    """Motion of the vehicle; every array has one shape, (n,) over time for a record. The simulator evaluates the same
    mechanisms at the running state: there the shape is (flights,), all at one instant. A mechanism therefore works
    elementwise and calls `delayed` for the past.
    """

    time: FloatArray  # s
    alpha: FloatArray  # angle of attack, rad
    alpha_rate: FloatArray  # rad/s
    windward_meridian: FloatArray  # rad, unwrapped over a record
    windward_meridian_rate: FloatArray  # rad/s
    p: FloatArray  # roll rate, rad/s
    q: FloatArray  # pitch rate, rad/s
    r: FloatArray  # yaw rate, rad/s
    velocity: FloatArray  # speed relative to the air, m/s
    dynamic_pressure: FloatArray  # Pa
    mach: FloatArray  # Mach number; NaN where the record does not give it
    reynolds: FloatArray  # Reynolds number; NaN where the record does not give it
    in_plane_moment: FloatArray  # the wind-fixed in-plane moment coefficient C_mw of Eq. 5.1
    reference_length: float  # m
    history: Callable[[float], Motion] | None = None  # the motion so many seconds earlier; see `delayed`
    # rad/s^2; None where it is not known: at a running state, and in the past
    roll_acceleration: FloatArray | None = None
    # q and r's rates, q' + i r', rad/s^2; at a running state, those of Euler's equations with C_mw; None in the past
    transverse_acceleration: ComplexArray | None = None
    axial_share: FloatArray | None = None  # the axial force's coefficient over its median; None as well
    # s, of flights that share their Mach numbers; None where each has its own time, and in the past
    common_time: FloatArray | None = None

    def __repr__(self) -> str:
        return f"<Motion: {self.time.size} samples>"

    @property
    def density(self) -> FloatArray:
        """That of the air, kg/m^3, by dynamic pressure and speed: what the vehicle feels of its altitude."""
        return np.asarray(2.0 * self.dynamic_pressure / self.velocity**2)

    def delayed(self, tau: float) -> Motion:
        """The whole motion tau seconds earlier, on the same shape; tau >= 0. Before its first instant a motion is taken
        as steady: constant alpha and constant meridian rate.
        """
        if tau == 0.0:
            return self
        if self.history is None:
            raise ValueError(
                f"a motion without history was asked for its past, {tau} s earlier; build it with "
                "brv_hypo.motion.motion.recorded, or let the simulator supply it"
            )
        return self.history(tau)

    def region(self, start: float, stop: float) -> FloatArray:
        """1 where start <= time < stop (s), else 0, on the motion's shape."""
        return ((self.time >= start) & (self.time < stop)).astype(float)

    @property
    def coefficient_time(self) -> FloatArray:
        """The time of knots and time bases, s: the common time where there is one."""
        return self.time if self.common_time is None else self.common_time

    def to_plane(self, moment: ComplexArray) -> ComplexArray:
        """C_N' + i C_Z' from C_m + i C_n: `plane_from_body`, the turn found once."""
        return np.asarray(moment * self._turn, dtype=complex)

    def to_body(self, in_plane: FloatArray, out_of_plane: FloatArray) -> ComplexArray:
        """C_m + i C_n from C_N' and C_Z': `body_from_plane`, the turn found once."""
        return np.asarray((in_plane + 1j * out_of_plane) * np.conj(self._turn), dtype=complex)

    @cached_property
    def _turn(self) -> ComplexArray:
        return plane_from_body(np.ones((), dtype=complex), self.windward_meridian)

    @property
    def rate_factor(self) -> FloatArray:
        """d / 2V in s: makes an angular rate dimensionless."""
        return np.asarray(self.reference_length / (2.0 * self.velocity), dtype=float)

    @property
    def plane_rates(self) -> ComplexArray:
        """The transverse rates times d / 2V, turned into the plane of alpha as a moment is."""
        return self.to_plane(np.asarray((self.q + 1j * self.r) * self.rate_factor, dtype=complex))


def with_crossflow(motion: Motion, xi: ComplexArray, xi_rate: ComplexArray) -> Motion:
    """The motion with the angles of a crossflow (n,) and of its rate (n,) 1/s; the meridian in the nearest turn."""
    alpha_rate, meridian_rate = angle_rates(xi, xi_rate)
    return replace(
        motion,
        alpha=angle_of_attack(xi),
        windward_meridian=nearest_turn(windward_meridian(xi), motion.windward_meridian),
        alpha_rate=alpha_rate,
        windward_meridian_rate=meridian_rate,
    )


def crossflow_rate(motion: Motion, xi: ComplexArray) -> ComplexArray:
    """Rate of a motion's crossflow xi (n,) 1/s, from the rates of its angles."""
    growth = motion.alpha_rate * np.cos(motion.alpha) / np.maximum(np.sin(motion.alpha), 1e-9)
    return np.asarray(xi * (growth - 1j * motion.windward_meridian_rate), dtype=complex)


def nearest_turn(angle: FloatArray, reference: FloatArray) -> FloatArray:
    """`angle` moved by whole turns next to `reference`, sample by sample."""
    return np.asarray(angle + 2.0 * np.pi * np.round((reference - angle) / (2.0 * np.pi)), dtype=float)


# ---- The past of a recorded motion: every quantity, tau seconds earlier, by cubic interpolation ----


def recorded(motion: Motion) -> Motion:
    """The same motion, with its past."""
    return replace(motion, history=_Past(replace(motion, history=None)))


def with_in_plane_moment(motion: Motion, moment: FloatArray) -> Motion:
    """A recorded motion with another C_mw, in its past too; what is known of the past else is kept."""
    own, earlier = replace(motion, in_plane_moment=moment, history=None), getattr(motion.history, "earlier", None)
    return replace(own, history=_Past(own, earlier=earlier))


class _Past:
    """The past of `motion`, counted from `ago` seconds before it; a class, so that motions can be pickled. `earlier` is
    all of it but C_mw so many seconds before; motions of another C_mw need the same times.
    """

    def __init__(self, motion: Motion, ago: float = 0.0, earlier: Callable[[float], Motion] | None = None) -> None:
        self.motion, self.ago, self.earlier = motion, ago, earlier or _earlier(motion)

    def __reduce__(self) -> Any:
        """A pickled motion need not hold what can be found again."""
        return _Past, (self.motion, self.ago)

    @cached_property
    def _in_plane_moment(self) -> CubicSpline:
        return CubicSpline(self.motion.time, self.motion.in_plane_moment)

    def __call__(self, tau: float) -> Motion:
        ago = self.ago + tau
        there = self.earlier(ago)
        moment = self._in_plane_moment(np.maximum(there.time, self.motion.time[0]))
        return replace(there, in_plane_moment=moment, history=_Past(self.motion, ago, self.earlier))


def _earlier(motion: Motion) -> Callable[[float], Motion]:
    """A motion so many seconds before; a quantity that is not known everywhere is taken for constant."""
    smooth = [name for name in SMOOTH[:-1] if np.all(np.isfinite(getattr(motion, name)))]

    @cache
    def spline() -> CubicSpline:
        xi = crossflow(motion.alpha, motion.windward_meridian)
        quantities = [xi.real, xi.imag, *(getattr(motion, name) for name in smooth)]
        return CubicSpline(motion.time, np.stack(quantities, axis=1))

    @lru_cache(1 + KEPT_PAST // motion.time.size)
    def earlier(ago: float) -> Motion:
        """Before the first sample everything is as it was there, but for the meridian, which turns on."""
        time, first = motion.time - ago, motion.time[0]
        along, across, *values = np.ascontiguousarray(spline()(np.maximum(time, first)).T)
        xi = np.asarray(along + 1j * across, dtype=complex)
        before = np.minimum(time - first, 0.0) * motion.windward_meridian_rate[0]
        meridian = windward_meridian(xi) + before
        turns = np.zeros(meridian.size)  # that unwrap it, and bring its end next to the motion's
        np.cumsum(np.round(np.diff(meridian) / (-2.0 * np.pi)), out=turns[1:])
        turns += np.round((motion.windward_meridian[-1] - meridian[-1]) / (2.0 * np.pi) - turns[-1])
        meridian = np.asarray(meridian + 2.0 * np.pi * turns, dtype=float)
        others: dict[str, Any] = {**dict.fromkeys(DERIVED), **dict(zip(smooth, values, strict=True))}
        return replace(motion, time=time, alpha=angle_of_attack(xi), windward_meridian=meridian, **others)

    return earlier


# ---- Between the samples, where the meridian turns too fast for them ----


def quadrature(motion: Motion, segments: Sequence[tuple[int, int]]) -> Quadrature:
    """The nodes of a motion over segments [a, b) of its samples, between which nothing is added."""
    xi = crossflow(motion.alpha, motion.windward_meridian)
    speed = float(np.linalg.norm(np.diff(xi) / np.diff(motion.time)))
    delay = NODE_LATE * float(np.linalg.norm(xi) / max(speed, 1e-300))  # in which it moves so much of its own size
    parts = [_nodes_between(motion.time[a:b], xi[a:b], delay) for a, b in segments]
    between = np.concatenate([np.zeros(0), *parts])
    if not between.size:
        return Quadrature(motion.time, np.arange(motion.time.size))
    time = np.union1d(motion.time, between)
    samples = np.searchsorted(time, motion.time)
    own = [lagrange(motion.time[a:b], time[samples[a] : samples[b - 1] + 1]).tocoo() for a, b in segments]
    starts = zip(own, segments, strict=True)
    rows, columns = np.hstack([(part.coords[0] + samples[a], part.coords[1] + a) for part, (a, _) in starts])
    weights = np.concatenate([part.data for part in own])
    spread = sparse.csr_array((weights, (rows, columns)), shape=(time.size, motion.time.size))
    return Quadrature(time, samples, spread)


def _nodes_between(time: FloatArray, xi: ComplexArray, delay: float) -> FloatArray:
    """Halves of what is between times where the crossflow goes, or the meridian's rate changes, too far."""
    found: list[FloatArray] = []
    begin, end, low, high = time[:-1], time[1:], xi[:-1], xi[1:]
    for _ in range(NODE_HALVINGS):
        way = np.abs(high - low)
        # The least distance from zero on the straight way from one to the other.
        share = np.clip((np.conj(low - high) * low).real / np.maximum(way**2, 1e-300), 0.0, 1.0)
        least = np.abs(low + share * (high - low))
        most = np.maximum(np.abs(low), np.abs(high))
        wound = delay * way / (end - begin) * (1.0 / np.maximum(least, 1e-300) - least / np.maximum(most, 1e-300) ** 2)
        far = (way > NODE_TURN * least) | (wound > NODE_WOUND)
        if not np.any(far) or sum(map(len, found)) + np.count_nonzero(far) > NODE_MOST * time.size:
            break
        begin, end, low, high = begin[far], end[far], low[far], high[far]
        middle = 0.5 * (begin + end)
        at = np.asarray(lagrange(time, middle) @ xi)
        found.append(middle)
        begin, end = np.concatenate([begin, middle]), np.concatenate([middle, end])
        low, high = np.concatenate([low, at]), np.concatenate([at, high])
    return np.concatenate([np.zeros(0), *found])


def at_nodes(motion: Motion, nodes: Quadrature) -> Motion:
    """The motion at the nodes, with its past; itself where these are its samples."""
    if nodes.spread is None:
        return motion
    xi = crossflow(motion.alpha, motion.windward_meridian)
    there, rate = nodes.of(xi), nodes.of(crossflow_rate(motion, xi))
    read = {name: getattr(motion, name) for name in (*SMOOTH, *DERIVED)}
    found: dict[str, Any] = {name: None if values is None else nodes.of(values) for name, values in read.items()}
    meridian = np.unwrap(windward_meridian(there))
    moved = replace(motion, time=nodes.time, windward_meridian=meridian, history=None, **found)
    return recorded(with_crossflow(moved, there, rate))
