"""The likelihood back end of a comparison: standing hypotheses refined on the original measurements (Section 3.4)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from brv_hypo.arrays import FloatArray
from brv_hypo.identification import Identification, IdentificationConfig, coefficients_without, identify
from brv_hypo.ranking.config import CompareConfig
from brv_hypo.ranking.verdict import STANDING_PROBABILITY, probabilities
from brv_hypo.regression.fit import HypothesisFit, extended_bic
from brv_hypo.regression.frame import Piece
from brv_hypo.regression.held_out import HeldOut, predicted
from brv_hypo.regression.problem import Task

CONVERGED = "converged"
# Starting from a good regression the likelihood converges in a few iterations or not at all.
MOST_ITERATIONS = 4
MOST_HYPOTHESES = 2


@dataclass(frozen=True)
class Likelihoods:
    """What the likelihood made of the standing hypotheses, by name, and which it left out to save time."""

    found: Mapping[str, Identification]
    left_out: frozenset[str]

    @property
    def converged(self) -> dict[str, Identification]:
        """Those whose estimates may be used."""
        return {name: found for name, found in self.found.items() if found.status == CONVERGED}


def identify_standing(
    fits: Sequence[HypothesisFit], config: CompareConfig, say: Callable[[str], None]
) -> Likelihoods:
    """Maximum likelihood for the leader and its closest rival, where one stands; the others are out of reach.

    "quick" leaves out records with limits, where it takes several seconds.
    """
    if config.maximum_likelihood == "none":
        return Likelihoods({}, frozenset())
    chances = probabilities({fit.name: fit.information for fit in fits})
    standing = [fit for fit in fits if chances[fit.name] >= STANDING_PROBABILITY]
    standing.sort(key=lambda fit: -chances[fit.name])
    options = IdentificationConfig(max_iterations=MOST_ITERATIONS)
    found: dict[str, Identification] = {}
    left_out: set[str] = set()
    for fit in standing[:MOST_HYPOTHESES]:
        if config.maximum_likelihood == "quick" and _takes_long(fit):
            left_out.add(fit.name)
            continue
        say(f"maximum likelihood of {fit.name}")
        found[fit.name] = identify(fit.frame, fit.columns, fit.values, options)
    return Likelihoods(found, frozenset(left_out))


def _takes_long(fit: HypothesisFit) -> bool:
    """Whether the likelihood takes several seconds: a record with limits."""
    return any(reconstruction.status == "degraded" for reconstruction in fit.frame.reconstructions)


def informations(
    fits: Sequence[HypothesisFit], likelihoods: Likelihoods
) -> tuple[dict[str, float], frozenset[str]]:
    """Extended BIC of every hypothesis, and the names of those where it rests on the likelihood.

    Likelihoods compare only with each other: where two or more converged, the leader keeps its criterion from the
    regression and the others lie at their likelihood's distance from it.
    """
    information = {fit.name: fit.information for fit in fits}
    converged = {
        fit.name: _likelihood_information(fit, likelihoods.converged[fit.name])
        for fit in fits
        if fit.name in likelihoods.converged
    }
    leader = min(information, key=lambda name: information[name])
    if len(converged) < 2 or leader not in converged:
        return information, frozenset()
    shift = information[leader] - converged[leader]
    return {**information, **{name: value + shift for name, value in converged.items()}}, frozenset(converged)


def _likelihood_information(fit: HypothesisFit, identification: Identification) -> float:
    """-2 log L, priors included, in place of n ln(RSS / n), with the same price of parameters and search.

    Errors of the record are the same parameters in every hypothesis: what their priors ask for them is all they cost.
    """
    price = extended_bic(1.0, 1, fit.effective, fit.parameters, fit.searched, len(fit.selected))
    misfit = -2.0 * identification.log_likelihood * fit.efficiency + identification.prior_misfit
    return float(misfit + price)


def held_out_by_likelihood(task: Task, found: Identification, count: int) -> HeldOut:
    """Held-out errors where the likelihood converged: its coefficients without the measurements of each block."""

    def without(block: tuple[Piece, ...]) -> FloatArray:
        return coefficients_without(found, block)

    return predicted(task, found.frame, found.columns, count, without)
