"""Whether the leading fit is adequate: its lack of fit, and moments outside the list that may be there instead."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import stats
from scipy.special import logsumexp

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import (
    DETECTABLE,
    LEVEL_SIGMAS,
    ONE_STRETCH,
    OTHER_FLOOR,
    OTHER_SIZES,
    OTHER_UNSEEN,
    OUTSIDE,
    SECOND_ORDER,
    SECOND_ORDER_VALUES,
)
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.common_time import at
from brv_hypo.model.term import Regressor
from brv_hypo.regression.fit import HypothesisFit, fit_hypothesis, likeliest, solved
from brv_hypo.regression.free_moment import ORDINARY, SHAPES, free_moment
from brv_hypo.regression.linear import lengths
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.reduced import Reduced
from brv_hypo.regression.refinement import nonlinear_parameters
from brv_hypo.regression.unlisted import (
    RATE,
    UnlistedMoment,
    particular_share,
    plain_columns,
    turning_moment,
    unlisted_moment,
)
from brv_hypo.regression.whitening import MEDIAN_EFFICIENCY


@dataclass(frozen=True)
class Misfit:
    """What a hypothesis leaves: `ratio` residual rms over the noise, `p_value` that no smooth moment is left in it.

    `gain` is twice the logarithm of the marginal likelihood of "something else" beside it over its own, or what the
    rates hold beyond the noise, smooth or not, where that is more; less what errors of second order may bring.
    `errors_p_value`: how probable the errors of record and vehicle that it asks for are under their tolerances, but for
    the same.
    """

    ratio: float
    p_value: float
    gain: float
    errors_p_value: float = 1.0


class _Beside(NamedTuple):
    """A free moment beside a fit: how well each direction of it is seen, and what the residual has there."""

    seen: FloatArray
    found: FloatArray


def misfit(problem: Problem, fit: HypothesisFit, null: HypothesisFit) -> Misfit:
    """Test what a fit leaves against free, smooth moments beside it, at the noise that the record itself has.

    `null` is the fit of the baseline alone.
    """
    beside = list(_beside(problem, fit))
    found = beside[0].found
    ratio = float(np.sqrt(fit.rss / problem.samples))
    rest = max(fit.rss - float(found @ found), 1e-300)
    free_samples = max(problem.samples - fit.parameters - found.size, 1)
    f_ratio = (float(found @ found) / found.size) / (rest / free_samples)
    share = problem.efficiency
    p_value = float(stats.f.sf(f_ratio, found.size, max(free_samples * share, 1.0)))
    brought = share * max(null.rss - fit.rss, 0.0)
    smooth = _gain([_Beside(np.sqrt(share) * each.seen, np.sqrt(share) * each.found) for each in beside])
    gain = max(smooth, share * _louder(fit.residual[: problem.rows.rates])) - OTHER_FLOOR
    gain -= SECOND_ORDER * brought
    asked = fit.residual[2 * problem.rows.rates :]
    squares = max(float(asked @ asked) - SECOND_ORDER_VALUES * brought, 0.0)
    errors_p_value = stats.chi2.sf(squares, max(asked.size, 1))
    return Misfit(ratio, p_value, gain, float(errors_p_value))


def _beside(problem: Problem, fit: HypothesisFit) -> Iterator[_Beside]:
    """The ordinary shapes together, then every shape alone, each of unit rms moment."""
    base = problem.design(fit.frame, fit.columns)
    basis = np.linalg.qr(base / lengths(base))[0]
    for shapes in (ORDINARY, *((shape,) for shape in SHAPES)):
        frame, columns = free_moment(problem, shapes)
        sizes = np.sqrt([np.mean(np.abs(frame.moments((column,))) ** 2) for column in columns])
        free = problem.design(frame, columns) / np.where(sizes > 0.0, sizes, 1.0)
        left, seen, _ = np.linalg.svd(free - basis @ (basis.T @ free), full_matrices=False)
        kept = seen > OTHER_UNSEEN * seen[0]
        yield _Beside(seen[kept], left[:, kept].T @ fit.residual)


def _louder(rates: FloatArray) -> float:
    """Squares (unit noise) of whitened rates beyond what the noise explains with the errors of its own level."""
    level_error = np.sqrt(2.0 / rates.size * (1.0 + 1.0 / MEDIAN_EFFICIENCY))
    return float(rates @ rates - rates.size * (1.0 + LEVEL_SIGMAS * level_error))


def _gain(beside: Sequence[_Beside]) -> float:
    """2 ln of the marginal likelihood ratio, averaged over shapes and sizes of the free moment."""
    gains = []
    for seen, found in beside:
        weakest = DETECTABLE / float(np.sum(seen**2))
        for power in range(OTHER_SIZES):
            strength = weakest * 4.0**power * seen**2
            gains.append(float(np.sum(strength / (1.0 + strength) * found**2 - np.log1p(strength))))
    return 2.0 * float(logsumexp(0.5 * np.array(gains)) - np.log(len(gains)))


# ---- What outside the list would explain a flight instead of the leader, rather than beside it ----


@dataclass(frozen=True)
class Alternative:
    """Something outside the list, fitted as a hypothesis of its own, and what it is in words."""

    words: str
    fit: HypothesisFit


def alternatives(
    problem: Problem, hypotheses: Mapping[str, Sequence[Mechanism]], fits: Sequence[HypothesisFit]
) -> tuple[Alternative, ...]:
    """The best moment of shapes that nothing on the list has, and a change that many things bring.

    A leader whose characteristic terms explain next to nothing is such a change, and no likelier than that. What begins
    when the leader does, but with more coefficients than it claims, is another.
    """
    leader = likeliest(fits)
    found = []
    null = next(fit for fit in fits if not fit.mechanisms)
    if not is_particular(problem, null, leader):
        terms = ", ".join(dict.fromkeys(column.term for column in plain_columns(leader)))
        found.append(Alternative(f"a change of {terms} alone, which is not specific to {leader.name}", leader))
    if (event := _event(problem, leader)) is not None:
        found.append(event)
    listed = {mechanism.name: mechanism for group in hypotheses.values() for mechanism in group}
    unlisted = unlisted_moment(problem, tuple(listed.values()), OUTSIDE)
    if unlisted is not None:
        found.append(_instead_of(leader, problem, unlisted))
    if (stretch := _many_steps(leader)) is not None:
        turning = turning_moment(problem, tuple(listed.values()), OUTSIDE, *stretch)
        if turning is not None:
            found.append(_instead_of(leader, problem, turning))
    return tuple(found)


def is_particular(problem: Problem, null: HypothesisFit, fit: HypothesisFit) -> bool:
    """Whether what is characteristic of its mechanisms explains more of what a fit does than next to nothing."""
    return particular_share(problem, null, fit) > OUTSIDE**2


def _event(problem: Problem, leader: HypothesisFit) -> Alternative | None:
    """All ordinary coefficients changing when the leader's do, as a nose tip's loss changes stiffness and trim; None
    where the leader changes at no time, or too often for one event.
    """
    bases = list(dict.fromkeys(c.time_basis for c in leader.selected if c.time_basis.kind == "jump"))
    if not 0 < len(bases) <= ONE_STRETCH:
        return None
    moment = UnlistedMoment(shapes=ORDINARY)
    frame = problem.frame.with_mechanisms([moment])
    terms = moment.terms(frame.motions[0], {})
    changing = [Regressor(moment.name, term.name, (), basis, term.units) for basis in bases for term in terms]
    columns = (*problem.baseline, *changing)
    fit = solved(Reduced(problem, frame), "event", (moment,), columns, leader.searched)
    nonlinear = nonlinear_parameters(columns, fit.baseline_size, frame, problem.knots)
    since = at(frame.common, bases[0].start)
    return Alternative(f"a change of several coefficients at once at {since}", replace(fit, nonlinear=nonlinear))


def _instead_of(leader: HypothesisFit, problem: Problem, moment: Mechanism) -> Alternative:
    """The best fit of a moment as a mechanism."""
    fit = fit_hypothesis(problem, moment.name, (moment,), leader.information)
    return Alternative(_described(fit), fit)


def _many_steps(leader: HypothesisFit) -> tuple[float, float] | None:
    """The first and last time at which the leader changes, where it does so more often than one stretch needs."""
    starts = {column.time_basis.start for column in leader.selected if column.time_basis.kind != "constant"}
    return (min(starts), max(starts)) if len(starts) > ONE_STRETCH else None


def _described(fit: HypothesisFit) -> str:
    shapes = " and ".join(dict.fromkeys(_shape(column) for column in fit.selected))
    starts = [column.time_basis.start for column in fit.selected if column.time_basis.kind != "constant"]
    since = f" from {at(fit.frame.common, min(starts))}" if starts else ""
    return f"a moment that no mechanism on the list has ({shapes}{since})"


def _shape(column: Regressor) -> str:
    rate = dict(column.theta).get(RATE)
    return column.term if rate is None else f"turning in the body at {rate:.3g} rad/s"
