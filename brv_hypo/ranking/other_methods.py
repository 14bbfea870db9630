"""Repetitions on the motion that other reconstruction methods give: those of the report, and Appendix A.

Every hypothesis is fitted with start, gravity and walk of the motion, so that which method its problem is linearised
about changes nothing to first order. Here terms are what they are on another method's own motion, which is off by some
percent of alpha: what that leaves of the record counts as noise. A repetition says whether a mechanism that leads
would have been led to by that method; it is none where the accelerometers contradict the method beyond its own stated
error, or where what parts the leader from a rival would drown in what the method leaves.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.constants import DETECTABLE, METHOD_SIGMAS
from brv_hypo.errors import UnanswerableError
from brv_hypo.motion import Reconstruction, ReconstructionConfig, reconstruct
from brv_hypo.motion.config import Method
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.methods import method_names
from brv_hypo.motion.motion import at_nodes
from brv_hypo.ranking.repeated import Criteria, Repeated, criteria, criteria_at
from brv_hypo.regression.build import normal_force_slope
from brv_hypo.regression.fit import HypothesisFit, likeliest
from brv_hypo.regression.force import ForceModel
from brv_hypo.regression.frame import RateFrame
from brv_hypo.regression.linear import solve_scaled
from brv_hypo.regression.problem import Problem

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
