"""The moment of a model on a flight's motion, and on records that move a little otherwise.

Mechanisms work elementwise (`Motion`): a moment is a function of what the motion is at that instant, and its slopes by
each of these quantities, found once, serve every change of the record. What is made of the past has none.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.baseline import PitchDamping, StaticMoment
from brv_hypo.model.term import Regressor, evaluated, summed
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.motion import CROSSFLOW_FLOOR, Motion, crossflow, crossflow_rate, with_crossflow
from brv_hypo.motion.reconstruction import Reconstruction

MOMENT_SLOPE_STEP = 1e-6  # of a quantity, or of its unit where that is more, half the width of a moment's slope by it
# The parts of the crossflow and of its rate, as names of quantities.
_TURNED = ("y", "z", "rate y", "rate z")
# Channels of a record, which may be without the last ones, and with the transverse rates what a motion has of it.
_SCALARS = ("p", "velocity", "dynamic_pressure", "mach", "reynolds")
_READ = (*_SCALARS, "q", "r")
_BASELINE = (StaticMoment.name, PitchDamping.name)
MovedRecord = tuple[InertialRecord, ComplexArray]  # a record of a flight's times, and its crossflow (n,)


@dataclass(frozen=True)
class MomentModel:
    """`columns` of `mechanisms` with `values` (columns,) on a flight; linear about a recorded `motion` (m,)."""

    reconstruction: Reconstruction
    mechanisms: Mapping[str, Mechanism]
    columns: tuple[Regressor, ...]
    values: FloatArray
    motion: Motion

    def usual(self, kept: FloatArray) -> ComplexArray:
        """C_m + i C_n at the nodes (m, records). All but the baseline keeps the pressure and inertia of the
        linearisation point, which are `kept` (m, records) of a record's: its coefficients make up for both. A
        hypothesis without what is tested would take an error of either for a share of it, and a trim of many tolerances
        would make such an error likely, which a fraction of the static moment followed.
        """
        baseline, others = self._now
        return baseline[:, np.newaxis] + others[:, np.newaxis] * kept

    def changes(self, more: Sequence[MovedRecord], less: Sequence[MovedRecord], kept: FloatArray) -> ComplexArray:
        """How much more the moments (m, records) are than others', to first order; `kept` (m, records): see `usual`."""
        out = np.asarray(self._now[1][:, np.newaxis] * kept, dtype=complex)
        differences = self._differences(more, less)
        for ago, slopes in self._slopes.items():
            for name, change in self._earlier(differences, ago, slopes.keys()).items():
                out += slopes[name][:, np.newaxis] * change
        return out

    @cached_property
    def _now(self) -> tuple[ComplexArray, ComplexArray]:
        """The moments on the motion itself (see `_moments`)."""
        return self._moments(self.motion)

    @cached_property
    def _slopes(self) -> dict[float, dict[str, ComplexArray]]:
        """Slopes (m,) by what the motion is, and was so many seconds before: of the quantities that count."""
        found: dict[float, dict[str, ComplexArray]] = {}
        for ago in (0.0, *delays_requested(self.motion, self._moments)):
            there, found[ago] = self.motion.delayed(ago), {}
            own = {**_parts(*_crossflow(there)), **{name: getattr(there, name) for name in _READ}}
            for name, value in own.items():
                step = MOMENT_SLOPE_STEP * np.fmax(np.abs(value), 1.0)  # of what is not known, one
                ends = []
                for sign in (1.0, -1.0):
                    moved = _changed(there, {name: sign * step}, own)
                    if ago > 0.0:
                        moved = replace(self.motion, history=_NotedPast(self.motion, set(), (ago, moved)))
                    ends.append(np.sum(self._moments(moved), axis=0))
                slope = np.asarray((ends[0] - ends[1]) / (2.0 * step), dtype=complex)
                if np.any(slope):
                    found[ago][name] = slope
        return found

    def _differences(self, more: Sequence[MovedRecord], less: Sequence[MovedRecord]) -> dict[str, FloatArray]:
        """How much more each quantity is at the nodes (m, records) in some records than in others, where it is."""
        pairs, nodes = list(zip(more, less, strict=True)), self.reconstruction.nodes
        shifts = np.stack([xi - other for (_, xi), (_, other) in pairs], axis=1)
        rates = np.gradient(shifts, self.reconstruction.flight.time, axis=0)
        found = _parts(nodes.of(shifts), nodes.of(rates))
        records = [(one, other) for (one, _), (other, _) in pairs]
        if any(one.transverse_rate is not other.transverse_rate for one, other in records):
            turned = [one.transverse_rate - other.transverse_rate for one, other in records]
            turning = nodes.of(np.stack(turned, axis=1))
            found |= {"q": turning.real, "r": turning.imag}
        for name in _SCALARS:
            read = [(getattr(one.flight, name), getattr(other.flight, name)) for one, other in records]
            if any(one is not other for one, other in read):
                found[name] = nodes.of(np.stack([one - other for one, other in read], axis=1))
        return found

    def _earlier(self, changes: Mapping[str, FloatArray], ago: float, names: Collection[str]) -> dict[str, FloatArray]:
        """Changes (m, records) of some quantities so many seconds before; a motion is steady before its beginning."""
        known = {name: change for name, change in changes.items() if name in names}
        if ago == 0.0:
            return known
        time = self.motion.time
        since = time - ago - time[0]
        places = time[0] + np.maximum(since, 0.0)
        found = {name: CubicSpline(time, change)(places) for name, change in known.items()}
        early = since < 0.0
        xi, rate = (each[0] for each in _crossflow(self.motion))
        xi = xi if abs(xi) > CROSSFLOW_FLOOR else CROSSFLOW_FLOOR  # the meridian is undefined there
        more, faster = (changes[one][0] + 1j * changes[other][0] for one, other in (_TURNED[:2], _TURNED[2:]))
        growth = faster / xi - rate * more / xi**2
        past = _crossflow(self.motion.delayed(ago))[0][early, np.newaxis]
        turned = past * (more / xi + 1j * growth.imag * since[early, np.newaxis])
        for name, change in _parts(turned, turned * rate / xi + past * growth).items():
            if name in found:
                found[name][early] = change
        return found

    def _moments(self, motion: Motion) -> tuple[ComplexArray, ComplexArray]:
        """C_m + i C_n (m,) on a motion at the nodes: of the baseline, and of all else."""
        terms, found = evaluated(self.columns, self.mechanisms, motion), []
        for baseline in (True, False):
            some = [j for j, each in enumerate(self.columns) if (each.mechanism in _BASELINE) is baseline]
            shapes = (terms[j].in_plane + 1j * terms[j].out_of_plane for j in some)
            total = summed(shapes, (self._weights[j] for j in some), motion.time.astype(complex))
            found.append(motion.to_body(total.real, total.imag))
        return found[0], found[1]

    @cached_property
    def _weights(self) -> list[FloatArray]:
        """Each column's coefficient at the nodes (m,)."""
        time = self.motion.coefficient_time
        return [value * column.time_basis(time) for column, value in zip(self.columns, self.values, strict=True)]


