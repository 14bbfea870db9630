"""Charts that a command draws of every flight: files of these names in a folder are known before any work begins."""

from __future__ import annotations

RECONSTRUCTION = (
    *("accelerations", "rates", "integrated-attitude"),
    *("motion", "moments", "theta-psi", "moment-by-alpha", "spectrum"),
)
COMPARISON = ("probability", "limits")
OF_A_COMPARED_FLIGHT = ("moments", "residuals", "motion", "moment-by-alpha", "spectrum")
TRACE = ("moments", "residuals", "static-slope", "spectrum")
PREDICTION = ("band", "errors", "regions")


def comparison_names(flights: int) -> tuple[str, ...]:
    """Those of a comparison of so many flights; of several, each chart of one has its number."""
    suffixes = [""] if flights == 1 else [f"-{number}" for number in range(1, flights + 1)]
    return (*COMPARISON, *(f"{name}{suffix}" for suffix in suffixes for name in OF_A_COMPARED_FLIGHT))
