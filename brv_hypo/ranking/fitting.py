"""Every hypothesis fitted in one problem, which is linear about the leader.

Hypotheses that stop in different minima lend each other the knots and delays that they found (`exchanged`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from brv_hypo.constants import (
    CONVERGED_ERRORS,
    CONVERGED_FALL,
    CREDIBLE_PROBABILITY,
    LINEARISATIONS,
    LINEARISED_AGAIN,
    LINEARISED_IN_VAIN,
    NOISE_LEADER_SHARE,
    SEARCH_EXCHANGES,
    SEARCH_HOPELESS,
    SEARCH_OUT_OF_REACH,
    SEARCHED_AGAIN,
    TEMPERATURE,
)
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.model.term import Regressor
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.ranking.adequacy import Misfit, misfit
from brv_hypo.ranking.config import CompareConfig
from brv_hypo.ranking.intervals import within_bounds
from brv_hypo.ranking.preparation import Settings, about, cleaned, settled
from brv_hypo.regression.build import LinearisationPoint, farthest_apart, point_of
from brv_hypo.regression.channels import Noise
from brv_hypo.regression.fit import (
    HypothesisFit,
    fit_hypothesis,
    fit_on_grid,
    gains,
    likeliest,
    narrower,
    plainer,
    renewed,
    scanned,
    scanned_finely,
)
from brv_hypo.regression.fit import settled as refitted
from brv_hypo.regression.noise import raised_noise
from brv_hypo.regression.own_static_moment import converged
from brv_hypo.regression.problem import Problem
from brv_hypo.regression.refinement import SETTLED
from brv_hypo.regression.search import in_place_of, on_grid
from brv_hypo.regression.uncertainty import with_covariance, with_design


def exchanged(problem: Problem, fit: HypothesisFit) -> HypothesisFit:
    """The likeliest fit that a sequence of exchanges leads to; the fit itself where none gains.

    Bounds of coefficients are left aside, as they are in the search. Two knots that came to one place become one; the
    others may still stand where the grid has them, which a finer scan mends.
    """
    given, fit = fit, renewed(problem, fit)
    for _ in range(SEARCH_EXCHANGES if problem.refine else 0):
        tried = [
            refitted(problem, fit, (*problem.baseline, *columns), kept)
            for kept, taken in _without_each(fit.selected)
            for columns in in_place_of(problem, fit.frame, fit.mechanisms, kept, len(taken))
        ]
        best = likeliest([fit, *tried])
        if not gains(best, fit):
            break
        fit = scanned_finely(problem, plainer(problem, best))
    return likeliest([fit, given])


def _without_each(selected: Sequence[Regressor]) -> Iterator[tuple[tuple[Regressor, ...], tuple[Regressor, ...]]]:
    """What is kept and what is taken out, for the columns of each course and delay in turn."""
    for place in dict.fromkeys((column.mechanism, column.theta, column.time_basis) for column in selected):
        taken = tuple(c for c in selected if (c.mechanism, c.theta, c.time_basis) == place)
        yield tuple(column for column in selected if column not in taken), taken


# ---- Every hypothesis fitted in one problem, which is linear about the leader ----


Progress = Callable[[str], None]
Hypotheses = Mapping[str, tuple[Mechanism, ...]]


@dataclass(frozen=True)
class Fitted:
    """Every hypothesis fitted in a problem; `deviance` is that of the leader about which that is linear, if about one.

    `heard` is the noise beside that leader, where what it leaves is more.
    """

    problem: Problem
    fits: list[HypothesisFit]
    settings: Settings
    deviance: float = math.inf
    heard: Noise | None = None

    @cached_property
    def left(self) -> Misfit:
        """What the leader leaves."""
        return misfit(self.problem, likeliest(self.fits), next(fit for fit in self.fits if not fit.mechanisms))


def searched(
    reconstructions: Sequence[Reconstruction], config: CompareConfig, hypotheses: Hypotheses, say: Progress
) -> Fitted:
    """Every hypothesis fitted where the problem is linear; searched again there where something else stands."""
    problem, settings = settled(reconstructions, config)
    first = Fitted(problem, _fitted(problem, hypotheses, say), settings)
    found = _with_errors(_as_heard(_relinearised(first, config, say)))
    for _ in range(SEARCHED_AGAIN):
        if not _something_stands(found, config.other_prior):
            break
        say("searching again about the new linearisation")
        again = _searched_again(found, hypotheses, say)
        if likeliest(again.fits).information > likeliest(found.fits).information - CONVERGED_FALL:
            break
        found = _with_errors(_as_heard(_relinearised(again, config, say)))
    return found


def _relinearised(found: Fitted, config: CompareConfig, say: Progress) -> Fitted:
    """The fits in a problem linearised about the leader, until that lowers what is left no more.

    Where something else stands beside the leader, a linearisation that lowers it not at once may do so with the next;
    where nothing does, and errors of the record are those about which the problem is linear, none is needed.
    """
    patience = LINEARISED_IN_VAIN
    for _ in range(LINEARISATIONS):
        fallen = _deviance(found) <= found.deviance - CONVERGED_FALL
        patience -= not fallen
        # No leader yet about which the problem is linear, or one that leaves more than noise.
        lacking = math.isinf(found.deviance) or found.heard is not None or _something_stands(found, config.other_prior)
        if patience < 0 or not (lacking or (fallen and _errors_moved(found))):
            break
        point = _about_leader(found)
        records = None if point is None else cleaned(found.problem, point, found.settings)
        if point is None or records is None:
            break
        say(f"linearising about {'+'.join(mechanism.name for mechanism in point.mechanisms) or 'the baseline'}")
        fits, settings, before = found.fits, found.settings, _deviance(found)
        del found  # its problem is large, and about to be replaced
        problem = about(point, records, settings, config)
        found = _raised(Fitted(problem, _linearised(problem, fits), replace(settings, taken=point.taken), before))
    return found


def _errors_moved(found: Fitted) -> bool:
    """Whether the leader's errors of the record differ from those about which the problem is linear."""
    fit = likeliest(found.fits)
    return _apart(found, point_of(found.problem, fit.frame, fit.columns, fit.mechanisms))


