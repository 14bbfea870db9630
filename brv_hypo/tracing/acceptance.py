"""Which candidate joins a model: the test on the blocks held out, beside all processes, and in repetitions.

`Tried` is a candidate with what it does to the held-out error: `accepted` is the one test by which it joins the model.
`choose` tries the candidates of a step, best first, and says how many repetitions name the one that is accepted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.constants import (
    FINDING_REPEATED,
    FINDING_SIGMAS,
    HELD_OUT_CLUSTER,
    HELD_OUT_SIGMAS,
    HELD_OUT_WORSE,
    HINT_REPEATED,
    LOOP_BEYOND_DOUBT,
    LOOP_DETECTED,
    LOOP_IN_ITS_PLACE,
    LOOP_REPEATED_BLOCKS,
    LOOP_REPEATED_KNOTS,
    LOOP_RIVALS,
    LOOP_TRIES,
    LOOP_WITH_EVIDENCE,
    REPEATED_ERRORS,
)
from brv_hypo.inference.held_out import jackknife_error
from brv_hypo.inference.problem import Problem
from brv_hypo.linearisation.channels import Part, Rows, split
from brv_hypo.linearisation.linear import lengths
from brv_hypo.model.term import default_knots
from brv_hypo.thresholds import SPECIFIC
from brv_hypo.tracing.additions import with_candidate
from brv_hypo.tracing.baseline import has_schedule
from brv_hypo.tracing.candidates import (
    Candidate,
    adjusted,
    best_first,
    confounded,
    fitted_again,
    nearly_equal,
    ranked,
    schedules_first,
)
from brv_hypo.tracing.families import Beside, beside_processes
from brv_hypo.tracing.fit import Fit, has_tolerance
from brv_hypo.tracing.result import Status

_SPENT = 1e-10  # singular values of unit columns below which a direction is rounding

# ---- The blocks held out ----


class Agreement(NamedTuple):
    """What the held-out part says of an effect, in both channels, in standard errors.

    `fall` of the squared error, by the effect with the coefficients that the fitted part gives; `shown`, how surely
    the effect is there at all, of whatever size: 1.645 has one chance in twenty where it is not.
    """

    fall: float
    shown: float


def agreement(problem: Problem, held_out: Part, before: Rows, after: Rows) -> Agreement:
    """Of the residuals (frame rows,) without an effect and with it, as a fit of `problem` leaves them.

    The difference of two predictions d and the later residual e give the fall: sum of d^2 + 2 e d, whose noise is
    that of the second part alone; it is summed over clusters of neighbours (White, Econometrica 48:817,
    1980). What the fitted part leaves uncertain of the held-out one, constants of integration among it, weighs the
    rows: it would drown what changes within a stretch.
    """
    directions, share = _uncertain(problem.untied(), held_out)
    first, second = (_whitened(problem, held_out, left) for left in (before, after))
    first, second = (rows + directions @ (share * (directions.T @ rows)) for rows in (first, second))
    difference = first - second
    products = difference * second
    clusters = np.add.reduceat(products, np.arange(0, products.size, HELD_OUT_CLUSTER))
    noise = max(float(np.sqrt(np.sum(clusters**2))), 1e-300)
    fall = float(first @ first - second @ second) / (2.0 * noise)
    return Agreement(fall, float(difference @ first) / noise)


def _whitened(problem: Problem, held_out: Part, left: Rows) -> FloatArray:
    """The held-out residuals at unit noise (rows,), the rates from the constant that the fitted part has."""
    part, noise, levels = problem.rows.part, problem.rows.noise, _levels(problem, held_out)
    fitted = part.white_rates(part.constants(), noise), part.white_rates(left.rates[part.rows], noise)[:, 0]
    there = left.at(held_out.rows)
    rates = there.rates - levels @ np.linalg.lstsq(*fitted, rcond=None)[0]
    for own in (slice(a, b) for a, b in held_out.pieces):
        if not levels[own].any():
            rates[own] -= rates[own].mean()
    return held_out.whitened(Rows(rates, there.force), noise)[:, 0]


def _levels(problem: Problem, held_out: Part) -> ComplexArray:
    """The fitted part's constants of integration as histories of the held-out rates (rows, 2 levels)."""
    first, ends = [a for a, _ in problem.rows.part.levels], np.cumsum([b - a for a, b in problem.frame.pieces])
    segments = [np.searchsorted(ends, rows, side="right") for rows in (held_out.rows, problem.rows.part.rows[first])]
    same = segments[0][:, np.newaxis] == segments[1]
    return np.asarray(np.repeat(same, 2, axis=1) * np.tile([1.0, 1.0j], len(first)))


