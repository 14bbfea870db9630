"""How often a comparison ends the same when it is repeated. Entrances: `repetitions`, `stability`.

Repetitions are without a part of the record, with inertia or dynamic pressure a tolerance off, from other knots, and on
the motion of other reconstruction methods. Coefficients and nuisances are fitted anew in each.

Other knots: the grid of knots is the analyst's choice; that of another lies half a spacing off at most. A search moves
every knot from its place on the grid to where the data want it, so that another grid matters only where it leads to
another minimum, in which another mechanism may fit better.

Other methods, those of the report and Appendix A: terms are what they are on another method's own motion, which is off
by some percent of alpha; what that leaves of the record counts as noise. It is no repetition where the accelerometers
contradict the method beyond its own stated error, or where what separates the leader from a rival would drown in what
the method leaves.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.constants import CONVERGED_FALL, DETECTABLE, KNOT_SHIFTS, METHOD_SIGMAS, REPEATED_ERRORS, REPEATED_WITHIN
from brv_hypo.errors import UnanswerableError
from brv_hypo.model.term import Regressor
from brv_hypo.motion import Reconstruction, ReconstructionConfig, reconstruct
from brv_hypo.motion.config import Method
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.methods import method_names
from brv_hypo.motion.motion import at_nodes
from brv_hypo.ranking.verdict import Contest, Stability
from brv_hypo.regression.build import normal_force_slope
from brv_hypo.regression.channels import ForceModel
from brv_hypo.regression.fit import HypothesisFit, likeliest, scanned_finely, settled
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.held_out import FitsWithout
from brv_hypo.regression.linear import solve_scaled
from brv_hypo.regression.problem import Problem

# ---- A comparison repeated: the criterion of every candidate in each repetition ----


Criteria = Mapping[str, float]
"""The criterion of each candidate, by name."""


@dataclass(frozen=True)
class Repeated:
    """Criteria on the record as it is, and in each repetition of one kind, under the same likelihood."""

    whole: Criteria
    each: Sequence[Criteria]


def criteria(fits: Sequence[HypothesisFit]) -> Criteria:
    """Those of fits as they are."""
    return {fit.name: fit.information for fit in fits}


def criteria_at(fits: Sequence[HypothesisFit], rss: Mapping[str, float]) -> Criteria:
    """Those of fits with these residual sums of squares."""
    return {fit.name: replace(fit, residual=np.array([np.sqrt(rss[fit.name])])).information for fit in fits}


# ---- Repetitions from other knots ----


def on_other_knots(problem: Problem, fits: Sequence[HypothesisFit]) -> Repeated:
    """All knots moved by each of `KNOT_SHIFTS` and refined from there as in the search, delays with them.

    Hypotheses `REPEATED_WITHIN` behind the leader stay as they are. None where nothing has a knot that may move.
    """
    whole = criteria(fits)
    reach = min(whole.values()) + REPEATED_WITHIN
    moving = [fit for fit in fits if fit.information <= reach and any(p.kind == "knot" for p in fit.nonlinear)]
    shifts = KNOT_SHIFTS if moving else ()
    return Repeated(
        whole, [{**whole, **{fit.name: _refined(problem, fit, shift) for fit in moving}} for shift in shifts]
    )


def _refined(problem: Problem, fit: HypothesisFit, shift: float) -> float:
    """The criterion of a fit that was refined from knots so many spacings later; finely where that ends elsewhere."""
    found = replace(settled(problem, fit, _shifted(fit, shift), ()), bound_cost=fit.bound_cost)
    if found.information > fit.information + CONVERGED_FALL:
        found = replace(scanned_finely(problem, found), bound_cost=fit.bound_cost)
    return found.information


def _shifted(fit: HypothesisFit, shift: float) -> tuple[Regressor, ...]:
    """The columns of a fit with its knots so many spacings later, within the record."""
    columns = fit.columns
    for parameter in fit.nonlinear:
        if parameter.kind == "knot":
            low, high = parameter.bounds
            reach = high - parameter.value if shift > 0.0 else parameter.value - low
            columns = parameter.moved(columns, parameter.value + shift * reach)
    return columns


# They take a start and follow it: what they give does not depend on how the record was reconstructed.
OPEN_LOOP: tuple[Method, ...] = method_names()[1:]


def on_other_motions(problem: Problem, fits: Sequence[HypothesisFit]) -> Repeated:
    """The columns of the fits on the motion of each other method that can tell; delays and knots stay."""
    return Repeated(criteria(fits), list(_criteria(problem, fits)))


def _criteria(problem: Problem, fits: Sequence[HypothesisFit]) -> Iterator[Criteria]:
    parted = _parted_by(problem, fits)
    for method in OPEN_LOOP if parted >= DETECTABLE else ():
        found = _reconstructed(problem, method)
        if found is None or not all(map(agrees, problem.records, problem.frame.reconstructions, found)):
            continue
        rss = {fit.name: _rss_on(problem, fit, found) for fit in fits}
        if parted >= DETECTABLE * min(rss.values()) / problem.samples:
            yield criteria_at(fits, rss)


def _parted_by(problem: Problem, fits: Sequence[HypothesisFit]) -> float:
    """2 ln L that parts the leader from the nearest rival, at the record's noise."""
    leader = likeliest(fits)
    return problem.efficiency * min((fit.rss - leader.rss for fit in fits if fit is not leader), default=0.0)