def _apart(found: Fitted, point: LinearisationPoint) -> bool:
    return farthest_apart(found.problem, found.settings.taken, point.taken) >= CONVERGED_ERRORS


def _raised(found: Fitted) -> Fitted:
    """The fits under as much noise as the leader leaves, where that is more than noise.

    What it lacks would drive the errors of the record astray, and the next linearisation with them.
    """
    leader, problem = likeliest(found.fits), found.problem
    if len(problem.records) > 1 or not leader.mechanisms:
        return found
    noise = raised_noise(replace(problem, frame=leader.frame, baseline=leader.columns))
    heard = problem.rows.noise
    return found if noise.louder_than(heard) <= NOISE_LEADER_SHARE else replace(_under(found, noise), heard=heard)


def _as_heard(found: Fitted) -> Fitted:
    """The fits under the noise beside the leader, where the problem is under as much as that one leaves."""
    return found if found.heard is None else replace(_under(found, found.heard), heard=None)


def _under(found: Fitted, noise: Noise) -> Fitted:
    """The fits under another noise."""
    problem = found.problem.under(noise)
    return replace(found, problem=problem, fits=[renewed(problem, fit) for fit in found.fits])


def _linearised(problem: Problem, fits: Sequence[HypothesisFit]) -> list[HypothesisFit]:
    """The fits in a problem linearised about the leader: knots and delays come from where they lie.

    Those that stay out of reach keep theirs. Two of the leader's knots that came to one place become one.
    """
    at = [replace(fit, frame=problem.frame.with_mechanisms(fit.mechanisms)) for fit in fits]
    there = [renewed(problem, fit, ()) for fit in at]
    first = likeliest(there)
    moved = [
        scanned_finely(problem, renewed(problem, fit)) if _in_reach(stays, first) else stays
        for fit, stays in zip(at, there, strict=True)
    ]
    leader = likeliest(moved)
    return [plainer(problem, fit) if fit is leader and fit.mechanisms else fit for fit in moved]


def _searched_again(found: Fitted, hypotheses: Hypotheses, say: Progress) -> Fitted:
    """The likelier of each hypothesis as it was and as the problem about the leader has it, knots exchanged."""
    fits = found.fits
    if math.isfinite(found.deviance):
        anew = {fit.name: fit for fit in _fitted(found.problem, hypotheses, say, hopeless=math.inf)}
        fits = [likeliest([fit, anew[fit.name]]) for fit in fits]
    leader = likeliest(fits)
    return replace(found, fits=[exchanged(found.problem, fit) if _in_reach(fit, leader) else fit for fit in fits])


def _something_stands(found: Fitted, other_prior: float) -> bool:
    """Whether something outside the list stands beside the leader: a term that was chosen elsewhere may be amiss."""
    scores = -0.5 / TEMPERATURE * np.array([fit.information for fit in found.fits])
    beside = -0.5 / TEMPERATURE * (likeliest(found.fits).information - found.left.gain)
    other = beside + math.log(other_prior / (1.0 - other_prior) * scores.size)
    return bool(other - logsumexp([other, *scores]) >= math.log(CREDIBLE_PROBABILITY))