def _uncertain(problem: Problem, held_out: Part) -> tuple[FloatArray, FloatArray]:
    """Directions (rows, rank) of the held-out rows in which a prediction from the fitted part errs.

    With them the share (rank,) by which rows change along each where all come to unit variance.
    """
    design = problem.whole_design(problem.frame, problem.baseline)
    scale = lengths(design)
    _, sizes, turn = np.linalg.svd(design / scale, full_matrices=False)
    determined = sizes > _SPENT * sizes[0]
    root = (turn[determined].T / sizes[determined]) / scale[:, np.newaxis]
    # Baseline, constants of the fitted part and nuisances on the held-out rows.
    there = problem.on(held_out).rows
    moments = np.column_stack([problem.frame.columns(problem.baseline)[held_out.rows], _levels(problem, held_out)])
    unknowns = there.nuisance_design[: 2 * there.rates, 2 * len(held_out.levels) :]
    of_moments = np.concatenate([there.white_moments(moments), np.zeros((there.rates, moments.shape[1]))])
    directions, errors, _ = np.linalg.svd(np.column_stack([of_moments, unknowns]) @ root, full_matrices=False)
    return directions, 1.0 / np.sqrt(1.0 + errors**2) - 1.0


@dataclass(frozen=True)
class Tried:
    """A candidate with the model that it makes (`fit`), and what it did to the held-out part: `agreement` in both
    channels, `ratio` of the moments' mean squares.

    `before` is the regression without the effect, `after` with its columns: an effect with a tolerance is fixed at zero
    before, though every other fit has it within its tolerance.
    """

    candidate: Candidate
    fit: Fit
    agreement: Agreement
    ratio: float
    ratio_error: float
    before: Fit
    after: Fit
    certain: bool
    """Whether the fitted part leaves no doubt of it."""
    has_tolerance: bool
    """Whether every fit has it within its tolerance."""
    gain: float | None = None
    """Of the log evidence beside all processes or, up to none, in the place of its family's; None if not known."""
    may_be_named: bool = True
    """Whether the evidence clearly wants it, or no other family of processes explains most of the residual."""

    @property
    def accepted(self) -> bool:
        """Whether the held-out part agrees, and processes do not explain the record far better, or better at all.

        What the evidence does not want beside them is refused where another family explains most of the residual.
        """
        if not self.agrees or self.gain is None:
            return self.agrees
        least = 0.0 if self.has_tolerance else -SPECIFIC
        return self.gain > least and (self.may_be_named or self.candidate.kind == "discovered")

    @property
    def agrees(self) -> bool:
        """Whether the held-out part agrees.

        The moments' error has to fall, by how much matters little where the fitted part leaves no doubt. An error of
        the record may show in the specific force alone: it must not make the moments significantly worse. What every
        fit has within its tolerance has nothing to predict that others within theirs could not: that it must be larger
        is judged by the fitted part alone. Worse by less than noise scatters such an error is not worse: the record is
        read anew with the effect taken out, which the stretches' own scatter does not know of.
        """
        no_worse = self.ratio < 1.0 + max(HELD_OUT_WORSE * self.ratio_error, self.before.held_out.scatter)
        if self.has_tolerance:
            return no_worse
        falls = self.ratio < 1.0 or (self.candidate.effect is not None and no_worse)
        if self.certain:
            return falls and self.agreement.fall > 0.0 and self.agreement.shown >= HELD_OUT_SIGMAS
        return falls and self.agreement.fall >= HELD_OUT_SIGMAS

    @property
    def is_established(self) -> bool:
        """Whether it has a name that the evidence clearly wants beside all processes."""
        return self.candidate.kind != "discovered" and (self.gain or 0.0) >= SPECIFIC

    def status(self, named_in: float, choices: int, elsewhere: float | None) -> Status:
        """A finding or a hint, one of so many choices; `elsewhere`: the ratio of errors on flights left out."""
        lowers = self.ratio + FINDING_SIGMAS * self.ratio_error < 1.0 and (elsewhere is None or elsewhere < 1.0)
        wanted = self.gain is None or self.gain - np.log(choices) >= SPECIFIC
        return "finding" if lowers and wanted and named_in >= FINDING_REPEATED else "hint"


