"""The noise that every hypothesis is judged by: what the record itself says of it, never the candidates.

A free moment, smooth in time, takes up what moved the vehicle slowly; the rest is the instruments' coloured noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.inference.bordered import Bordered
from brv_hypo.inference.problem import Problem, WhitenedRows
from brv_hypo.inference.unmodelled import free_moment
from brv_hypo.linearisation.channels import NOISE_ORDER, Lasting, Noise, fit_noise, fitted_by, lasting_noise, white
from brv_hypo.linearisation.response import LinearisedFlight
from brv_hypo.motion.interpolation import turning

# Held by `tests.studies.independent.study --coloured` (half of its flights in noise that lasts) and
# `tests/studies/independent/test_coloured_noise.py`.
NOISE_MOST_UNTHINNED = 8000  # rows up to which the fit that leaves the noise keeps all; beyond it takes next to none
NOISE_PER_CYCLE = 12  # rows that a cycle of the fastest motion keeps where whitened rows are averaged
NOISE_BEYOND = 2.0  # times the fastest motion's frequency, above which a spectrum is noise alone
NOISE_RAISED = 3  # times that the noise is raised to what the model leaves, which changes with it


def first_noise(flights: Sequence[LinearisedFlight]) -> Noise:
    """White noise of the level that the records themselves show, and how many rows may be averaged."""
    return Noise(
        white(float(np.median([each.record.gyro_sigma for each in flights]))),
        white(float(np.median([np.median(each.record.force_sigma) for each in flights]))),
        min(each.spacing(NOISE_PER_CYCLE) for each in flights),
    )


def estimated_noise(problem: Problem) -> Noise:
    """The noise with its colour, from what a free, smooth moment leaves."""
    frame, free = free_moment(problem)
    columns = (*problem.baseline, *free)
    rows, part = problem.rows, problem.rows.part
    thinning = 1 if part.rows.size <= NOISE_MOST_UNTHINNED else rows.noise.thinning
    plain = problem.under(Noise(white(rows.noise.rates.sigma), white(rows.noise.force.sigma), thinning))
    every = plain.rows.unknowns.beside(plain.raw_design(frame, columns))
    basis = every.factors.basis
    values = every.factors.coefficients(basis.coordinates(plain.raw_response[:, np.newaxis]))[:, 0]
    shared, others = every.places[-1].start, np.empty(plain.rows.unknowns.size)
    others[plain.rows.order] = np.delete(values, np.arange(shared, shared + len(columns)))
    of_columns, others = values[shared : shared + len(columns)], others[2 * len(part.levels) :]
    rest = plain.left(frame, columns, of_columns, others).at(part.rows)
    force = [rest.force[a:b][part.valid[a:b]] for a, b in part.pieces]
    rates_explained, force_explained = _explained(basis, plain.rows) if thinning == 1 else (None, None)
    rates = [rest.rates[a:b] - rest.rates[a:b].mean() for a, b in part.pieces]
    force = [piece for piece in force if piece.size]
    flown = zip(problem.frame.motions, problem.records, strict=True)
    motion = max(turning(each.windward_meridian_rate, each.p, record.flight.step) for each, record in flown)
    above = NOISE_BEYOND * 2.0 * np.pi / (NOISE_PER_CYCLE * rows.noise.thinning)
    return Noise(
        fit_noise(rates, rates_explained),
        fit_noise(force, force_explained),
        rows.noise.thinning,
        Lasting(lasting_noise(rates, above, motion), lasting_noise(force, above, motion), motion),
    )


def raised_noise(problem: Problem) -> Noise:
    """The problem's noise, each channel's raised to what the baseline leaves in it. What a model lacks is far more than
    noise; weighed as noise, it would drive the errors of the record far beyond their tolerances to make up for it.
    """
    least = problem.rows.noise
    for _ in range(NOISE_RAISED):
        noise, rates = problem.rows.noise, problem.rows.rates
        left = problem.projected_baseline(problem.frame).left
        levels = [float(np.sqrt(np.mean(left[rows] ** 2))) for rows in (slice(0, rates), slice(rates, 2 * rates))]
        if max(levels) <= 1.0:
            break
        channels = zip((noise.rates, noise.force), (least.rates, least.force), levels, strict=True)
        found = [replace(own, sigma=max(own.sigma * level, low.sigma)) for own, low, level in channels]
        problem = problem.under(replace(noise, rates=found[0], force=found[1]))
    return problem.rows.noise


def _explained(basis: Bordered, rows: WhitenedRows) -> tuple[FloatArray, FloatArray]:
    """What a fit on this orthonormal basis takes of the autocorrelation of white noise in rates and force."""
    found = np.zeros((2, NOISE_ORDER + 1))
    for own, columns, shared in zip(rows.of_flights, basis.own, basis.by_flight(basis.shared), strict=True):
        both, share = np.column_stack([columns, shared]), 2.0 * own.size / rows.rates
        for channel, out in enumerate(found):
            first = 2 * own.size * channel
            out += share * fitted_by(both[first : first + 2 * own.size], own.part.pieces, own.size)
    return found[0], found[1]
