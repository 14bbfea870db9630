"""Segments on a finer mesh: several steps of the dynamics between samples, measured at the samples only."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.interpolation import Interpolator
from brv_hypo.likelihood.result import FitResult
from brv_hypo.likelihood.segment import Segment, as_held, build_grid, inputs_of, with_history
from brv_hypo.likelihood.status import Status

TOLERATED = 0.1
"""Shift by the mesh, in standard errors, at which it is fine enough."""
MOST_STEPS = 32
"""Steps between samples at most."""
_ORDER = 4.0
"""Order of the collocation: how the error falls with the step."""
_NEAR = 1.0
"""Shift by the mesh, in standard errors, up to which a fit on a finer one begins where that on the coarser ended."""
_LARGEST_RAISE = 8
"""Factor by which the steps are raised at once: far from fine the error does not follow its order yet."""


def refine(
    segments: Sequence[Segment],
    run: Callable[[Sequence[Segment], int], FitResult],
    follow: Callable[[Sequence[Segment], int, FitResult], FitResult] | None,
) -> FitResult:
    """Fits on finer meshes until the shift is tolerable, or the steps are at their limit: then the status says so.

    `run` fits segments on a mesh of that many steps between samples; `follow` does from where a fit ended that is near,
    the segments' histories being its states; None where it cannot.
    """
    steps = 1
    found = run(segments, steps)
    while found.mesh_shift > TOLERATED and steps < MOST_STEPS:
        steps = min(steps * _raise(found.mesh_shift), MOST_STEPS)
        found = _on_mesh(segments, steps, found, run, follow)
    if not found.mesh_shift > TOLERATED:
        return found
    size = f"an estimate is off by {found.mesh_shift:.2g} standard errors with {steps} steps between samples"
    if found.converged:
        return replace(found, status=Status.COARSE, message=f"{size}: {Status.COARSE.message}")
    mesh = f"The mesh is a likely cause: {size}. {Status.COARSE.remedy}"
    return replace(found, message=f"{found.message}. {mesh}")


def _on_mesh(
    segments: Sequence[Segment],
    steps: int,
    before: FitResult,
    run: Callable[[Sequence[Segment], int], FitResult],
    follow: Callable[[Sequence[Segment], int, FitResult], FitResult] | None,
) -> FitResult:
    if follow is not None and before.converged and before.mesh_shift <= _NEAR:
        known = [with_history(segment, x) for segment, x in zip(segments, before.states, strict=True)]
        found = follow([finer(segment, i, steps) for i, segment in enumerate(known)], steps, before)
        if found.converged:
            return replace(found, beginnings=(*before.beginnings, *found.beginnings))
    return run([finer(segment, number, steps) for number, segment in enumerate(segments)], steps)


def _raise(shift: float) -> int:
    """Factor for the steps, a power of two."""
    wanted = (shift / TOLERATED) ** (1.0 / _ORDER) if np.isfinite(shift) else np.inf
    return int(min(2.0 ** np.ceil(np.log2(max(wanted, 2.0))), _LARGEST_RAISE))


def finer(segment: Segment, number: int, steps: int) -> Segment:
    """The segment with `steps` - 1 samples between each two, at which nothing was measured."""
    build_grid(segment, number)  # refuses what is unfit
    t = np.asarray(segment.t, dtype=float)
    inside = _inserted(t, steps)
    middle = 0.5 * (inside[:-1] + inside[1:])
    y = np.atleast_2d(np.asarray(segment.y, dtype=float))
    fine = np.full((y.shape[0], inside.size), np.nan)
    fine[:, ::steps] = y
    x0 = np.asarray(segment.x0, dtype=float)
    if x0.ndim == 2:
        x0 = np.stack([np.interp(inside, t, row) for row in x0])
    return replace(
        segment, t=inside, y=fine, u=_inputs(segment, inside), u_mid=_inputs(segment, middle), x0=x0
    )


def _inserted(t: FloatArray, steps: int) -> FloatArray:
    fractions = np.arange(steps) / steps
    return np.append((t[:-1, None] + np.diff(t)[:, None] * fractions).ravel(), t[-1])


def _inputs(segment: Segment, at: FloatArray) -> FloatArray:
    """Inputs (n_inputs, len(at)) as the segment has them between its samples."""
    t = np.asarray(segment.t, dtype=float)
    u = inputs_of(segment)
    hold = (segment.hold,) * len(u) if isinstance(segment.hold, str) else tuple(segment.hold)
    before = np.clip(np.searchsorted(t, at, side="right") - 1, 0, t.size - 2)
    s = (at - t[before]) / (t[before + 1] - t[before])
    last = np.where(at >= t[-1], t.size - 1, before)
    if segment.u_mid is not None:
        middle = np.asarray(segment.u_mid, dtype=float)[:, before]
        end = np.where(np.array([kind == "zero" for kind in hold])[:, None], u[:, before], u[:, before + 1])
        within = 2 * (s - 0.5) * (s - 1) * u[:, before] + 4 * s * (1 - s) * middle + 2 * s * (s - 0.5) * end
        return np.where(at >= t[-1], u[:, -1:], within)
    ways = {
        "zero": u[:, last],
        "linear": (1.0 - s) * u[:, before] + s * u[:, before + 1],
        "cubic": Interpolator(t).stencil(at).apply(u),
    }
    return as_held(ways, hold)
