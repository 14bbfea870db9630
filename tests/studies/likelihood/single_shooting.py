"""Single shooting: output error by forward integration, as a reference for the collocation.

Runge-Kutta steps finer than the samples carry the states and their sensitivities; Gauss-Newton with
Levenberg damping in the parameters and the initial states together. It needs a start near the solution,
and an unstable motion defeats it: `fit` is what to use.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.likelihood.collocation import Function, Points, evaluate, jacobian
from brv_hypo.likelihood.segment import Segment, build_grid, interpolation
from brv_hypo.likelihood.statistics import estimate_variance, negative_log_likelihood, whitening

_DAMPING = (0.0, 1e-4, 1e-2, 1.0, 1e2, 1e4)
"""Levenberg damping of the scaled normal equations, tried in this order at each step."""


@dataclass(frozen=True)
class ShootingResult:
    """Estimate by single shooting.

    `status` is "converged", "iteration limit", "stalled" or "diverged"; `theta` name to value; `x0`
    (n_segments, n_states);
    `std_error` by name, residuals taken as white; `nllf` by Eq. 3.10 (E8); `states` by segment, (n_states,
    n).
    """

    status: str
    theta: dict[str, float]
    std_error: dict[str, float]
    x0: FloatArray
    nllf: float
    noise_variance: FloatArray
    iterations: int
    states: tuple[FloatArray, ...]


@dataclass(frozen=True)
class _Record:
    """A segment on the fine grid of the integration: full and half steps."""

    t: FloatArray
    u: FloatArray
    y: FloatArray
    samples: slice
    u_samples: FloatArray
    t_samples: FloatArray


def fit_single_shooting(
    dynamics: Function,
    outputs: Function,
    segments: Sequence[Segment],
    theta0: Mapping[str, float],
    *,
    fixed: Collection[str] = (),
    substeps: int = 4,
    max_iterations: int = 100,
    tolerance: float = 1e-6,
) -> ShootingResult:
    """Output error by single shooting; arguments as in `fit`.

    `substeps` Runge-Kutta steps are taken per sample interval.

    Initial states start at each segment's x0 (its first column) and are free. Functions must be analytic
    (complex step).

    Raises:
        UsageError: a segment that cannot be used.
    """
    if not segments:
        raise UsageError("no segments were given; expected at least one")
    records = tuple(_record(segment, s, substeps) for s, segment in enumerate(segments))
    names = tuple(name for name in theta0 if name not in fixed)
    start = np.array([np.asarray(s.x0, dtype=float).reshape(len(s.x0), -1)[:, 0] for s in segments])
    unknown = np.concatenate([[float(theta0[name]) for name in names], start.ravel()])
    shooter = _Shooter(dynamics, outputs, records, dict(theta0), names, start.shape)
    return shooter.run(unknown, max_iterations, tolerance)


class _Shooter:
    """The iteration; `unknown` is the free parameters and then the initial states."""

    def __init__(
        self,
        dynamics: Function,
        outputs: Function,
        records: tuple[_Record, ...],
        theta: dict[str, float],
        names: tuple[str, ...],
        shape: tuple[int, int],
    ) -> None:
        self.dynamics, self.outputs, self.records = dynamics, outputs, records
        self.theta, self.names, self.shape = theta, names, shape
        self.measured = np.concatenate([np.isfinite(r.y) for r in records], axis=1)
        mean_square = np.nanmean(np.concatenate([r.y for r in records], axis=1) ** 2, axis=1)
        self.floor = 1e-14 * mean_square + 1e-300

    def run(self, unknown: FloatArray, max_iterations: int, tolerance: float) -> ShootingResult:
        """Iterate to a negligible step."""
        p = len(self.names)
        residual = self._residual(unknown)
        status, variance = "diverged", np.nan * self.floor
        information = np.full((unknown.size, unknown.size), np.nan)
        performed = 0
        if np.all(np.isfinite(residual[self.measured])):
            variance = estimate_variance(residual, self.floor)
            status = "iteration limit"
            for performed in range(1, max_iterations + 1):  # noqa: B007 - reported after the loop
                step, information, accepted = self._step(unknown, residual, variance)
                if not accepted:
                    status = "stalled"
                    break
                unknown = unknown + step
                residual = self._residual(unknown)
                new = estimate_variance(residual, self.floor)
                change = float(np.max(np.abs(new / variance - 1.0)))
                variance = new
                if np.sqrt(step @ information @ step / p) < tolerance and change < np.sqrt(tolerance):
                    status = "converged"
                    break
        return self._result(unknown, residual, variance, information, status, performed)

    def _step(
        self, unknown: FloatArray, residual: FloatArray, variance: FloatArray
    ) -> tuple[FloatArray, FloatArray, bool]:
        rows = self._sensitivity(unknown)
        whitener = whitening(variance, self.measured)
        scaled = (whitener[:, :, None] * rows).reshape(-1, unknown.size)
        right = np.nan_to_num(whitener * residual.T).ravel()
        information, gradient = scaled.T @ scaled, scaled.T @ right
        norm = np.sqrt(np.diag(information))
        norm[norm == 0] = 1.0
        normal = information / np.outer(norm, norm)
        cost = float(right @ right)
        for damping in _DAMPING:
            step = np.linalg.lstsq(normal + damping * np.eye(norm.size), gradient / norm, rcond=1e-14)[0] / norm
            trial = self._residual(unknown + step)
            if np.all(np.isfinite(trial[self.measured])):
                with np.errstate(over="ignore"):
                    moved = float(np.nansum((whitener * trial.T) ** 2))
                if moved <= cost * (1 + 1e-12):
                    return step, information, True
        return np.zeros_like(unknown), information, False

    def _values(self, unknown: FloatArray) -> tuple[dict[str, float], FloatArray]:
        p = len(self.names)
        return self.theta | dict(zip(self.names, unknown[:p].tolist(), strict=True)), unknown[p:].reshape(self.shape)

    def _residual(self, unknown: FloatArray) -> FloatArray:
        """Measured minus predicted output, (n_outputs, all samples), nan in gaps."""
        theta, x0 = self._values(unknown)
        parts = []
        for record, start in zip(self.records, x0, strict=True):
            with np.errstate(all="ignore"):
                x = _integrate(self.dynamics, record, start, theta)[:, record.samples]
                y = evaluate(self.outputs, Points(x, record.u_samples, record.t_samples), theta)
            parts.append(record.y - y)
        return np.concatenate(parts, axis=1)

    def _sensitivity(self, unknown: FloatArray) -> FloatArray:
        """Derivative of the predicted outputs by all unknowns, (all samples, n_outputs, unknowns)."""
        theta, x0 = self._values(unknown)
        p, n_states = len(self.names), self.shape[1]
        parts = []
        for s, (record, start) in enumerate(zip(self.records, x0, strict=True)):
            x = _integrate(self.dynamics, record, start, theta)
            by_unknown = _propagate(self.dynamics, record, x, theta, self.names)[
                record.samples.start :: record.samples.step
            ]
            at = Points(x[:, record.samples], record.u_samples, record.t_samples)
            output = jacobian(self.outputs, at, theta, self.names, "complex", {})
            rows = np.zeros((at.t.size, output.value.shape[0], unknown.size))
            local = output.by_state @ by_unknown
            rows[:, :, :p] = output.by_parameter + local[:, :, :p]
            rows[:, :, p + s * n_states : p + (s + 1) * n_states] = local[:, :, p:]
            parts.append(rows)
        return np.concatenate(parts)

    def _result(
        self,
        unknown: FloatArray,
        residual: FloatArray,
        noise: FloatArray,
        information: FloatArray,
        status: str,
        iterations: int,
    ) -> ShootingResult:
        theta, x0 = self._values(unknown)
        usable = bool(np.all(np.isfinite(information))) and np.linalg.cond(information) < 1e15
        variance = np.diag(np.linalg.inv(information)) if usable else np.full(unknown.size, np.nan)
        finite = bool(np.all(np.isfinite(residual[self.measured])))
        return ShootingResult(
            status=status,
            theta=theta,
            std_error=dict(zip(self.names, np.sqrt(variance[: len(self.names)]).tolist(), strict=True)),
            x0=x0,
            nllf=negative_log_likelihood(residual, noise) if finite else float("nan"),
            noise_variance=noise,
            iterations=iterations,
            states=tuple(
                _integrate(self.dynamics, r, s, theta)[:, r.samples] for r, s in zip(self.records, x0, strict=True)
            ),
        )


def _record(segment: Segment, number: int, substeps: int) -> _Record:
    """Times and inputs at every half step: two per Runge-Kutta step."""
    grid = build_grid(segment, number)
    if segment.hold != "cubic":
        raise UsageError(
            f"segment {number}: hold is {segment.hold!r}; single shooting interpolates inputs by cubics only. "
            "Use `fit`, which knows all holds"
        )
    t = grid.t[: grid.n]
    per_interval = 2 * substeps
    fraction = np.arange(per_interval) / per_interval
    fine = np.append((t[:-1, None] + np.diff(t)[:, None] * fraction).ravel(), t[-1])
    u = grid.u[:, : grid.n]
    return _Record(fine, np.asarray(u @ interpolation(t, fine)[0].T), grid.y, slice(0, None, substeps), u, t)


def _integrate(dynamics: Function, record: _Record, start: FloatArray, theta: Mapping[str, float]) -> FloatArray:
    """States after each Runge-Kutta step, (n_states, steps + 1)."""
    t, u = record.t, record.u
    steps = (t.size - 1) // 2
    x = np.empty((start.size, steps + 1))
    x[:, 0] = start

    def slope(state: FloatArray, k: int) -> FloatArray:
        return np.asarray(dynamics(state[:, None], u[:, k : k + 1], theta, t[k : k + 1]))[:, 0]

    for i in range(steps):
        k, now = 2 * i, x[:, i]
        h = t[k + 2] - t[k]
        k1 = slope(now, k)
        k2 = slope(now + h / 2 * k1, k + 1)
        k3 = slope(now + h / 2 * k2, k + 1)
        k4 = slope(now + h * k3, k + 2)
        x[:, i + 1] = now + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        if not np.all(np.isfinite(x[:, i + 1])):
            x[:, i + 1 :] = np.nan
            break
    return x


def _propagate(
    dynamics: Function, record: _Record, x: FloatArray, theta: Mapping[str, float], names: tuple[str, ...]
) -> FloatArray:
    """Derivative of the states after each step by parameters and initial state.

    Shape (steps + 1, n_states, p + n_states).
    """
    n_states, p = x.shape[0], len(names)
    steps = x.shape[1] - 1
    h = (record.t[2::2] - record.t[:-2:2])[:, None, None]
    now, unit = x[:, :-1], np.eye(n_states)
    by_state = np.zeros((steps, n_states, n_states))
    by_parameter = np.zeros((steps, n_states, p))
    slope, ahead = np.zeros_like(now), np.zeros((steps, n_states, n_states + p))
    for weight, reach, offset in ((1.0, 0.0, 0), (2.0, 0.5, 1), (2.0, 0.5, 1), (1.0, 1.0, 2)):
        at = slice(offset, offset + 2 * steps, 2)
        stage = Points(now + reach * h[:, 0, 0] * slope, record.u[:, at], record.t[at])
        local = jacobian(dynamics, stage, theta, names, "complex", {})
        inner = reach * h * ahead
        ahead = np.concatenate(
            [
                local.by_state @ (unit + inner[:, :, :n_states]),
                local.by_state @ inner[:, :, n_states:] + local.by_parameter,
            ],
            axis=2,
        )
        slope = local.value
        by_state += weight * h / 6 * ahead[:, :, :n_states]
        by_parameter += weight * h / 6 * ahead[:, :, n_states:]
    found = np.zeros((steps + 1, n_states, p + n_states))
    found[0, :, p:] = unit
    for k in range(steps):
        found[k + 1] = found[k] + by_state[k] @ found[k]
        found[k + 1, :, :p] += by_parameter[k]
    return found