def with_columns(fit: Fit, candidate: Candidate) -> Fit:
    """The same regression with a candidate's columns."""
    own = candidate.fit
    return replace(fit, model=fit.model.but(columns=own.columns), data=replace(fit.data, frame=own.frame))


# ---- Which is added ----


@dataclass(frozen=True)
class Choice:
    """The candidates, best first, and those that were tried on the held-out part, in order.

    `named_in`: the share of the repetitions that name the last of these, where the held-out part agrees with it.
    """

    ranked: tuple[Candidate, ...]
    tried: tuple[Tried, ...]
    named_in: float | None = None

    @cached_property
    def chances(self) -> dict[str, float]:
        """Adjusted p-values of the candidates."""
        return adjusted(self.ranked)

    @property
    def accepted(self) -> Tried | None:
        """The last that was tried, where the held-out part agrees with it; None where few repetitions name it."""
        often = self.named_in is None or self.named_in >= HINT_REPEATED
        return self.tried[-1] if often and self.tried and self.tried[-1].accepted else None

    @property
    def unwanted(self) -> tuple[str, ...]:
        """Those that the held-out part agrees with, but processes explain far better, or are of another family."""
        return tuple(each.candidate.name for each in self.tried if each.agrees and not each.accepted)

    @property
    def leading(self) -> Tried | None:
        """What is added or, where nothing is, the best that counts."""
        return self.accepted or (self.tried[0] if self.tried else None)

    @property
    def reported(self) -> tuple[Candidate, ...]:
        """The candidates with the leading one first and what this flight cannot tell from it after it."""
        if self.leading is None:
            return self.ranked
        leader = self.leading.candidate
        rank = {leader.name: 0, **dict.fromkeys(confounded(leader, self.ranked), 1)}
        return tuple(sorted(self.ranked, key=lambda candidate: rank.get(candidate.name, 2)))


def choose(fit: Fit, candidates: Sequence[Candidate]) -> Choice:
    """What is chosen of the candidates beside a fit, and how many repetitions name it."""
    beside = beside_processes(fit, fit.model, fit.data.fitted, fit.problem.given)
    choice = first_accepted(fit, with_evidence(fit, candidates, beside), beside)
    if choice.accepted is None:
        return choice
    chosen = choice.accepted.candidate
    offered = [each for each in choice.ranked if each.name not in choice.unwanted]
    if chosen.follows is not None and not has_schedule(fit.model):
        offered = list(schedules_first(offered))
    return replace(choice, named_in=named_in(beside, offered, chosen, fit))


def with_evidence(fit: Fit, candidates: Sequence[Candidate], beside: Beside) -> list[Candidate]:
    """The candidates that lead, as they are likeliest beside all processes, with the evidence that they gain there.

    So are all that change in time: on a coarse grid any of them may look like nothing.
    """
    found = []
    for place, candidate in enumerate(candidates):
        changes = any(m.time_variation != ("constant",) for m in candidate.fit.mechanisms)
        leads = place < LOOP_WITH_EVIDENCE and candidate.gain > 0.0
        if changes or leads or candidate.kind == "discovered":
            gain, columns = beside.likeliest(candidate.fit)
            if set(columns) != set(candidate.fit.selected):
                candidate = fitted_again(fit.problem, fit.null, candidate, columns)
            candidate = replace(candidate, evidence=gain)
        found.append(candidate)
    return found