def _fitted(
    problem: Problem, hypotheses: Hypotheses, say: Progress, hopeless: float = SEARCH_HOPELESS
) -> list[HypothesisFit]:
    """Every hypothesis searched; the likeliest on the grid first, so that those so far behind can end early."""
    say("searching on the grid of knots and delays")
    grids = {name: on_grid(problem, mechanisms) for name, mechanisms in hypotheses.items() if mechanisms}
    first = sorted(
        (fit_on_grid(problem, *each, grids.get(each[0])) for each in hypotheses.items()),
        key=lambda fit: fit.information,
    )
    problem = _with_efficiency(problem, renewed(problem, likeliest(first)))
    fits: list[HypothesisFit] = []
    for each in first:
        say(f"fitting {each.name}")
        rival = min((fit.information for fit in fits), default=math.inf)
        fit = _without_hope(problem, each, rival + hopeless)
        fits.append(fit or fit_hypothesis(problem, each.name, each.mechanisms, rival, grids.get(each.name)))
    return fits


def _without_hope(problem: Problem, rough: HypothesisFit, most: float) -> HypothesisFit | None:
    """The rough fit, its knots and delays scanned, where even that leaves it beyond `most`; None elsewhere."""
    if not rough.mechanisms or rough.information <= most:
        return None
    fit = scanned(problem, rough)
    return replace(fit, ended_early=True) if fit.information > most else None


def _about_leader(found: Fitted) -> LinearisationPoint | None:
    """The leader's fit, where errors of second order about the last point may show: they would pose as something else.

    What a large moment does to the motion is not small, nor are errors of the record that differ from those about which
    the problem is linear.
    """
    leader = likeliest(found.fits)
    null = next(fit for fit in found.fits if not fit.mechanisms)
    fit = converged(found.problem, leader)
    point = point_of(found.problem, fit.frame, fit.columns, fit.mechanisms)
    return point if _apart(found, point) or null.rss - leader.rss > LINEARISED_AGAIN else None


def _deviance(found: Fitted) -> float:
    """Minus twice the log-likelihood of what the leader leaves, but for a constant: each problem has its own noise."""
    rows = found.problem.rows
    levels = math.log(rows.noise.rates.sigma) + math.log(rows.noise.force.sigma)
    return likeliest(found.fits).rss + 2.0 * rows.rates * levels


def _with_errors(found: Fitted) -> Fitted:
    """The fits with the uncertainty of their coefficients, and the problem at the sample size that goes with it."""
    leader = likeliest(found.fits)
    anew = [(converged if _in_reach(fit, leader) else _at_rest)(found.problem, fit) for fit in found.fits]
    there = next(fit for fit in anew if fit.name == leader.name)
    problem = _with_efficiency(found.problem, there)
    return replace(found, problem=problem, fits=[with_design(problem, _bounded(problem, fit, there)) for fit in anew])


def _in_reach(fit: HypothesisFit, leader: HypothesisFit) -> bool:
    """Whether a fit may still come near the leader."""
    return fit.information <= leader.information + SEARCH_OUT_OF_REACH


def _at_rest(problem: Problem, fit: HypothesisFit) -> HypothesisFit:
    """The fit where the steps of its knots and delays end, C_mw as the fit found it."""
    return renewed(problem, fit, SETTLED)


def _bounded(problem: Problem, fit: HypothesisFit, leader: HypothesisFit) -> HypothesisFit:
    """The fit with covariance and the price of its bounds; a plainer one where the terms beyond bring less than that.

    Two knots that nearly meet may hold a value of any size between them, for next to nothing.
    """
    own = _priced(problem, fit)
    if own.bound_cost == 0.0 or not problem.refine or not _in_reach(fit, leader):
        return own
    plain = likeliest([own, *(_priced(problem, each) for each in narrower(problem, fit))])
    return own if plain is own else likeliest([own, _priced(problem, converged(problem, plain))])


def _priced(problem: Problem, fit: HypothesisFit) -> HypothesisFit:
    """The fit with covariance and the price of its bounds."""
    return within_bounds(with_covariance(problem, fit))


def _with_efficiency(problem: Problem, leader: HypothesisFit) -> Problem:
    """The problem with the effective share of samples that the leader's residual shows."""
    return problem.at_efficiency(problem.efficiency_of(leader.residual))
