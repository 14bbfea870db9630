"""Which family of processes holds a residual, and whether an effect that a trace adds is wanted beside all of them.

    y = U b + X c + Z a + e        (`inference.evidence`)

U are the columns of a model before a step, X those of what was added, Z the splines of every process, all linear about
the model with it. An effect is established where the evidence without it, the amplitudes of processes estimated anew,
is far less, and refused where it is far larger; between these it is inconclusive. The residual is
decomposed by what explains it: first by effects, then by one family of processes after another, each the one that
raises the evidence most (forward selection). Entrance: `beside_processes`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial, reduce
from typing import TypeVar

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.comparison.with_processes import Pair, fitted, in_one_region, moved, plainest, price
from brv_hypo.inference.derivatives import process_history
from brv_hypo.inference.evidence import Evidence, maximised, rows_under_own_noise
from brv_hypo.inference.fit import HypothesisFit, solved
from brv_hypo.inference.held_out import jackknife_error
from brv_hypo.inference.problem import Problem, given_column
from brv_hypo.inference.reduced import Reduced
from brv_hypo.inference.refinement import nonlinear_parameters
from brv_hypo.inference.rows import Rows, Terms, prior_of_times, rows_of
from brv_hypo.io.text import estimated
from brv_hypo.linearisation.channels import Channels, Part
from brv_hypo.mechanisms.contract import MomentProcess, Process, RecordEffect, RecordProcess, rms_of_shapes
from brv_hypo.mechanisms.registry import moment_processes, record_effects, record_processes
from brv_hypo.model.baseline import SlopeSchedule
from brv_hypo.model.model import Model
from brv_hypo.model.term import Regressor, evaluated, summed, term_column
from brv_hypo.motion.motion import Motion
from brv_hypo.thresholds import FAMILY_MAJORITY, FAMILY_SIGNIFICANT, NORMAL_95, SPECIFIC
from brv_hypo.tracing.fit import Fit, has_tolerance, history_name
from brv_hypo.tracing.result import Family

# At least, where families are compared: of each shape of a process of moments, as of the damping; of each channel's
# error, as of the turbulence, next to the 40 of the body's random moments.
FAMILY_SPLINES, FAMILY_RECORD_SPLINES = 12, 36
RECORD_EFFECT_LARGEST = 30.0  # typical sizes that a record effect may have: the record would explain itself away
RECORD_SHARE_LARGEST = 1.0  # of what is measured, that an error in proportion to it may be: then nothing was measured
RECORD_EFFECT_PRIOR = 30.0  # SI units, 1-sigma of what is added: it costs some nats, lest it come before moments
_Process = TypeVar("_Process", MomentProcess, RecordProcess)
_PLACES = 9  # at which the history of a process is looked at


@dataclass(frozen=True)
class Beside:
    """A model and all processes about one point; `terms` are those of each effect that it added."""

    point: HypothesisFit
    rows: Rows
    terms: Mapping[str, Terms]
    families: Mapping[str, str]  # that of each effect
    start: FloatArray  # logarithms of noise and amplitudes beside all of it
    problem_with: Callable[[Sequence[RecordEffect]], Problem]  # the problem with processes of the record

    @cached_property
    def _known(self) -> dict[tuple[tuple[str, ...], tuple[str, ...] | None], Evidence]:
        return {}

    def evidence(self, names: Sequence[str], families: Sequence[str] | None = None) -> Evidence:
        """Of some of the effects, beside all processes or those of some families."""
        key = tuple(names), None if families is None else tuple(families)
        if key not in self._known:
            terms = reduce(Terms.beside, [self.terms[name] for name in names], self.rows.terms(None))
            rows = self.rows if families is None else self.rows.only(families)
            self._known[key] = maximised(rows, terms, *([self.start] if families is None else []))
        return self._known[key]

    def _squares(self, names: Sequence[str]) -> float:
        """Of the residual of the baseline, its tolerances and some effects, without processes."""
        return float(np.sum(self.evidence(names, ()).residual ** 2))

    def _of_processes(self, names: Sequence[str], families: Sequence[str] = ()) -> float:
        """Fall of the squares by those processes that the evidence wants beside effects: others take noise alone."""
        last = [self.evidence(names, ()), *(own for _, own in self._selected(names, families))][-1]
        return self._squares(names) - float(np.sum(last.residual**2))

    def gain(self, name: str, in_place: bool = False) -> float:
        """By how much an effect raises the log evidence beside the others; `in_place` of its family's processes."""
        others = {group.family for group in self.rows.groups} - {self.families[name]}
        own = self.evidence(list(self.terms), sorted(others) if in_place else None)
        return own.level - self.evidence([each for each in self.terms if each != name]).level

    def rest_of_family(self, name: str) -> float:
        """What processes of an effect's family explain beside it, over what it explains itself."""
        names = list(self.terms)
        explains = self._squares([each for each in names if each != name]) - self._squares(names)
        return self._of_processes(names, [self.families[name]]) / max(explains, 1e-300)

    def likeliest(self, fit: HypothesisFit) -> tuple[float, tuple[Regressor, ...]]:
        """The log evidence that an effect gains where it is likeliest beside all processes, and its columns there: as
        it was fitted or acting between two times, without changes that are not wanted (`compare` has it so).
        """
        pair, problem = self._pair(fit), self.rows.problem
        if fit.mechanisms and (fit.mechanisms[0].time_variation != ("constant",) or fit.mechanisms[0].parameters()):
            one = len(self.rows.frame.motions) == 1
            frame = self.rows.frame_of(pair.fit)
            offered = in_one_region(problem, pair, self.null, frame) if one else [pair]
            pair = plainest(problem, offered, self.null) if one else moved(problem, pair)
        return pair.level - price(pair.fit) - self.null.level, pair.fit.selected

    def gain_of(self, fit: HypothesisFit) -> float:
        """The log evidence that an effect gains as it was fitted."""
        return self._pair(fit).level - self.null.level

    def _pair(self, fit: HypothesisFit) -> Pair:
        if not fit.mechanisms:
            terms = _of_record(self.rows.of_moments(self.rows.frame, fit.selected), fit.searched)
            return Pair(fit, maximised(self.rows, terms, self.start))
        like = replace(fit, frame=self.rows.problem.frame.with_mechanisms(fit.mechanisms))
        return fitted(self.rows.problem, like, fit.selected, self.null)

    @property
    def null(self) -> Evidence:
        """Of the baseline and processes alone."""
        return self.evidence([])

    def unwanted(self, effects: Sequence[str]) -> tuple[str, ...]:
        """Those of some effects without which the evidence is far larger, the least wanted first, and again."""
        names, found = list(self.terms), list[str]()
        while rest := [name for name in effects if name in names]:
            levels = {name: self.evidence([each for each in names if each != name]).level for name in rest}
            least = max(rest, key=levels.__getitem__)
            if levels[least] < self.evidence(names).level + SPECIFIC:
                break
            names.remove(least)
            found.append(least)
        return tuple(found)

    def is_adequate(self, names: Sequence[str]) -> bool:
        """Whether effects explain more of the residual than processes beside them; so where there is neither."""
        return self._squares([]) - self._squares(names) >= self._of_processes(names)

    def shares(self, names: Sequence[str]) -> tuple[Family, ...]:
        """What effects, then families explain of the residual, with intervals (jackknife over stretches of time)."""
        finer, selected = self._with_finer, self._with_finer._selected(names)
        known_by = [family for family, _ in selected]  # its processes
        order = [*(self.families[name] for name in names), *known_by]
        found_without = [self.evidence(names[:count], ()) for count in range(len(names) + 1)]
        residuals = [each.residual for each in (*found_without, *(own for _, own in selected))]
        squares = [np.bincount(self.rows.time_blocks, weights=each**2).astype(float) for each in residuals]
        falls = dict[str, FloatArray]()
        for family, before, after in zip(order, squares, squares[1:], strict=False):
            falls[family] = np.asarray(falls.get(family, 0.0) + before - after)
        largest = self._largest(selected[-1][1]) if selected else {}
        found = []
        for family, fall in falls.items():
            share, left_out = float(fall.sum() / squares[0].sum()), squares[0].sum() - squares[0]
            # Efron and Stein, Ann. Statist. 9, 1981.
            error = NORMAL_95 * jackknife_error((fall.sum() - fall) / np.maximum(left_out, 1e-300))
            low, high = np.clip([share - error, share + error], 0.0, 1.0).tolist()
            others = [each for each in known_by if each != family]
            evidence = selected[-1][1].level - finer.evidence(names, others).level if family in known_by else 0.0
            found.append(
                Family(
                    family=family,
                    share=min(max(share, 0.0), 1.0),
                    interval_95=(low, high),
                    evidence=evidence,
                    effects=tuple(name for name in names if self.families[name] == family),
                    process=largest.get(family, (None, ""))[0],
                    extremes=largest.get(family, (None, ""))[1],
                )
            )
        return tuple(sorted(found, key=lambda each: -each.share))

    @cached_property
    def _with_finer(self) -> Beside:
        """With every history nearly as fine, so that no family explains more by its resolution alone."""
        own, problem = self.rows.problem.rows, self.problem_with(_finer(record_processes()))
        finer = rows_of(problem.on(own.part).under(own.noise), self.point, _finer(moment_processes()))
        return replace(self, rows=replace(finer, y=self.rows.y))  # what was added to the record is not taken out of it

    @cached_property
    def majority(self) -> str | None:
        """The family of processes that explains more than half of the residual; None where none does."""
        found = self.shares([])
        return found[0].family if found and found[0].share > FAMILY_MAJORITY else None

    def _selected(self, names: Sequence[str], families: Sequence[str] = ()) -> list[tuple[str, Evidence]]:
        """Families, all or of some, one after another, each the one that raises the evidence most, while that gains."""
        every = list(families or dict.fromkeys(group.family for group in self.rows.groups))
        found = list[tuple[str, Evidence]]()
        level = self.evidence(names, ()).level
        while len(found) < len(every):
            known = [family for family, _ in found]
            tried = {each: self.evidence(names, [*known, each]) for each in every if each not in known}
            best = max(tried, key=lambda family: tried[family].level)
            if tried[best].level <= level + FAMILY_SIGNIFICANT:
                break
            found.append((best, tried[best]))
            level = tried[best].level
        return found

    def _largest(self, own: Evidence) -> dict[str, tuple[str, str]]:
        """Of each family the largest process, and its least and largest value on the first flight, in words."""
        every: tuple[Process, ...] = (*_finer(moment_processes()), *_finer(record_processes()))
        processes, groups, motion = {each.name: each for each in every}, own.rows.groups, self.rows.frame.motions[0]
        places = np.linspace(0, motion.time.size - 1, _PLACES).round().astype(int)
        shares = (motion.time[places] - motion.time[0]) / np.ptp(motion.time)
        sizes, found = [float(np.linalg.norm(own.made_by(k))) for k in range(len(groups))], dict[str, tuple[str, str]]()
        for k in np.argsort(sizes).tolist():  # of each family the largest is the last
            process, said = processes[groups[k].name], list[str]()
            unit = rms_of_shapes(process, motion) if isinstance(process, MomentProcess) else 1.0
            values, errors = (each / unit for each in process_history(own, k, process.splines, 0, shares))
            value = values[0] if len(values) == 1 else np.linalg.norm(values, axis=0)
            sigma = np.linalg.norm(values * errors, axis=0) / np.maximum(np.abs(value), 1e-300)
            for j in sorted({int(np.argmin(value)), int(np.argmax(value))}):
                time, mach, alpha = (float(each[places[j]]) for each in (motion.time, motion.mach, motion.alpha))
                units = "" if groups[k].units == "1" else f" {groups[k].units}"
                where = f"{time:.2f} s (Mach {mach:.3g}, alpha {np.degrees(alpha):.2g}°)"
                said.append(f"{estimated(float(value[j]), float(sigma[j]))}{units} at {where}")
            found[groups[k].family] = process.name, f"{process.title}: {' to '.join(said)}"
        return found


