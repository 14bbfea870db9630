"""Small random problems, and their likelihood written out: every covariance as a matrix, nothing eliminated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from scipy.linalg import block_diag

from brv_hypo.arrays import BoolArray, FloatArray
from brv_hypo.inference import Evidence, ProcessGroup, Rows
from brv_hypo.inference.problem import Problem
from brv_hypo.inference.rows import Block, Terms
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.thresholds import MECHANISM_AMPLITUDE, NOISE_LEVEL


@dataclass(frozen=True)
class Sizes:
    """Of a small problem: rows of a flight, columns of each kind, coefficients of each process."""

    flights: int = 1
    rows: int = 40
    baseline: int = 2
    allowed: int = 1
    terms: int = 2
    shifts: int = 1
    splines: tuple[int, ...] = (3, 4)
    without_prior: int = 0
    """Columns of each flight without a prior."""
    stretches: int = 4


def small(sizes: Sizes, seed: int) -> tuple[Rows, Terms]:
    """Random rows: all columns of unit size, so that any of them matters."""
    rng = np.random.default_rng(seed)
    count = sizes.flights * sizes.rows
    own = block_diag(
        *(np.linalg.qr(rng.standard_normal((sizes.rows, sizes.without_prior)))[0] for _ in range(sizes.flights))
    ).reshape(count, -1)

    def columns(number: int) -> FloatArray:
        made = rng.standard_normal((count, number))
        return np.asarray(made - own @ (own.T @ made))

    baseline = columns(sizes.baseline)
    orthonormal, triangle = np.linalg.qr(baseline)
    ends = np.cumsum(sizes.splines)
    starts = np.concatenate([[0], ends[:-1]])
    blocks = []
    for flight in range(sizes.flights):
        here = np.arange(flight * sizes.rows, (flight + 1) * sizes.rows)
        z = rng.standard_normal((sizes.rows, int(ends[-1])))
        own_z = z - own[here] @ (own[here].T @ z)
        places = tuple(slice(*each) for each in zip(starts, ends, strict=True))
        part = own[here][:, flight * sizes.without_prior : (flight + 1) * sizes.without_prior]
        no_errors = np.zeros((sizes.rows, 0)), np.zeros(0), np.zeros((0, 0)), ()
        blocks.append(Block(here, own_z, places, own_z, part, *no_errors))
    groups = tuple(
        ProcessGroup(f"process {k}", "family", "1", True, 1.0 + 0.5 * k, (-0.5 - 0.3 * k, 1.0))
        for k in range(len(sizes.splines))
    )
    rows = Rows(
        problem=cast(Problem, None),
        frame=cast(RateFrame, None),
        y=3.0 * columns(1)[:, 0],
        shared=np.concatenate([orthonormal, columns(sizes.allowed)], axis=1),
        spread=np.concatenate([np.full(sizes.baseline, np.inf), np.ones(sizes.allowed)]),
        coefficients=np.linalg.inv(triangle),
        blocks=tuple(blocks),
        groups=groups,
        modelled=np.ones(1, dtype=complex),
        static=1.0,
        counted=np.ones(count, dtype=bool),
    )
    edges = np.linspace(0.0, sizes.stretches, sizes.rows, endpoint=False).astype(int)
    vars(rows)["time_blocks"] = np.concatenate([edges + flight * sizes.stretches for flight in range(sizes.flights)])
    known = sizes.terms + sizes.shifts
    terms = Terms(columns(known), rng.uniform(0.5, 2.0, known), np.arange(known) < sizes.terms)
    return rows, terms


def without_prior(rows: Rows) -> FloatArray:
    """What has no prior and is of one flight: orthonormal columns (n, columns)."""
    parts = []
    for block in rows.blocks:
        part = np.zeros((rows.y.size, block.own.shape[1]))
        part[block.rows] = block.own
        parts.append(part)
    return np.concatenate(parts, axis=1)


@dataclass(frozen=True)
class Dense:
    """The same Gaussian as `Evidence` has, written out."""

    rows: Rows
    terms: Terms
    at: FloatArray
    """Logarithms of the noise, of every process's amplitude, and of the mechanism's."""

    @property
    def noise(self) -> float:
        return float(np.exp(self.at[0]))

    @property
    def flat(self) -> FloatArray:
        """All that has no prior (n, columns)."""
        return np.concatenate([without_prior(self.rows), self.rows.shared[:, np.isinf(self.rows.spread)]], axis=1)

    @property
    def bounded(self) -> tuple[FloatArray, FloatArray]:
        """All else (n, columns), and 1-sigma of their coefficients under noise of 1: c, then a of each flight."""
        rows, terms = self.rows, self.terms
        finite = np.isfinite(rows.spread)
        amplitude = np.exp(self.at[-1]) if np.any(terms.scaled) else 1.0
        amplitudes = np.exp(self.at[1 : 1 + len(rows.groups)])
        parts = [rows.shared[:, finite], terms.x]
        spreads = [rows.spread[finite], terms.spread * np.where(terms.scaled, amplitude, 1.0)]
        for block in rows.blocks:
            z = np.zeros((rows.y.size, block.z.shape[1]))
            z[block.rows] = block.z
            parts.append(z)
            spreads.append(
                np.concatenate(
                    [np.full(own.stop - own.start, s) for own, s in zip(block.columns, amplitudes, strict=True)]
                )
            )
        return np.concatenate(parts, axis=1), np.concatenate(spreads)

    @property
    def covariance(self) -> FloatArray:
        """V (n, n) of y but for what has no prior."""
        columns, spreads = self.bounded
        scaled = columns * spreads
        return np.asarray(self.noise**2 * (np.eye(self.rows.y.size) + scaled @ scaled.T))

    def log_density(self, chosen: BoolArray | None = None) -> float:
        """ln p of the rows chosen, what is flat integrated out with a density of 1, (2 pi) to any power left out."""
        use = np.ones(self.rows.y.size, dtype=bool) if chosen is None else chosen
        covariance, flat, y = self.covariance[np.ix_(use, use)], self.flat[use], self.rows.y[use]
        solved = np.linalg.solve(covariance, np.column_stack([flat, y]))
        inner, right = flat.T @ solved[:, :-1], flat.T @ solved[:, -1]
        square = float(y @ solved[:, -1] - right @ np.linalg.solve(inner, right))
        return -0.5 * (np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(inner)[1] + square)

    @property
    def log_prior(self) -> float:
        """That of the amplitudes, but for a constant."""
        groups = [group.prior for group in self.rows.groups]
        priors = [NOISE_LEVEL, *groups, *([MECHANISM_AMPLITUDE] if np.any(self.terms.scaled) else [])]
        centre, width = np.array(priors).T
        return -0.5 * float(np.sum(((self.at - centre) / width) ** 2))

    @property
    def log_evidence(self) -> float:
        return self.log_density() + self.log_prior

    @property
    def projector(self) -> FloatArray:
        """P (n, n): the inverse of V with what is flat integrated out."""
        inverse, flat = np.linalg.inv(self.covariance), self.flat
        through = inverse @ flat
        return np.asarray(inverse - through @ np.linalg.solve(flat.T @ through, through.T))

    def posterior(self) -> tuple[FloatArray, FloatArray]:
        """Mean and covariance of everything: flat, then what is bounded, by the normal equations of all of it."""
        columns, spreads = self.bounded
        whole = np.concatenate([self.flat, columns], axis=1)
        precision = np.concatenate([np.zeros(self.flat.shape[1]), spreads**-2.0])
        inverse = np.linalg.inv(whole.T @ whole + np.diag(precision))
        return inverse @ (whole.T @ self.rows.y), self.noise**2 * inverse


def dense(evidence: Evidence) -> Dense:
    """Where an evidence is."""
    return Dense(evidence.rows, evidence.terms, evidence.at)
