"""The evidence of a hypothesis, and all that is read off it.

    y = U b + X c + Z a + e        (`inference.marginal`, where b, c and a are integrated out)

log p(y | S, t, s) is maximised together with the logarithms' Gaussian priors over the amplitudes S of processes, t of
the mechanism and the noise s, by Newton's method in a trust region. Knots and delays have the spread of a uniform
prior: their posterior widths over their ranges are Occam's share of what was searched.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import cho_solve, helmert
from scipy.optimize import minimize

from brv_hypo.arrays import FloatArray
from brv_hypo.inference import marginal
from brv_hypo.inference.fit import HypothesisFit, LeftOut
from brv_hypo.inference.marginal import Integrated
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.rows import Products, Rows, Terms, rows_of
from brv_hypo.linearisation.nuisance import Nuisance
from brv_hypo.thresholds import MECHANISM_AMPLITUDE, NOISE_LEVEL

_LARGEST, _WALL = float(np.log(3.0)), 0.1  # logarithm of the largest amplitude, and 1-sigma of the prior beyond it
_SLOPE = 0.1  # nats a logarithm, at which a maximisation ends: one more step of Newton's squares what is wrong there
_ROUNDING = 1e-9  # of a covariance
_LARGEST_STEP = 3.0  # of all logarithms together


@dataclass(frozen=True)
class Evidence(Integrated):
    """A hypothesis at its most probable amplitudes; `level` is its log evidence, but for a constant of the rows."""

    level: float

    @property
    def noise(self) -> float:
        """Noise over that measured in the record, from differences of its samples."""
        return float(np.exp(self.at[0]))

    def has_processes_above(self, times: float) -> bool:
        """Whether the amplitude of any process is above so many times its ordinary one."""
        ordinary = np.array([group.prior[0] for group in self.rows.groups])
        return bool(np.any(self.at[1 : 1 + ordinary.size] > ordinary + np.log(times)))

    @property
    def beside_small(self) -> Evidence:
        """The same with processes of the moment one prior sigma below their ordinary amplitude, whatever terms lack."""
        at, groups = self.at.copy(), self.rows.groups
        at[1 : 1 + len(groups)] = [
            group.prior[0] - group.prior[1] if group.of_moment else own
            for own, group in zip(at[1:], groups, strict=False)
        ]
        return replace(self, at=at)

    @property
    def of_both_sizes(self) -> tuple[Evidence, ...]:
        """Itself and, where its processes are large, the same beside small ones: large ones make up for a mechanism."""
        return (self, self.beside_small) if self.has_processes_above(1.0) else (self,)

    @property
    def residual(self) -> FloatArray:
        """Rows (n,) less all that is fitted, under the stated noise."""
        fitted = np.concatenate([self.rows.shared, self.terms.x], axis=1) @ self.solution.border
        return np.asarray(self.rows.y - fitted - self._of_processes)

    @cached_property
    def _of_processes(self) -> FloatArray:
        """What all processes make of the rows (n,), at their mode."""
        out = np.zeros(self.rows.y.size)
        for block, own in zip(self.rows.blocks, self.processes, strict=True):
            out[block.rows] = block.z @ (marginal.scale_of(self.rows, block, self.at) * own.mode)
        return out

    @cached_property
    def made_of_terms(self) -> FloatArray:
        """What the terms make of the rows (n,) beside the baseline, knots and delays where they are."""
        known, count = self.rows.coefficients.shape[0], int(np.sum(self.terms.scaled))
        values = self.values_without(range(count, self.terms.known))[known : known + count]
        if (closed := self.terms.coefficients) is not None:
            values = np.asarray(np.linalg.solve(closed, values), dtype=float)
        return self.rows.beside_baseline(self.terms.x[:, :count] @ values)

    @property
    def share_of_terms(self) -> float:
        """Of the squares that terms and processes make beside the baseline, those that terms make. Squares that
        processes make of noise alone do not count: its square per degree of freedom.
        """
        made = self.made_of_terms, self.rows.beside_baseline(self._of_processes)
        terms, processes = (float(np.sum(part**2)) for part in made)
        freedom = sum(float(np.sum(1.0 - own.variances)) for own in self.processes)
        return terms / max(terms + max(processes - self.noise**2 * freedom, 0.0), 1e-300)

    @property
    def values(self) -> FloatArray:
        """Coefficients of the baseline's columns and of the hypothesis's terms, then shifts of knots and delays."""
        return np.asarray(self._values_of_border @ self.solution.border)

    @property
    def covariance(self) -> FloatArray:
        """That of `values`, everything else free."""
        made = self._values_of_border
        return np.asarray(self.noise**2 * made @ self.solution.covariance @ made.T)

    @property
    def _values_of_border(self) -> FloatArray:
        """What makes `values` of the solution's border (values, border)."""
        known, rank = self.rows.coefficients.shape
        count, first = self.terms.known, self.rows.shared.shape[1]
        made = np.zeros((known + count, self.solution.border.size))
        made[:known, :rank] = self.rows.coefficients
        made[known:, first : first + count] = np.eye(count)
        if (closed := self.terms.coefficients) is not None:
            made[known : known + len(closed), first : first + len(closed)] = closed
        return made

    @property
    def errors(self) -> FloatArray:
        """Of record and vehicle within tolerances (nuisances,), as the problem has its unknowns; elsewhere 0."""
        nuisances, residual = self.rows.problem.rows.nuisances, self.residual
        out = np.zeros(len(nuisances.items))
        for block in self.rows.blocks:
            within = list(block.items)
            out[within] = block.estimates @ (block.errors.T @ residual[block.rows])
        shared = [nuisances.items.index(each) for each in self.shared_tolerances]
        out[shared] = self.solution.border[self.rows.coefficients.shape[1] : self.rows.shared.shape[1]]
        known = [*shared, *(k for block in self.rows.blocks for k in block.items)]
        out[known] += [nuisances.items[k].present for k in known]
        return out

    @property
    def shared_tolerances(self) -> list[Nuisance]:
        """What tolerances allow that all flights share, in the order of U's last columns."""
        nuisances = self.rows.problem.rows.nuisances
        items = (nuisances.items[k] for k in nuisances.bounded.tolist())
        return [each for each in items if each.flight is None]

    @cached_property
    def error_sigmas(self) -> FloatArray:
        """Standard errors (nuisances,) of those of each flight, with those of terms, baseline and processes: a moment
        of the vehicle, or a turned axis, is known no better than what resembles it.
        """
        out = np.zeros(len(self.rows.problem.rows.nuisances.items))
        fixed = np.concatenate([self.rows.shared, self.terms.x], axis=1)
        for block, own in zip(self.rows.blocks, self.processes, strict=True):
            by_process = (block.estimates @ block.errors_in_z.T) * marginal.scale_of(self.rows, block, self.at)
            by_fixed = block.estimates @ (block.errors.T @ fixed[block.rows]) - by_process @ own.follows
            inverse = own.inverse + np.tril(own.inverse, -1).T
            variance = 1.0 - np.sum(block.estimates**2, axis=1)
            variance += np.sum((by_fixed @ self.solution.covariance) * by_fixed, axis=1)
            variance += np.sum((by_process @ inverse) * by_process, axis=1)
            out[list(block.items)] = self.noise * np.sqrt(np.maximum(variance, 0.0))
        return out

    @property
    def errors_of_processes(self) -> tuple[FloatArray, FloatArray]:
        """What processes of these sizes add to the errors of an estimate that knows none: to the covariance of `values`
        (values, values), and to the variances of errors within tolerances (nuisances,).
        """
        shared = np.append(self.rows.spread**-2.0, np.zeros(self.terms.spread.size))
        inner = self.products.across + np.diag(shared)
        factor = marginal.lower_factor(inner, float(np.max(np.diag(inner))))
        fixed = np.concatenate([self.rows.shared, self.terms.x], axis=1)
        made, variances = self._values_of_border, np.zeros(len(self.rows.problem.rows.nuisances.items))
        covariance = np.zeros((made.shape[0],) * 2)
        for number, known in self.products.flights.items():
            block = self.rows.blocks[number]
            scale = marginal.scale_of(self.rows, block, self.at)
            moved = cho_solve((factor, True), known.with_border.T * scale, check_finite=False)  # by each coefficient
            covariance += (made @ moved) @ (made @ moved).T
            followed = block.errors_in_z.T * scale - block.errors.T @ fixed[block.rows] @ moved
            variances[list(block.items)] = np.sum((block.estimates @ followed) ** 2, axis=1)
        return self.noise**2 * covariance, self.noise**2 * variances

    @property
    def informed(self) -> float:
        """By how much the data narrow the coefficients of X: log of the prior's over the posterior's volume."""
        first = self.rows.shared.shape[1]
        own = slice(first, first + self.terms.known)
        covariance, spread = self.solution.covariance[own, own], marginal.spreads(self.rows, self.terms, self.at)[own]
        return float(-0.5 * np.linalg.slogdet(covariance / np.outer(spread, spread))[1])

    def level_without(self, chosen: Sequence[int]) -> float:
        """Log evidence without some of X, at the same amplitudes (Savage, Dickey: Verdinelli and Wasserman 1995)."""
        places = self.rows.shared.shape[1] + np.array(chosen)
        covariance = self.solution.covariance[np.ix_(places, places)]
        at_mode, spread = self.solution.border[places], marginal.spreads(self.rows, self.terms, self.at)[places]
        _, level = np.linalg.slogdet(covariance / np.outer(spread, spread))
        squares = float(at_mode @ np.linalg.solve(covariance, at_mode)) / self.noise**2
        return self.level - 0.5 * (squares + float(level))

    def values_without(self, chosen: Sequence[int]) -> FloatArray:
        """`values` without some of the terms and shifts, as `level_without` has them, at the same amplitudes."""
        values, covariance = self.values, self.covariance
        places = values.size - self.terms.known + np.array(chosen, dtype=int)
        gain = np.linalg.solve(covariance[np.ix_(places, places)], values[places])
        return np.asarray(values - covariance[:, places] @ gain)

    @property
    def events_apart(self) -> tuple[FloatArray, FloatArray]:
        """How much later knots come on each flight than in the mean, s (knots, flights), and standard errors."""
        first, flights = self.rows.shared.shape[1] + self.terms.known, len(self.rows.blocks)
        count = self.terms.apart // (flights - 1)
        made = np.kron(np.eye(count), helmert(flights).T)
        variances = np.diag(made @ self.solution.covariance[first:, first:] @ made.T)
        late, sigmas = made @ self.solution.border[first:], self.noise * np.sqrt(variances)
        return late.reshape(count, flights), sigmas.reshape(count, flights)

    def made_by(self, process: int) -> FloatArray:
        """What a process's columns make of the rows before whitening (n,), at their mode."""
        out, amplitude = np.zeros(self.rows.y.size), marginal.amplitudes(self.rows, self.at)[process]
        for block, own in zip(self.rows.blocks, self.processes, strict=True):
            columns = block.columns[process]
            out[block.rows] = block.raw[:, columns] @ (amplitude * own.mode[columns])
        return out

    def spline_coefficients(self, process: int) -> tuple[FloatArray, FloatArray]:
        """The coefficients of a process, of all flights after one another, and their standard errors, in its units."""
        unit = marginal.amplitudes(self.rows, self.at)[process] * self.rows.groups[process].size
        each = [(own, b.columns[process]) for b, own in zip(self.rows.blocks, self.processes, strict=True)]
        modes = np.concatenate([own.mode[columns] for own, columns in each])
        variances = np.concatenate([own.variances[columns] for own, columns in each])
        return unit * modes, self.noise * unit * np.sqrt(np.maximum(variances, 0.0))

    def along(
        self, flight: int, values: FloatArray, splines: Mapping[int, FloatArray], allowed: FloatArray | float = 0.0
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """A linear function of what is fitted on a flight, its standard errors (points,), and how far what it is not
        made of is correlated with it (points, processes + coefficients): all coefficients of a process together
        (multiple correlation), and each coefficient of the baseline and the terms. `values` (points, coefficients):
        what it has per coefficient of the baseline and the terms; `splines` (points, splines): of each process by its
        place, per spline coefficient in its units; `allowed` (points, tolerances): per tolerance shared by all.
        """
        block, found, rank = self.rows.blocks[flight], self.solution, self.rows.coefficients.shape[1]
        of_flight, made = self.processes[flight], self._values_of_border
        known, first = self.rows.coefficients.shape[0], self.rows.shared.shape[1]
        shared = np.zeros((values.shape[0], found.border.size))
        shared[:, :rank] = values[:, :known] @ self.rows.coefficients
        shared[:, rank:first] = allowed
        shared[:, first : first + self.terms.known] = values[:, known:] @ made[known:, first : first + self.terms.known]
        own = np.zeros((values.shape[0], block.z.shape[1]))
        for k, each in splines.items():
            own[:, block.columns[k]] = marginal.amplitudes(self.rows, self.at)[k] * self.rows.groups[k].size * each
        follows, inverse = of_flight.follows, of_flight.inverse + np.tril(of_flight.inverse, -1).T
        both = shared - own @ follows
        variance = np.sum((both @ found.covariance) * both, axis=1)
        variance += np.sum((own @ inverse) * own, axis=1)
        across, squares = own @ inverse - both @ found.covariance @ follows.T, []  # with the processes' coefficients
        for k, columns in enumerate(block.columns):
            spread = inverse[columns, columns] + follows[columns] @ found.covariance @ follows[columns].T
            explained = np.sum(across[:, columns] * np.linalg.solve(spread, across[:, columns].T).T, axis=1)
            squares.append(np.where(np.any(splines.get(k, 0.0)), 0.0, explained))
        alone = np.sum((made @ found.covariance) * made, axis=1)
        with_values = np.where(np.any(values, axis=0), 0.0, both @ found.covariance @ made.T)
        squares += list((with_values**2 / np.maximum(alone, 1e-300)).T)
        correlation = np.sqrt(np.array(squares).T / np.maximum(variance, 1e-300)[:, np.newaxis])
        return shared @ found.border + own @ of_flight.mode, self.noise * np.sqrt(variance), correlation

    @property
    def held_out(self) -> FloatArray:
        """Log predictive density of each stretch of time given the others (stretches,)."""
        costs = [cost for cost, _, _ in self._without_stretches]
        return np.array(costs) - marginal.cost_of(self.products, self.rows, self.solution, self.at)

    def left_out(self, weight: float) -> LeftOut:
        """`values` without each stretch of time, at the same amplitudes; a nat counts as `weight` in errors."""
        changes = np.array([values for _, values, _ in self._without_stretches]) - self.values
        covariances = np.array([covariance for _, _, covariance in self._without_stretches])
        # What no stretch determines, as a knot in a gap, scatters by rounding alone.
        return LeftOut(changes, (covariances - (1.0 - _ROUNDING) * self.covariance) / weight)

    @cached_property
    def _without_stretches(self) -> list[tuple[float, FloatArray, FloatArray]]:
        """Minus log p, `values` and covariance without each stretch of time, which is of its flight alone."""
        known, made = self._parts, self._values_of_border
        without = []
        for stretch in self.rows.stretch_products:
            rest = self.products.less(stretch.beside(self.rows, self.terms.x))
            parts = {**known, **marginal.eliminated(rest, marginal.factored(rest, self.rows, self.at))}
            found = marginal.solution_of(rest, parts, self.rows, self.terms, self.at)
            covariance = self.noise**2 * made @ found.covariance @ made.T
            without.append((marginal.cost_of(rest, self.rows, found, self.at), made @ found.border, covariance))
        return without

    def with_moments(self, rates: FloatArray) -> Products:
        """Those with moments by their rates (rate rows, k) after the terms: of all evidences of these the same."""
        return self.products.beside_moments(self.rows, self.terms.x, rates)

    def projected(self, products: Products) -> tuple[FloatArray, FloatArray]:
        """X'PX and X'Py of what is beside the terms, P the inverse covariance with all else integrated out."""
        factors = marginal.factors_of(self.rows, self.at)
        inner, right = marginal.reduced(products, marginal.eliminated(products, factors))
        spread = marginal.spreads(self.rows, self.terms, self.at)
        first = spread.size
        inner[:first, :first] += np.diag(spread**-2.0)
        known = np.linalg.solve(inner[:first, :first], np.column_stack([inner[:first, first:], right[:first]]))
        found = np.column_stack([inner[first:, first:], right[first:]]) - inner[first:, :first] @ known
        return found[:, :-1] / self.noise**2, found[:, -1] / self.noise**2


def maximised(rows: Rows, terms: Terms, *starts: FloatArray) -> Evidence:
    """The evidence of terms at its most probable amplitudes, from the likeliest of some `starts`, without any from
    ordinary ones. A start is the logarithms of noise and processes, and perhaps of the mechanism.
    """
    surface = _Surface(rows, terms, rows.products.beside(rows, terms.x))
    centre, _ = surface.prior
    begun = [np.append(each[: centre.size], centre[each.size :]) for each in starts or [centre]]
    options: Any = {"gtol": _SLOPE, "max_trust_radius": _LARGEST_STEP}
    own, first = (surface.slope, surface.curvature), min(begun, key=surface.cost)
    best: Any = minimize(surface.cost, first, jac=own[0], hess=own[1], method="trust-exact", options=options)
    closer = best.x - np.linalg.solve(best.hess, best.jac)
    return surface.evidence(closer if surface.cost(closer) < best.fun else best.x)


def with_amplitudes(rows: Rows, terms: Terms, at: FloatArray) -> Evidence:
    """The evidence of terms at amplitudes that are given, as `Evidence.at`."""
    return _Surface(rows, terms, rows.products.beside(rows, terms.x)).evidence(at)


@dataclass(frozen=True)
class _Surface:
    """Minus log p of terms over the logarithms of the noise and the amplitudes, their Gaussian priors included."""

    rows: Rows
    terms: Terms
    products: Products
    _last: dict[bytes, Integrated] = field(default_factory=dict)

    @cached_property
    def prior(self) -> tuple[FloatArray, FloatArray]:
        """Centre and 1-sigma of each logarithm."""
        of_terms = [MECHANISM_AMPLITUDE] if np.any(self.terms.scaled) else []
        centre, width = np.array([NOISE_LEVEL, *(group.prior for group in self.rows.groups), *of_terms], dtype=float).T
        return centre, width

    def found(self, at: FloatArray) -> Integrated:
        """What is integrated out there."""
        key = at.tobytes()
        if key not in self._last:
            self._last.clear()
            self._last[key] = Integrated(self.rows, self.terms, self.products, at)
        return self._last[key]

    def evidence(self, at: FloatArray) -> Evidence:
        """That at these amplitudes."""
        own = Evidence(self.rows, self.terms, self.products, at, self.terms.prior - self.cost(at))
        vars(own)["solution"] = self.found(at).solution  # what the property would find
        return own

    def cost(self, at: FloatArray) -> float:
        """Minus log p, but for a constant."""
        centre, width = self.prior
        off = 0.5 * float(np.sum(((at - centre) / width) ** 2) + np.sum((_beyond(at) / _WALL) ** 2))
        return marginal.cost_of(self.products, self.rows, self.found(at).solution, at) + off

    def slope(self, at: FloatArray) -> FloatArray:
        """First derivatives."""
        centre, width = self.prior
        return np.asarray(marginal.slope_of(self.found(at)) + (at - centre) / width**2 + _beyond(at) / _WALL**2)

    def curvature(self, at: FloatArray) -> FloatArray:
        """Second derivatives."""
        prior = self.prior[1] ** -2.0 + (_beyond(at) > 0.0) / _WALL**2
        return np.asarray(marginal.curvature_of(self.found(at)) + np.diag(prior))


def _beyond(at: FloatArray) -> FloatArray:
    """By how much the logarithm of each amplitude is beyond the largest."""
    return np.concatenate([[0.0], np.maximum(at[1:] - _LARGEST, 0.0)])


def rows_under_own_noise(whole: Problem, point: HypothesisFit) -> tuple[Rows, FloatArray]:
    """The rows about a fit, each channel under its noise beside all processes; logarithms of the amplitudes."""
    rows, noise, half = rows_of(whole, point), whole.rows.noise, whole.rows.rates
    own = maximised(rows, rows.terms(point))
    residual, start = own.residual, own.at[: 1 + len(rows.groups)]
    channels = (slice(0, half), slice(half, None))
    rates, force = (float(np.sqrt(np.mean(residual[own][rows.counted[own]] ** 2))) for own in channels)
    scaled = [replace(own, sigma=by * own.sigma) for own, by in ((noise.rates, rates), (noise.force, force))]
    again = rows_of(whole.under(replace(noise, rates=scaled[0], force=scaled[1])), point)
    return replace(again, noise_ratio=float(np.hypot(rates, force) / np.sqrt(2.0))), start
