"""How a search ended, and what to do about it."""

from __future__ import annotations

from enum import StrEnum


class Status(StrEnum):
    """The value is what is shown and compared; each knows its cause and remedy."""

    CONVERGED = "converged"
    COARSE = "coarse mesh"
    ITERATION_LIMIT = "iteration limit"
    STALLED = "stalled"
    UNDETERMINED = "undetermined"
    STIFF = "too stiff"
    DIVERGED = "diverged"

    @property
    def cause(self) -> str:
        """What happened."""
        return _CAUSES[self][0]

    @property
    def remedy(self) -> str:
        """What to try; empty where nothing need be done."""
        return _CAUSES[self][1]

    @property
    def message(self) -> str:
        """Cause and remedy in one text."""
        return f"{self.cause}. {self.remedy}" if self.remedy else self.cause


_CAUSES = {
    Status.CONVERGED: ("the step is negligible against the standard errors", ""),
    Status.COARSE: (
        "the search converged, but the motion is too fast for the mesh, so that estimates and errors are wrong",
        "Sample faster, eliminate the fastest state (let it follow the others at once), or raise mesh_steps",
    ),
    Status.ITERATION_LIMIT: (
        "the iterations were not enough",
        "Look at the near-null directions in identifiability: parameters that the data do not separate; fix or bound "
        "some, or raise max_iterations",
    ),
    Status.STALLED: (
        "no fraction of the step improves the fit: the derivatives are wrong (a function that is not smooth, or not "
        "vectorised over samples) or the start is too far away",
        "Check the functions, or start nearer",
    ),
    Status.UNDETERMINED: (
        "a state neither shows in an output nor drives one that does",
        "Measure it, leave it out of the states, or give x0_std so that its start is known",
    ),
    Status.STIFF: (
        "between two samples the fastest state settles so many times over that rounding hides the slow ones",
        "Let that state follow the others at once (set its rate to 0 and solve for it), sample faster, or raise "
        "mesh_steps",
    ),
    Status.DIVERGED: (
        "the step is not finite: the functions overflowed or returned nan",
        "Start nearer to the solution, set bounds, or check the dynamics for divisions by zero",
    ),
}
