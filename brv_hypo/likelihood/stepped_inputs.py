"""Inputs whose samples look like those of a digital controller, and that are told to run on a cubic between them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.likelihood.segment import Segment, holds, inputs_of

# Share of the intervals over which such an input keeps its value exactly, at least: a fast motion rarely keeps it.
_KEPT = 0.5
# Share of its changes that stand alone between intervals that keep the value: those of a smooth pulse stand together.
_ALONE = 0.5
# Changes that are alone, at least: one or two are a switch, or a sample that was repeated.
_LEAST_CHANGES = 3
# Median change as a share of the input's range, at least: rounding to fewer than 20 levels makes such ones too.
_LARGE = 0.05


def stepped_inputs(segments: Sequence[Segment]) -> tuple[str, ...]:
    """A remark that names the inputs that keep and jump, but have the hold "cubic"; none where there are none."""
    found = {
        row: share
        for number, segment in enumerate(segments)
        if segment.u_mid is None
        for row, share in _stepped_on_cubics(segment, number).items()
    }
    if not found:
        return ()
    return (
        f"inputs {sorted(found)} run on a cubic between samples (hold 'cubic'), but keep their value over "
        f"{100.0 * min(found.values()):.0f} % of the intervals and jump between: likely cause: a digital controller's "
        "commands, for which a cubic biases the estimate. Give the segments hold='zero' for these inputs ('linear' if "
        "they ramp from sample to sample), and take the likelier fit",
    )


def _stepped_on_cubics(segment: Segment, number: int) -> dict[int, float]:
    """The rows of such inputs, with the share of the intervals over which each keeps its value."""
    rows = inputs_of(segment)
    kinds = holds(segment.hold, len(rows), number)
    return {
        row: float(np.mean(np.diff(values) == 0.0))
        for row, (values, kind) in enumerate(zip(rows, kinds, strict=True))
        if kind == "cubic" and _is_stepped(values)
    }


def _is_stepped(values: FloatArray) -> bool:
    """True for samples (n,) that stay exactly, and change by large steps that stand alone."""
    change = np.abs(np.diff(values))
    kept: BoolArray = change == 0.0
    if np.mean(kept) < _KEPT or np.all(kept):
        return False
    alone = ~kept[1:-1] & kept[:-2] & kept[2:]
    large = float(np.median(change[~kept])) > _LARGE * float(np.ptp(values))
    return bool(large and np.count_nonzero(alone) >= max(_LEAST_CHANGES, _ALONE * np.count_nonzero(~kept)))
