"""Moments that no listed mechanism has: shapes that any body has, smooth in time, or turning slowly in the body.

The shapes are the lowest of the expansion of a body's moment in its crossflow (Maple and Synge, Quart. Appl. Math. 6,
1949): on a body of n-fold symmetry the moment of the flow from the other side turns n times with the meridian. Some of
them, each times splines in time, are what the noise is found beside (`free_moment`); one alone, acting in a stretch of
time, is tried in a mechanism's place (`unmodelled_moments`), as one that turns in the body (`turning_moment`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.inference.fit import HypothesisFit
from brv_hypo.inference.problem import Problem
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.mechanisms.checked import checked
from brv_hypo.mechanisms.contract import Mechanism, Parameter, Term
from brv_hypo.model.term import Regressor
from brv_hypo.motion.interpolation import time_splines
from brv_hypo.motion.motion import Motion
from brv_hypo.thresholds import OUTSIDE

# Splines in time of each shape of the free moment that the noise is left by, and rows that each column needs: they take
# at most a twelfth of the noise with them.
FREE_MOST_SPLINES = 10
FREE_FEWEST_SPLINES = 4
FREE_ROWS_PER_COLUMN = 12
# A moment that turns in the body: rates tried at most, half to either side (beyond half a turn a record apart they are
# independent), and times the motion's own (roll, and the meridian's in nine tenths of the time) up to which it turns.
TURNING_RATES = 160
TURNING_FASTEST = 3.0
TURNING_MERIDIAN = 90.0  # percentile of the meridian's rate
Shape = Callable[[Motion], tuple[ComplexArray, ...]]
_Key = TypeVar("_Key")
_SAME = 1e-6  # of its rms, below which a moment is of the same law
_SHAPE = "shape"  # the parameter that selects one


def _power(power: int, factor: complex = 1.0) -> Shape:
    """Of the windward plane: C_N' for a real factor, C_Z' for an imaginary one."""
    return lambda motion: (np.asarray(factor * motion.alpha**power, dtype=complex),)


def _harmonic(power: int, turns: int) -> Shape:
    """Turning with the meridian, in both directions of the body."""

    def shape(motion: Motion) -> tuple[ComplexArray, ...]:
        turned = motion.alpha**power * np.exp(1j * turns * motion.windward_meridian)
        return turned, 1j * turned

    return shape


def _lobed(factor: complex) -> Shape:
    """Of the windward plane, or across it, as of a body that is no circle in section: twice a turn of the meridian."""

    def shape(motion: Motion) -> tuple[ComplexArray, ...]:
        turned = motion.alpha * np.exp(2j * motion.windward_meridian)
        return factor * turned.real, factor * turned.imag

    return shape


def _rates(motion: Motion) -> tuple[ComplexArray, ...]:
    """In proportion to the transverse rates."""
    return (motion.plane_rates,)


def _either(shape: Shape) -> Shape:
    """In the windward plane and across it, in any proportion."""
    return lambda motion: tuple(factor * each for each in shape(motion) for factor in (1.0, 1j))


_ORDINARY: dict[str, Shape] = {
    "offset": _power(0),
    "stiffness": _power(1),
    "side moment": _power(1, 1j),
    "body-fixed": _harmonic(0, 1),
    "pitch damping": _rates,
}
_EITHER = {"constant": _either(_power(0)), "nonlinear": _either(_power(2)), "by the rates": _either(_rates)}
_UNUSUAL: dict[str, Shape] = {
    **_EITHER,
    "nonlinear stiffness": _power(2),
    "body-fixed by alpha": _harmonic(1, 1),
    "two-fold": _harmonic(1, 2),
    "two-lobed in plane": _lobed(1.0),
    "two-lobed side moment": _lobed(1j),
    "three-fold": _harmonic(2, 3),
}
SHAPES = {**_ORDINARY, **_UNUSUAL}
"""By name what makes the components C_N' + i C_Z' (n,) of a shape on a motion, per unit of each coefficient."""
ORDINARY = tuple(_ORDINARY)  # what moves most vehicles: beside these the noise is found


class FreeMoment(Mechanism):
    """Some of the shapes, each times splines in time; `theta` selects one: all at once would be large."""

    name = "free_moment"
    title = "a moment that is free but smooth"
    claims = "nothing specific: any moment that moved the vehicle"
    source = "Maple and Synge 1949; nonparametric regression"
    time_variation = ("constant",)

    start: float
    stop: float
    splines: int
    shapes: tuple[str, ...]

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """One shape times each spline."""
        name = self.shapes[int(theta[_SHAPE])]
        splines = time_splines(motion.coefficient_time, self.start, self.stop, self.splines)
        return tuple(
            Term(f"{name} {part} {k}", values.real * spline, values.imag * spline)
            for part, values in enumerate(SHAPES[name](motion))
            for k, spline in enumerate(splines.T)
        )


def free_moment(problem: Problem, shapes: tuple[str, ...] = ORDINARY) -> tuple[RateFrame, tuple[Regressor, ...]]:
    """The problem's frame with a free moment of these shapes, and that moment's columns."""
    time, motion = problem.frame.coefficient_time, problem.frame.motions[0]
    parts = {name: len(SHAPES[name](motion)) for name in (*ORDINARY, *shapes)}
    rows = problem.frame.observed.size * 2
    wanted = rows / (FREE_ROWS_PER_COLUMN * sum(parts[name] for name in ORDINARY))
    count = int(np.clip(wanted, FREE_FEWEST_SPLINES, FREE_MOST_SPLINES))
    free = FreeMoment(start=float(time.min()), stop=float(time.max()), splines=count, shapes=shapes)
    columns = tuple(
        Regressor(free.name, f"{name} {part} {k}", ((_SHAPE, float(number)),))
        for number, name in enumerate(shapes)
        for part in range(parts[name])
        for k in range(count)
    )
    return problem.frame.with_mechanisms([free]), columns


# ---- Tried in the place of a mechanism ----


class UnmodelledMoment(Mechanism):
    """The shapes of a body's moment in its crossflow (Maple and Synge 1949) by name, acting in stretches of time."""

    name = "unlisted_moment"
    title = "a moment of a shape that no mechanism on the list has"
    claims = "nothing specific: any other moment that moved the vehicle"
    source = "Maple and Synge 1949"

    shapes: tuple[str, ...]

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """Every component of every shape; those of one shape are one vector, whatever the body axes are."""
        found = []
        for name in self.shapes:
            components = SHAPES[name](motion)
            if len(components) == 1:
                found.append(Term(name, components[0].real, components[0].imag))
            else:
                names = ("in plane", "across") if name in _EITHER else ("cosine", "sine")
                parts = zip(names, components, strict=True)
                found += [Term(f"{name} {part}", each.real, each.imag, vector=name) for part, each in parts]
        return tuple(found)


