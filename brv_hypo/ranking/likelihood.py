"""The likelihood back end of a comparison: standing hypotheses refined on the original measurements (Section 3.4)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from brv_hypo.identification import Identification, IdentificationConfig, identify
from brv_hypo.ranking.config import CompareConfig
from brv_hypo.ranking.fit import HypothesisFit, extended_bic
from brv_hypo.ranking.verdict import STANDING_PROBABILITY, probabilities

CONVERGED = "converged"
# Starting from a good regression the likelihood converges in a few iterations or not at all.
MOST_ITERATIONS = 4
MOST_HYPOTHESES = 2


def identify_standing(
    fits: Sequence[HypothesisFit], config: CompareConfig, say: Callable[[str], None]
) -> dict[str, Identification]:
    """Maximum likelihood for the leader and its closest rival, where one stands; the others are out of reach."""
    chances = probabilities({fit.name: fit.information for fit in fits})
    standing = [fit for fit in fits if chances[fit.name] >= STANDING_PROBABILITY]
    standing.sort(key=lambda fit: -chances[fit.name])
    options = IdentificationConfig(candidates=config.instrument_errors, max_iterations=MOST_ITERATIONS)
    found = {}
    for fit in standing[:MOST_HYPOTHESES]:
        if config.maximum_likelihood == "quick" and takes_long(fit):
            continue
        say(f"maximum likelihood of {fit.name}")
        found[fit.name] = identify(fit.frame, fit.columns, fit.values, options)
    return found


def takes_long(fit: HypothesisFit) -> bool:
    """Whether the likelihood takes several seconds: terms that look into the past, or a record with limits."""
    degraded = any(reconstruction.status == "degraded" for reconstruction in fit.frame.reconstructions)
    return degraded or any(column.delay is not None for column in fit.selected)


def informations(
    fits: Sequence[HypothesisFit], identified: Mapping[str, Identification]
) -> tuple[dict[str, float], frozenset[str]]:
    """Extended BIC of every hypothesis, and the names of those where it rests on the likelihood.

    Likelihoods compare only with each other: where two or more converged, the leader keeps its criterion from the
    regression and the others lie at their likelihood's distance from it.
    """
    information = {fit.name: fit.information for fit in fits}
    converged = {
        fit.name: _likelihood_information(fit, identified[fit.name])
        for fit in fits
        if fit.name in identified and identified[fit.name].status == CONVERGED
    }
    leader = min(information, key=lambda name: information[name])
    if len(converged) < 2 or leader not in converged:
        return information, frozenset()
    shift = information[leader] - converged[leader]
    return {**information, **{name: value + shift for name, value in converged.items()}}, frozenset(converged)


def _likelihood_information(fit: HypothesisFit, identification: Identification) -> float:
    """-2 log L in place of n ln(RSS / n), with the same price of parameters and search."""
    parameters = fit.parameters + len(identification.instruments)
    price = extended_bic(1.0, 1, fit.effective, parameters, fit.searched, len(fit.selected))
    return float(-2.0 * identification.log_likelihood * fit.efficiency + price)