def first_accepted(fit: Fit, candidates: Sequence[Candidate], beside: Beside) -> Choice:
    """Try the candidates that count on the held-out part, the best first, until one is accepted.

    Those that predict what a refused one did are passed over: they cannot do better; nor can those that explain far
    less. Where the residual is white, what is not beyond doubt does not count: but an effect may still exceed the
    tolerance that every fit allows it.
    """
    significance, problem = fit.data.config.significance, fit.problem
    order = ranked(candidates, {column.mechanism for column in problem.baseline}, has_schedule(fit.model))
    chances, tried = adjusted(order), list[Tried]()
    for candidate in order:
        if candidate.gain <= 0.0 or candidate.fall < LOOP_DETECTED or chances[candidate.name] > significance:
            continue
        certain = chances[candidate.name] <= LOOP_BEYOND_DOUBT * significance
        if fit.residual.white and not certain and not has_tolerance(problem, candidate.name):
            continue
        if any(nearly_equal(candidate, other.candidate) for other in tried if not other.agrees):
            continue
        if tried and candidate.gain < LOOP_IN_ITS_PLACE * tried[0].candidate.gain:
            break
        tried.append(_try(fit, candidate, certain, beside))
        if tried[-1].accepted or len(tried) == LOOP_TRIES:
            break
    return Choice(order, tuple(tried))


def _try(fit: Fit, candidate: Candidate, certain: bool, beside: Beside) -> Tried:
    """A candidate added to the model; weighed beside processes where the held-out part agrees with it."""
    added, before, after = with_candidate(fit, candidate), fit, with_columns(fit, candidate)
    if tolerance := has_tolerance(fit.problem, candidate.name):  # without it: fixed at zero
        others = [item.present if item.name == candidate.name else np.nan for item in fit.nuisances]
        before = replace(fit, others=np.array(others))
    agrees = agreement(fit.problem, fit.data.held_out, before.rest, after.rest)
    new, old = added.held_out, before.held_out
    ratio, error = new.mean_square / old.mean_square, jackknife_error(new.left_out / old.left_out)
    tried = Tried(candidate, added, agrees, ratio, error, before, after, certain, tolerance)
    if not tried.agrees:
        return tried
    there, own = beside_processes(added, fit.model, added.data.fitted), added.model.added[-1]
    gain = there.gain(own)
    gain = gain if gain >= 0.0 else max(gain, min(there.gain(own, in_place=True), 0.0))
    named = gain >= SPECIFIC or beside.majority in (None, there.families[own])
    return replace(tried, gain=gain, may_be_named=named)


# ---- Repetitions ----


def named_in(beside: Beside, offered: Sequence[Candidate], own: Candidate, fit: Fit) -> float:
    """Share of the repetitions in which an effect gains most beside all processes, a generic description far more."""
    rivals = [each for each in offered if each is not own and each.evidence is not None][:LOOP_RIVALS]
    best = []
    for problem in _repetitions(beside.rows.problem, fit):
        again = beside.under(problem)
        gains = {each.name: again.gain_of(each.fit) - (each.kind == "discovered") * SPECIFIC for each in rivals}
        gains[own.name] = again.gain_of(own.fit)
        best.append(min((own, *rivals), key=best_first((own, *rivals), gains)))
    return float(np.mean([each is own for each in best]))


def _repetitions(problem: Problem, fit: Fit) -> Iterator[Problem]:
    """The problem with other blocks, other knots, and another inertia and dynamic pressure."""
    data, config = fit.data, fit.data.config
    for share in LOOP_REPEATED_BLOCKS:
        fitted, _ = split(data.frame, data.whole.valid, round(share * config.blocks))
        yield problem.on(fitted)
    start, stop = float(data.frame.time.min()), float(data.frame.time.max())
    for more in LOOP_REPEATED_KNOTS:
        yield replace(problem, knots=default_knots(start, stop, max(config.knot_count + more, 1)))
    nuisances = problem.rows.nuisances
    for effect in REPEATED_ERRORS:
        for side in (-1.0, 1.0):
            items = tuple(
                replace(item, present=item.present + side) if item.name == effect else item for item in nuisances.items
            )
            if items != nuisances.items:
                yield replace(problem, rows=replace(problem.rows, nuisances=replace(nuisances, items=items)))