def delays_requested(motion: Motion, read: Callable[[Motion], object]) -> tuple[float, ...]:
    """How many seconds ago the past of a motion is that `read` requests, in order."""
    delays = set[float]()
    read(replace(motion, history=_NotedPast(motion, delays)))
    return tuple(sorted(delays - {0.0}))


@dataclass(frozen=True)
class _NotedPast:
    """The past of a motion, which notes how long ago is `delays` for; another one so long ago, where it is given."""

    motion: Motion
    delays: set[float]
    other: tuple[float, Motion] | None = None
    ago: float = 0.0

    def __call__(self, tau: float) -> Motion:
        ago = self.ago + tau
        self.delays.add(ago)
        there = self.other[1] if self.other and self.other[0] == ago else self.motion.delayed(tau)
        return replace(there, history=replace(self, motion=there, ago=ago))


def _changed(motion: Motion, changes: Mapping[str, FloatArray], own: Mapping[str, FloatArray]) -> Motion:
    """A motion with so much more (m,) of some quantities than its `own`; its past stays."""
    more: dict[str, Any] = {name: own[name] + change for name, change in changes.items()}
    read = {name: value for name, value in more.items() if name in _READ}
    if len(read) == len(more):
        return replace(motion, **read)
    y, z, rate_y, rate_z = (more.get(name, own[name]) for name in _TURNED)
    return replace(with_crossflow(motion, y + 1j * z, rate_y + 1j * rate_z), **read)


def _crossflow(motion: Motion) -> tuple[ComplexArray, ComplexArray]:
    """The crossflow (m,) of a motion and its rate (m,) 1/s."""
    xi = crossflow(motion.alpha, motion.windward_meridian)
    return xi, crossflow_rate(motion, xi)


def _parts(xi: ComplexArray, rate: ComplexArray) -> dict[str, FloatArray]:
    """A crossflow and its rate as quantities."""
    return dict(zip(_TURNED, (xi.real, xi.imag, rate.real, rate.imag), strict=True))