def unmodelled_moments(problem: Problem, listed: Sequence[Mechanism]) -> tuple[UnmodelledMoment, ...]:
    """One of each shape that no listed mechanism reproduces, but for the share `OUTSIDE` of its rms."""
    names = _unlike(SHAPES, listed, problem.frame.motions)
    return tuple(UnmodelledMoment(shapes=(name,)) for name in names)


RATE = "rate"


class TurningMoment(Mechanism):
    """A transverse moment that turns in body axes at one of `rates` (rad/s, rising, `apart`), along them at `about`."""

    name = "turning_moment"
    title = "a moment that turns in the body"
    claims = "nothing specific: a moment as of separated flow, a wake or loose mass"
    source = "a rotating vector in body axes"
    terms_enter_together = True

    about: float
    rates: tuple[float, ...]
    apart: float

    def at(self, rate: float) -> TurningMoment:
        """The one of one rate, which moves half-way to its neighbours: not to a moment at rest."""
        return self.model_copy(update={"rates": (rate,)})

    def parameters(self) -> tuple[Parameter, ...]:
        """The rate."""
        reach = (self.rates[0] - 0.5 * self.apart, self.rates[-1] + 0.5 * self.apart)
        return (Parameter(RATE, "rad/s", self.rates, reach, "rate of turning in body axes"),)

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """The two components."""
        along = np.exp(1j * (motion.windward_meridian - theta[RATE] * (motion.time - self.about)))
        components = zip(("turning y", "turning z"), (along, 1j * along), strict=True)
        return tuple(Term(name, each.real, each.imag) for name, each in components)


def turning_moment(problem: Problem, listed: Sequence[Mechanism], start: float, stop: float) -> TurningMoment | None:
    """Of rates that turn by half a turn or more from `start` to `stop` s, but for those at which a
    listed mechanism reproduces all but the share `OUTSIDE` of its rms; None where there is none.
    """
    offered, apart = turning_rates(problem.frame.motions, stop - start)
    every = TurningMoment(about=start, rates=tuple(offered.tolist()), apart=apart)
    turning = {rate: partial(_components, every, {RATE: rate}) for rate in every.rates}
    rates = _unlike(turning, listed, problem.frame.motions)
    return every.model_copy(update={"rates": rates}) if rates else None


