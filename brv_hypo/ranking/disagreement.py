"""Where ways of judging disagree: criteria about the order of hypotheses, searches about the best subset.

No number of the verdict is made here: it is for the reader, who may trust another criterion more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

from brv_hypo.constants import CRITERIA_TIE
from brv_hypo.io.text import hypothesis
from brv_hypo.model.common_time import at
from brv_hypo.model.term import Regressor
from brv_hypo.ranking.result import RankedHypothesis, StepwiseDifference, Verdict
from brv_hypo.regression.fit import HypothesisFit
from brv_hypo.regression.problem import Problem
from brv_hypo.subset import stepwise_columns

NONE = "none"


def criteria_disagree(
    ranking: Sequence[RankedHypothesis], probability: Mapping[str, float]
) -> tuple[str, ...]:
    """A sentence on which hypothesis each criterion puts first, where these are not all one; else nothing.

    The F-ratio is none of `none`: it is against it. No probability comes first where none is left for the list.
    """
    if len(ranking) < 2:
        return ()
    tested = [row for row in ranking if row.f_ratio is not None]
    named = [row for row in ranking if probability.get(row.mechanism, 0.0) > 0.0]
    first = {"C_p": min(ranking, key=lambda row: row.cp).mechanism}
    first["prediction error"] = min(ranking, key=lambda row: row.prediction_error).mechanism
    if tested:
        first = {"F-ratio": max(tested, key=lambda row: row.f_ratio or 0.0).mechanism, **first}
    if named:
        first["probability"] = max(named, key=lambda row: probability[row.mechanism]).mechanism
    if len(set(first.values())) == 1:
        return ()
    told = "; ".join(
        f"{_joined([name for name, leader in first.items() if leader == each])}: {hypothesis(each)}"
        for each in dict.fromkeys(first.values())
    )
    return (f"the criteria put different hypotheses first: {told}",)


def prediction_disagrees(verdict: Verdict) -> tuple[str, ...]:
    """A sentence where the likeliest hypothesis of the list predicts held-out blocks worse than others by more than
    chance; else nothing.
    """
    likely = [name for name in verdict.confidence_p_values if verdict.probability[name] > 0.0]
    leader = max(likely, key=lambda name: verdict.probability[name], default=None)
    if leader is None or leader in verdict.confidence_set:
        return ()
    return (
        f"{hypothesis(leader)} is the most probable, but is not in the model confidence set (95 %): "
        f"{_joined([*map(hypothesis, verdict.confidence_set)])} predict held-out blocks better",
    )


def stepwise_differences(problem: Problem, fits: Sequence[HypothesisFit]) -> tuple[StepwiseDifference, ...]:
    """Where Efroymson's stepwise search misses the best subset on the grid of knots and delays, by size.

    For the likeliest of the hypotheses that have a mechanism, on the grid that it was searched on. Sizes that stepwise
    does not come to, for its F to enter is too small, are left out.
    """
    found = []
    search = partial(stepwise_columns, samples=round(problem.samples * problem.efficiency))
    searched = sorted((fit for fit in fits if fit.mechanisms), key=lambda fit: fit.information)
    for fit in searched[:1]:
        if fit.grid is None:
            continue
        exact, quick = fit.grid.best(1), fit.grid.best(1, search)
        for size, (best, *_) in sorted(exact.items()):
            met = quick.get(size)
            if met and met[0][0] > best[0] * (1.0 + CRITERIA_TIE):
                found.append(
                    StepwiseDifference(
                        mechanism=fit.name,
                        size=size,
                        best=tuple(_placed(column, fit) for column in best[1]),
                        stepwise=tuple(_placed(column, fit) for column in met[0][1]),
                        rss_ratio=met[0][0] / best[0],
                    )
                )
    return tuple(found)


def _placed(column: Regressor, fit: HypothesisFit) -> str:
    """What a column is, from when on, at which delay or other parameter."""
    since = "" if column.time_basis.kind == "constant" else f" at {at(fit.frame.common, column.time_basis.start)}"
    own = next(mechanism for mechanism in fit.mechanisms if mechanism.name == column.mechanism)
    units = {each.name: "" if each.units == "1" else f" {each.units}" for each in own.parameters()}
    theta = ", ".join(f"{name} {value:.3g}{units[name]}" for name, value in column.theta)
    return f"{column.label}{since}" + (f" ({theta})" if theta else "")


def _joined(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