def _reconstructed(problem: Problem, method: Method) -> list[Reconstruction] | None:
    """What the method makes of the flights as the problem has them; None where it was theirs, or has no answer."""
    own = problem.frame.reconstructions
    if any(each.method == method for each in own):
        return None
    try:
        return [reconstruct(each.flight, ReconstructionConfig(method=method)) for each in own]
    except UnanswerableError:
        return None


def agrees(record: InertialRecord, own: Reconstruction, other: Reconstruction) -> bool:
    """Whether the transverse force follows a method's motion as well as its stated error of alpha allows."""
    seen = record.measured
    model = ForceModel(normal_force_slope(own), own.normal_force_bend)
    columns, force = model.columns(record, other.crossflow)[seen], record.transverse_force[seen]
    stacked, response = np.concatenate([columns.real, columns.imag]), np.concatenate([force.real, force.imag])
    left = response - stacked @ solve_scaled(stacked, response)
    stated = np.sqrt(np.mean(other.alpha_sigma[seen] ** 2) / np.mean(np.abs(other.crossflow[seen]) ** 2))
    expected = np.hypot(own.accel_sigma, stated * np.sqrt(np.mean(response**2)))
    return bool(np.sqrt(np.mean(left**2)) <= METHOD_SIGMAS * expected)


def _rss_on(problem: Problem, fit: HypothesisFit, motions: Sequence[Reconstruction]) -> float:
    """What the fit's columns leave of the record with the terms of other motions."""
    basis = np.linalg.qr(problem.design(_moved(fit, motions), fit.columns))[0]
    left = problem.response - basis @ (basis.T @ problem.response)
    return float(left @ left)


def _moved(fit: HypothesisFit, motions: Sequence[Reconstruction]) -> RateFrame:
    """The fit's frame with other motions, in the time that flights share."""
    common = [own.common_time for own in fit.frame.motions]
    moved = [replace(rec.motion, common_time=time) for rec, time in zip(motions, common, strict=True)]
    nodes = [own.nodes for own in fit.frame.reconstructions]
    finer = tuple(at_nodes(motion, own) for motion, own in zip(moved, nodes, strict=True))
    frame = replace(fit.frame, motions=tuple(moved), finer=finer)
    if any(mechanism.parameters() for mechanism in fit.mechanisms):
        frame = frame.with_in_plane_moment(fit.columns, fit.values)
    return frame


# ---- How often a comparison ends the same when it is repeated ----


def repetitions(
    problem: Problem, fits: Sequence[HypothesisFit], without: Sequence[FitsWithout], blocks: Sequence[int]
) -> tuple[Repeated, ...]:
    """Every repetition of a comparison of these fits, by kind.

    `without` are the fits of the same columns without blocks, one for each of `fits`; `blocks` says into how many the
    record is divided, of which one is left out in turn.
    """
    return (
        without_blocks(fits, without, blocks),
        within_tolerances(problem, fits),
        on_other_knots(problem, fits),
        on_other_motions(problem, fits),
    )


def stability(contest: Contest, repeated: Sequence[Repeated]) -> Stability:
    """Shares of all repetitions that end as the record does, judged by the same rules, and that have its leader."""
    pairs = [(contest.repeated(kind.whole), contest.repeated(each)) for kind in repeated for each in kind.each]
    ends = [(one.outcome, one.winner) == (other.outcome, other.winner) for one, other in pairs]
    leads = [one.leader is other.leader for one, other in pairs]
    return Stability(sum(ends) / max(len(ends), 1), sum(leads) / max(len(leads), 1))


def without_blocks(fits: Sequence[HypothesisFit], without: Sequence[FitsWithout], blocks: Sequence[int]) -> Repeated:
    """Without each block in turn; delays and knots stay.

    The whole record is under the same likelihood, in which rows may be left out (`Problem.untied`).
    """
    whole = {fit.name: each.nothing for fit, each in zip(fits, without, strict=True)}
    left_out = [
        {fit.name: each.rest for fit, each in zip(fits, repetition, strict=True)}
        for number in blocks
        for repetition in zip(*(each.each(number) for each in without), strict=True)
    ]
    return Repeated(criteria_at(fits, whole), [criteria_at(fits, rss) for rss in left_out])


def within_tolerances(problem: Problem, fits: Sequence[HypothesisFit]) -> Repeated:
    """With one of `REPEATED_ERRORS` expected a tolerance higher or lower; delays and knots stay."""
    return Repeated(criteria(fits), list(_expecting_others(problem, fits)))


def _expecting_others(problem: Problem, fits: Sequence[HypothesisFit]) -> Iterator[Criteria]:
    expected = _expected_elsewhere(problem)
    left = {}
    for fit in fits:
        basis = np.linalg.qr(problem.design(fit.frame, fit.columns))[0]
        changes = expected - basis @ (basis.T @ expected)
        left[fit.name] = np.sum((fit.residual[:, np.newaxis] + np.hstack([changes, -changes])) ** 2, axis=0)
    for k in range(2 * expected.shape[1]):
        yield criteria_at(fits, {name: float(rss[k]) for name, rss in left.items()})


def _expected_elsewhere(problem: Problem) -> FloatArray:
    """What the rows change by as one error of the record is expected a tolerance higher (rows, errors)."""
    nuisances = problem.rows.nuisances
    prior_rows = [
        2 * problem.rows.rates + row
        for row, item in enumerate(nuisances.items[k] for k in nuisances.bounded)
        if item.name in REPEATED_ERRORS
    ]
    changes = np.zeros((problem.rows.size, len(prior_rows)))
    changes[prior_rows, np.arange(len(prior_rows))] = 1.0
    return problem.rows.projected(changes)
