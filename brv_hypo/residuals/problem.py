"""The regression of one step: moments, force, motion and record together, as a task of the ranking's fits.

The rows of `TraceTask` are the whitened rates, the whitened force, and one for each prior. Columns that are
not functions of the motion (unknowns of the motion, the force model, record effects) are given as
histories.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.mechanisms.contract import Mechanism, Term
from brv_hypo.model.columns import Column, candidates, default_knots, theta_grid
from brv_hypo.model.time_variation import TimeFunction
from brv_hypo.motion.motion import Motion
from brv_hypo.regression.channels import Noise, Part, Rows
from brv_hypo.regression.fit import HypothesisFit
from brv_hypo.regression.frame import RateFrame, remove_levels
from brv_hypo.regression.linear import lengths, solve_scaled
from brv_hypo.regression.problem import Task
from brv_hypo.regression.response import Situation, side_by_side
from brv_hypo.regression.whitening import effective_samples, fit_noise, white

GIVEN = "given"
_OBSERVED = "observed"
_NOISE_ORDER = 12
_PER_CYCLE = 10
_FORCE = tuple(f"force {k}" for k in range(5))


class GivenColumns(Mechanism):
    """Stands for the columns that are given as histories: no moment belongs to it."""

    name = GIVEN
    title = "columns given as histories"
    claims = "nothing of its own"
    source = "the residual loop"

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """None."""
        return ()


@dataclass(frozen=True)
class Unknowns:
    """What is fitted along in every step, by name: histories over the flight, priors on some of them.

    `prior` maps a name to the present value in units of its prior's standard deviation.
    """

    histories: Mapping[str, Rows]
    prior: Mapping[str, float]


@dataclass(frozen=True)
class TraceTask(Task):
    """One step's regression on one part of the record.

    `given` are histories over the whole flight, by name; `unknowns` name those that are fitted along
    always, and are projected out of all rows; `prior` holds the present values of those that have one.
    """

    part: Part
    both: Noise
    given: Mapping[str, Rows]
    unknowns: tuple[str, ...]
    prior: Mapping[str, float]

    @cached_property
    def response(self) -> FloatArray:
        """Rates, force and priors, whitened, the unknowns projected out (rows,)."""
        return self.projected(self.raw_response[:, np.newaxis])[:, 0]

    @cached_property
    def samples(self) -> int:
        """Real residuals less the constants of integration and the unknowns without a prior."""
        return self.part.count(self.both) - (len(self.unknowns) - len(self.prior))

    def design(self, frame: RateFrame, columns: Sequence[Column]) -> FloatArray:
        """Whitened columns (rows, columns), projected like the response."""
        return self.projected(self.raw_design(frame, columns))

    @cached_property
    def raw_response(self) -> FloatArray:
        """Rates, force and present values of what has a prior, whitened (rows,)."""
        observed = Rows(self.frame.observed[self.part.rows], self.given[_OBSERVED].force[self.part.samples])
        return np.concatenate(
            [self.part.whitened(observed, self.both)[:, 0], np.array(list(self.prior.values()))]
        )

    def raw_design(self, frame: RateFrame, columns: Sequence[Column]) -> FloatArray:
        """Whitened columns (rows, columns) as they are."""
        rows = 4 * self.part.thinned_pieces(self.both)[-1][1]
        out = np.zeros((rows + len(self.prior), len(columns)))
        given = [j for j, column in enumerate(columns) if column.mechanism == GIVEN]
        others = [j for j, column in enumerate(columns) if column.mechanism != GIVEN]
        if others:
            moments = frame.columns([columns[j] for j in others])[self.part.rows]
            out[: rows // 2, others] = self.part.white_rates(moments, self.both)
        if given:
            histories = side_by_side([self.given[columns[j].term].at(self.part.samples) for j in given])
            out[:rows, given] = self.part.whitened(histories, self.both)
        names = list(self.prior)
        for j in given:
            if columns[j].term in self.prior:
                out[rows + names.index(columns[j].term), j] = 1.0
        return out

    def projected(self, rows: FloatArray) -> FloatArray:
        """Rows (rows, columns) with the unknowns projected out."""
        return np.asarray(rows - self._basis @ (self._basis.T @ rows), dtype=float)

    def whole_design(self, frame: RateFrame, columns: Sequence[Column]) -> FloatArray:
        """The columns as they are, and the unknowns after them (rows, columns + unknowns)."""
        return np.column_stack([self.raw_design(frame, columns), self._unknown_design])

    @cached_property
    def _basis(self) -> FloatArray:
        return np.linalg.qr(self._unknown_design / lengths(self._unknown_design))[0]

    @cached_property
    def _unknown_design(self) -> FloatArray:
        return self.raw_design(self.frame, [given_column(name) for name in self.unknowns])

    def on(self, part: Part) -> TraceTask:
        """The same columns and noise on another part of the record."""
        return replace(self, part=part)


def given_column(name: str, units: str = "1") -> Column:
    """The column of a history that is given."""
    return Column(GIVEN, name, (), TimeFunction("constant"), units)


def unknowns(situation: Situation, record_columns: Mapping[str, Rows]) -> Unknowns:
    """The unknowns of the motion, the force model and the record effects that the model holds already."""
    rows, present = situation.unknowns_of_motion()
    names = [f"motion {k}" for k in range(len(rows))]
    walk = names[len(names) - present.size :]
    record = situation.record
    nothing = np.zeros(record.time.size, dtype=complex)
    force = situation.force.columns(record, situation.crossflow)
    histories = {
        **dict(zip(names, rows, strict=True)),
        **{name: Rows(nothing, force[:, k]) for k, name in enumerate(_FORCE)},
        **record_columns,
    }
    return Unknowns(histories, dict(zip(walk, (float(v) for v in present), strict=True)))


def plain_task(
    situation: Situation,
    frame: RateFrame,
    part: Part,
    fixed: Unknowns,
    effects: Mapping[str, Rows],
    noise: Noise,
) -> TraceTask:
    """The task of a model and its unknowns under a noise; `effects` are histories that may be asked for."""
    observed = Rows(situation.here.rates, situation.record.transverse_force)
    return TraceTask(
        frame=frame.with_mechanisms([GivenColumns()]),
        baseline=situation.columns,
        knots=np.zeros(0),
        noise=noise.rates,
        efficiency=1.0,
        max_terms=1,
        exact_terms=1,
        refine=True,
        part=part,
        both=noise,
        given={**fixed.histories, **effects, _OBSERVED: observed},
        unknowns=tuple(fixed.histories),
        prior=fixed.prior,
    )


def build_task(
    situation: Situation,
    frame: RateFrame,
    part: Part,
    fixed: Unknowns,
    effects: Mapping[str, Rows],
    rich: Sequence[Mechanism],
    knot_count: int,
    max_terms: int,
) -> TraceTask:
    """The task of a step, its noise from what a rich model leaves."""
    noise = Noise(
        white(situation.record.gyro_sigma),
        white(float(np.median(situation.record.force_sigma))),
        (np.inf, np.inf),
        _thinning(situation),
    )
    task = plain_task(situation, frame, part, fixed, effects, noise)
    time = frame.time
    knots = default_knots(float(time.min()), float(time.max()), knot_count)
    task = replace(task, knots=knots, max_terms=max_terms, exact_terms=max_terms)
    # Record effects stay out: a scale error of one would explain the record away, noise and all.
    columns = (*situation.columns, *_rich_columns(frame, rich))
    for _ in range(2):
        task = with_noise(task, task.frame.with_mechanisms(rich), columns)
    return task


def with_noise(task: TraceTask, frame: RateFrame, columns: Sequence[Column]) -> TraceTask:
    """The task with the noise of what these columns leave, in each channel."""
    left = residual(task, frame, columns)
    pieces = task.part.pieces
    rates = remove_levels(left.rates, pieces, white())
    force = [left.force[a:b][task.part.seen[a:b]] for a, b in pieces]
    noise = Noise(
        fit_noise(remove_levels(left.rates, pieces, task.noise), _NOISE_ORDER),
        fit_noise(force, _NOISE_ORDER),
        (_mean_square(rates), _mean_square(force)),
        task.both.thinning,
    )
    return replace(task, noise=noise.rates, both=noise)


def with_less_noise(task: TraceTask, frame: RateFrame, columns: Sequence[Column]) -> TraceTask:
    """The task with the noise of these columns in each channel where they leave less than the task's own
    model did.

    Noise of a model that lacks something would hide what is lacking.
    """
    new, old = with_noise(task, frame, columns).both, task.both
    rates = (new.rates, new.size[0]) if new.size[0] < old.size[0] else (old.rates, old.size[0])
    force = (new.force, new.size[1]) if new.size[1] < old.size[1] else (old.force, old.size[1])
    noise = Noise(rates[0], force[0], (rates[1], force[1]), old.thinning)
    return replace(task, noise=noise.rates, both=noise)


def _mean_square(parts: Sequence[ComplexArray]) -> float:
    return float(np.mean(np.abs(np.concatenate(list(parts))) ** 2))


def residual(task: TraceTask, frame: RateFrame, columns: Sequence[Column]) -> Rows:
    """What columns and unknowns leave of the rates (but for a constant a piece) and of the force (rows,)."""
    return residuals(task, frame, columns, (task.part,))[0]


def residuals(
    task: TraceTask, frame: RateFrame, columns: Sequence[Column], parts: Sequence[Part]
) -> tuple[Rows, ...]:
    """The same on other parts of the record, fitted to the task's own."""
    everything = (*columns, *(given_column(name) for name in task.unknowns))
    values = solve_scaled(task.whole_design(frame, columns), task.raw_response)
    moments = [j for j, column in enumerate(everything) if column.mechanism != GIVEN]
    given = [j for j, column in enumerate(everything) if column.mechanism == GIVEN]
    rates = frame.observed - frame.columns([everything[j] for j in moments]) @ values[moments]
    histories = side_by_side([task.given[everything[j].term] for j in given])
    force = task.given[_OBSERVED].force - histories.force @ values[given]
    explained = histories.rates @ values[given]
    return tuple(Rows(rates[p.rows] - explained[p.samples], force[p.samples]) for p in parts)