def _unlike(shapes: Mapping[_Key, Shape], listed: Sequence[Mechanism], motions: Sequence[Motion]) -> tuple[_Key, ...]:
    """Which shapes have over all flights more than the share `OUTSIDE` of their rms beyond each listed mechanism."""

    def stacked(shape: Shape) -> FloatArray:
        """Its components, real above imaginary (2 samples of all flights, components)."""
        components = [np.concatenate(each) for each in zip(*map(shape, motions), strict=True)]
        return np.stack([np.concatenate([each.real, each.imag]) for each in components], axis=1)

    # A mechanism with nonlinear parameters has no shape of its own.
    plain = (partial(_components, each, {}) for each in listed if not each.parameters())
    bases = [np.linalg.qr(stacked(shape))[0] for shape in plain]

    def is_unlike(own: FloatArray) -> bool:
        lengths = np.linalg.norm(own, axis=0)
        rest = (np.linalg.norm(own - basis @ (basis.T @ own), axis=0) for basis in bases)
        return all(np.max(each / lengths) > OUTSIDE for each in rest)

    return tuple(key for key, shape in shapes.items() if is_unlike(stacked(shape)))


def _components(mechanism: Mechanism, theta: Mapping[str, float], motion: Motion) -> tuple[ComplexArray, ...]:
    terms = checked(mechanism).terms(motion, dict(theta))
    return tuple(term.in_plane + 1j * term.out_of_plane for term in terms)


def turning_rates(motions: Sequence[Motion], duration: float) -> tuple[FloatArray, float]:
    """Rates, rad/s, at which a moment is looked for that turns in the body, none at rest, and how far they are apart:
    half a turn in so many s, or more where the fastest would not be among so many.
    """
    fastest = 0.0
    for motion in motions:
        meridian = np.percentile(np.abs(motion.windward_meridian_rate), TURNING_MERIDIAN)
        own = TURNING_FASTEST * (float(np.mean(np.abs(motion.p))) + float(meridian))
        fastest = max(fastest, min(own, 0.5 * np.pi / float(np.median(np.diff(motion.time)))))
    apart = max(np.pi / duration, 2.0 * fastest / TURNING_RATES)
    count = int(fastest / apart)
    return apart * np.array([k for k in range(-count, count + 1) if k], dtype=float), apart


def plain_columns(fit: HypothesisFit) -> tuple[Regressor, ...]:
    """The selected columns without those that are characteristic of a mechanism."""
    specific = {(mechanism.name, term) for mechanism in fit.mechanisms for term in mechanism.characteristic}
    return tuple(column for column in fit.selected if (column.mechanism, column.term) not in specific)


_PLAIN = {
    "constant in plane": "a constant moment in plane",
    "constant across": "a constant moment across",
    "stiffness": "one in proportion to alpha, in plane",
    "side moment": "one in proportion to alpha, across",
}
PLAIN = UnmodelledMoment(shapes=("constant", "stiffness", "side moment"))


def plain_instead(fit: HypothesisFit) -> tuple[tuple[Regressor, ...], str]:
    """The plain moments that a hypothesis makes while it acts, but for less than the share `OUTSIDE` of their rms, in
    place of its columns, and in words; empty where the record tests the law of one. What is in proportion to a roll
    rate that hardly varies is such a moment.
    """
    frame, like = fit.frame.with_mechanisms([*fit.mechanisms, PLAIN]), dict[tuple[str, str], str]()
    every = frame.moments([Regressor(PLAIN.name, name) for name in _PLAIN])
    made = frame.moments(fit.selected) * fit.values[fit.baseline_size :]
    for key in dict.fromkeys((c.mechanism, c.term) for c in fit.selected):
        own = made[:, [(c.mechanism, c.term) == key for c in fit.selected]].sum(axis=1)
        acts = np.abs(own) > _SAME * np.max(np.abs(own))
        along = np.real(np.conj(every[acts].T) @ own[acts]) / np.linalg.norm(every[acts], axis=0)
        unlike = np.sqrt(np.maximum(1.0 - (along / np.linalg.norm(own)) ** 2, 0.0))
        if any(c.theta for c in fit.selected) or not _SAME < np.min(unlike) < OUTSIDE:
            return (), ""
        like[key] = list(_PLAIN)[int(np.argmin(unlike))]
    columns = tuple(replace(c, mechanism=PLAIN.name, term=like[c.mechanism, c.term]) for c in fit.selected)
    return columns, " and ".join(dict.fromkeys(_PLAIN[each.term] for each in columns))