def beside_processes(
    fit: Fit, before: Model, part: Part | None = None, given: Mapping[str, Channels] | None = None
) -> Beside:
    """What a fit has more than a model `before`, beside all processes; `given`: histories that may be columns."""
    model, data, count = fit.model, fit.data, len(before.columns)
    base, added = model.columns[:count], model.columns[count:]
    known = {(each.effect.name, each.component, each.flight) for each in before.applied}
    applied = [each for each in model.applied if (each.effect.name, each.component, each.flight) not in known]
    histories = {**(given or {}), **fit.histories(applied)}
    corrections = [dict(each) for each in data.corrections]
    for each in applied:
        key = (each.effect.name, each.component)
        corrections[each.flight][key] = corrections[each.flight].get(key, 0.0) + each.value
    bare = model.but(columns=base, applied=before.applied, mechanisms=before.mechanisms)
    problem_with = partial(replace(data, corrections=tuple(corrections)).regression, bare, fit.linear, histories)
    problem = problem_with(record_processes()).on(part or data.whole)
    mechanisms = tuple(model.mechanisms[name] for name in dict.fromkeys(column.mechanism for column in added))
    frame = problem.frame.with_mechanisms(mechanisms)
    point = solved(Reduced(problem, frame), "model", mechanisms, (*base, *added), 1)
    point = replace(point, nonlinear=nonlinear_parameters(point.selected, frame, problem.knots))
    rows, start = rows_under_own_noise(problem, point)
    every, motions = rows.terms(point), rows.frame.motions
    terms, families = dict[str, Terms](), dict[str, str]()
    for name in (mechanism.name for mechanism in mechanisms):  # its terms, and what its knots and delays move
        places = [k for k, column in enumerate(added) if column.mechanism == name]
        moves = [k for k, each in enumerate(point.nonlinear) if set(each.columns) <= set(places)]
        prior = prior_of_times([model.mechanisms[name]], [added[k] for k in places])
        terms[name] = replace(every.only([*places, *(len(added) + k for k in moves)]), prior=prior)
        families[name] = _family_of(point, motions, name)
    if SlopeSchedule.name in model.mechanisms.keys() - before.mechanisms.keys():  # it is of the effect that follows it
        effect, schedule = next(m.name for m in mechanisms if m.follows == "mach"), model.mechanisms[SlopeSchedule.name]
        scheduled = [term_column(schedule, term) for term in schedule.terms(motions[0], {})]
        x = rows.of_moments(rows.frame.with_mechanisms([schedule]), scheduled)
        spread = np.array(schedule.tolerance(data.flights[0]))
        terms[effect] = terms[effect].beside(Terms(x, spread, np.zeros(spread.size, dtype=bool)))
    shift = np.zeros(rows.y.size)
    for name in dict.fromkeys(each.effect.name for each in applied):
        own = [each for each in applied if each.effect.name == name]
        x = rows.of_moments(rows.frame, [given_column(history_name(each)) for each in own])
        searched = next((each for each in record_effects() if each.name == name), own[0].effect)  # not as it is set
        variants = [(each, flight) for flight in data.flights for each in searched.variants(flight)]
        terms[name] = _of_record(x, sum(len(each.components(flight)) for each, flight in variants))
        families[name] = own[0].effect.family
        if not has_tolerance(problem, name):
            shift += x @ np.array([each.value for each in own])
    return Beside(point, replace(rows, y=rows.y + shift), terms, families, start, problem_with)