def solution(
    task: TraceTask, frame: RateFrame, columns: tuple[Column, ...]
) -> tuple[FloatArray, ComplexArray]:
    """Coefficients (columns,), and the rates (n,) rad/s that the unknowns add over the whole flight."""
    values = solve_scaled(task.whole_design(frame, columns), task.raw_response)
    histories = side_by_side([task.given[name] for name in task.unknowns])
    return values[: len(columns)], histories.rates @ values[len(columns) :]


def unknown_values(task: TraceTask, frame: RateFrame, columns: tuple[Column, ...]) -> dict[str, float]:
    """The unknowns by name, as fitted along with the columns."""
    values = solve_scaled(task.whole_design(frame, columns), task.raw_response)[len(columns) :]
    return dict(zip(task.unknowns, (float(value) for value in values), strict=True))


def with_efficiency(task: TraceTask, fit: HypothesisFit) -> TraceTask:
    """The task with the effective share of samples that a fit's residual shows."""
    pieces = task.part.thinned_pieces(task.both)
    n = pieces[-1][1]
    channels = fit.residual[: 4 * n].reshape(4, n)
    parts = [channel[a:b] for channel in channels for a, b in pieces]
    return replace(task, efficiency=effective_samples(parts) / (4 * n))


def _thinning(situation: Situation) -> int:
    """Samples that may be averaged where a cycle of the fastest motion keeps `_PER_CYCLE` rows."""
    motion, record = situation.reconstruction.motion, situation.record
    fastest = float(np.percentile(np.abs(motion.windward_meridian_rate), 95.0)) + float(
        np.max(np.abs(motion.p))
    )
    return max(1, int(2.0 * np.pi / (fastest * record.flight.step * _PER_CYCLE)))


def _rich_columns(frame: RateFrame, mechanisms: Sequence[Mechanism]) -> list[Column]:
    """All terms of the mechanisms, at coarse knots and the middle of their grids."""
    time = frame.time
    coarse = np.linspace(time.min(), time.max(), 6)[1:-1]
    found: list[Column] = []
    for mechanism in mechanisms:
        middle = theta_grid(mechanism)[len(theta_grid(mechanism)) // 2]
        found.extend(candidates(mechanism, frame.motions[0], coarse, (middle,)))
    return found
