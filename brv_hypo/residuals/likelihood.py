"""The final model of a trace, refined by maximum likelihood on the measurements themselves."""

from __future__ import annotations

from brv_hypo.identification import IdentificationConfig, identify
from brv_hypo.ranking.likelihood import MOST_ITERATIONS
from brv_hypo.ranking.result import MaximumLikelihood
from brv_hypo.ranking.summary import likelihood_block
from brv_hypo.residuals.fitted_model import State
from brv_hypo.residuals.summary import term_estimates

_OPTIONS = IdentificationConfig(max_iterations=MOST_ITERATIONS)


def maximum_likelihood(state: State) -> MaximumLikelihood:
    """The likelihood's block of the result, in the form of `compare`'s; a failure is its status and message.

    On a record that limits the reconstruction the search takes long and seldom ends: it is left out.
    """
    seen, columns = state.seen, state.model.columns
    if len(seen.records) > 1:
        return _left_out("of several flights, it knows no terms that are of one of them")
    if seen.reconstructions[0].status == "degraded":
        return _left_out("the record limits the reconstruction, where its search seldom ends")
    values = state.values
    found = identify(seen.frame, columns, values, _OPTIONS)
    return likelihood_block(found, term_estimates(seen, found.columns, found.values, found.covariance))


def _left_out(message: str) -> MaximumLikelihood:
    return MaximumLikelihood(status="left out", iterations=0, log_likelihood=None, message=message)