def _finer(processes: Sequence[_Process]) -> list[_Process]:
    """The processes, with no fewer splines than where families are compared."""
    least = [FAMILY_RECORD_SPLINES if isinstance(each, RecordProcess) else FAMILY_SPLINES for each in processes]
    return [each.model_copy(update={"splines": max(each.splines, n)}) for each, n in zip(processes, least, strict=True)]


def _of_record(x: FloatArray, searched: int) -> Terms:
    """Histories (n, k) of one SI unit of a record effect's components, of so many; priors keep them small."""
    spread, choices = np.full(x.shape[1], RECORD_EFFECT_PRIOR), math.comb(max(searched, x.shape[1]), x.shape[1])
    return Terms(x, spread, np.zeros(spread.size, dtype=bool), -math.log(choices))


def _family_of(point: HypothesisFit, motions: Sequence[Motion], name: str) -> str:
    """The family that an effect states, or whose shapes make most of its moment, each by itself between two changes."""
    if (stated := point.frame.mechanisms[name].stated_family) is not None:
        return stated
    known, processes = list(zip(point.columns, point.values.tolist(), strict=True)), moment_processes()
    residuals = np.zeros(len(processes))
    for number, motion in enumerate(motions):
        chosen = [(c, value) for c, value in known if c.mechanism == name and c.acts_on(number)]
        terms = evaluated([column for column, _ in chosen], point.frame.mechanisms, motion)
        shapes = (term.in_plane + 1j * term.out_of_plane for term in terms)
        weights = (value * column.time_basis(motion.coefficient_time) for column, value in chosen)
        moment = summed(shapes, weights, motion.alpha.astype(complex))
        changes = sorted({end for c, _ in chosen for end in (c.time_basis.start, c.time_basis.stop)})
        parts = np.searchsorted(changes, motion.coefficient_time, side="right")
        for k, process in enumerate(processes):
            made = np.array([moment, *process.shapes(motion)]).T
            for use in parts == np.unique(parts)[:, np.newaxis]:  # what real multiples of the shapes do not make
                both = np.concatenate([made[use].real, made[use].imag])
                rest = both[:, 0] - both[:, 1:] @ np.linalg.lstsq(both[:, 1:], both[:, 0], rcond=None)[0]
                residuals[k] += rest @ rest
    return processes[int(np.argmin(residuals))].family
