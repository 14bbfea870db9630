"""Do two standard errors hold the planted parameters as often as they should?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.study.outcome import Estimate, Outcome
from brv_hypo.study.shares import Share, Statistic, share

SIGMAS = 2.0


class Coverage(Statistic):
    """One parameter of one planted mechanism, over flights in which that mechanism ranks first.

    `covered`: within two standard errors (95.4 % where errors are Gaussian and right); `missing` flights have
    no such parameter in their fit. `rms_sigmas` is the rms error in standard errors, without the
    farthest tenth; `median_error` is absolute, in `units`.
    """

    planted: str
    parameter: str
    kind: str
    units: str
    covered: Share
    missing: int
    rms_sigmas: float | None
    median_error: float | None


def coverages(outcomes: Sequence[Outcome]) -> tuple[Coverage, ...]:
    """One entry for each planted mechanism and parameter."""
    groups: dict[tuple[str, str, str], list[Estimate]] = {}
    for outcome in outcomes:
        for estimate in outcome.estimates if outcome.right else ():
            groups.setdefault((outcome.planted, estimate.name, estimate.kind), []).append(estimate)
    return tuple(_coverage(*group, estimates) for group, estimates in groups.items())


def _coverage(planted: str, parameter: str, kind: str, estimates: Sequence[Estimate]) -> Coverage:
    sigmas = np.abs([e.sigmas for e in estimates if e.sigmas is not None])
    errors = [abs(e.value - e.truth) for e in estimates if e.value is not None]
    nearest = np.sort(sigmas)[: int(np.ceil(0.9 * sigmas.size))]
    return Coverage(
        planted=planted,
        parameter=parameter,
        kind=kind,
        units=next((e.units for e in estimates if e.units), "1"),
        covered=share(int(np.sum(sigmas < SIGMAS)), sigmas.size),
        missing=len(estimates) - sigmas.size,
        rms_sigmas=float(np.sqrt(np.mean(nearest**2))) if sigmas.size else None,
        median_error=float(np.median(errors)) if errors else None,
    )
