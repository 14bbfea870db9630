"""What a model leaves beyond the noise, as measured on stretches that took no part in its fit: for predictive bands.

A record's noise says how far its moments lie from a model that is right. One that is only the best that was found errs
besides, by as much as it did where it had to predict.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import stats

from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.constants import MODEL_ERROR_CHANCE, MODEL_ERROR_WEIGHTS
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.mechanisms.yaml_mechanism import YamlMechanism
from brv_hypo.model.term import Regressor
from brv_hypo.regression.residual_moments import ResidualMoments
from brv_hypo.regression.whitening import effective_samples
from brv_hypo.residuals.linearisation import Seen
from brv_hypo.residuals.saved import ModelError


def lasting(columns: Sequence[Regressor], mechanisms: Mapping[str, Mechanism]) -> BoolArray:
    """Which columns do not belong to the times of one record, and mean the same on another (columns,)."""
    return np.array([not _follows_time(column, mechanisms[column.mechanism]) for column in columns], dtype=bool)


def _follows_time(column: Regressor, mechanism: Mechanism) -> bool:
    terms = mechanism.definition if isinstance(mechanism, YamlMechanism) else ()
    return column.time_basis.kind != "constant" or any(t.name == column.term and t.follows_time for t in terms)


def model_error(seen: Seen, own: ResidualMoments, elsewhere: ResidualMoments) -> ModelError:
    """What the model leaves on the held-out part, and what it leaves there without what belongs to its own flights.

    Nothing where that is no more than the noise may leave by chance.
    """
    pieces = [rows for a, b in seen.held_out.pieces if np.any(own.usable[rows := seen.held_out.rows[a:b]])]
    mach = np.concatenate([rec.motion.mach[seen.samples_of(k)] for k, rec in enumerate(seen.reconstructions)])
    places = np.array([float(np.mean(mach[rows])) for rows in pieces])
    apart = bool(np.all(np.isfinite(places))) and np.unique(places).size == places.size
    order = np.argsort(places) if apart else np.arange(places.size)
    pieces = [pieces[k] for k in order]
    weights = _near(len(pieces)) if apart else np.ones((1, len(pieces)))
    found = (_beyond(left, pieces, weights) for left in (own, elsewhere))
    told = dict(zip(("own", "elsewhere"), (tuple(np.sqrt(each).tolist()) for each in found), strict=True))
    return ModelError(mach=tuple(places[order].tolist()) if apart else (), **told)


def _beyond(left: ResidualMoments, pieces: Sequence[IntArray], weights: FloatArray) -> FloatArray:
    """Mean square of either coefficient beyond that of the noise, by weighted means (means, pieces) of pieces."""
    kept = [rows[left.usable[rows]] for rows in pieces]
    weights = weights * [rows.size for rows in kept]
    weights = weights / weights.sum(axis=1, keepdims=True)
    squares = np.array([np.mean(np.abs(left.body[rows]) ** 2) / 2.0 for rows in kept])
    noises = np.array([np.mean(left.noise[rows] ** 2) for rows in kept])
    parts = [part(left.body[rows] / left.noise[rows]) for part in (np.real, np.imag) for rows in kept]
    share = effective_samples(parts) / sum(part.size for part in parts)
    # Of a mean square with so many degrees of freedom, were it noise alone.
    errors = noises * np.sqrt(2.0 / np.maximum([2.0 * share * rows.size for rows in kept], 1.0))
    found, noise, error = weights @ squares, weights @ noises, np.sqrt(weights**2 @ errors**2)
    # Weighted means are nearly such a mean square again (Satterthwaite, Biometrics 2:110, 1946); of all of them, the
    # largest exceeds what chance gives one.
    freedom = 2.0 * (noise / error) ** 2
    most = noise * stats.chi2.isf(MODEL_ERROR_CHANCE / len(weights), freedom) / freedom
    return np.asarray(np.where(found > most, found - noise, 0.0), dtype=float)


def _near(count: int) -> FloatArray:
    """Weights (count, count) of every stretch's neighbours."""
    before, here, after = MODEL_ERROR_WEIGHTS
    off = np.ones(max(count - 1, 0))
    return np.asarray(here * np.eye(count) + np.diag(before * off, -1) + np.diag(after * off, 1), dtype=float)


def error_at(error: ModelError | None, mach: FloatArray, *, elsewhere: bool) -> FloatArray:
    """Its 1-sigma (n,) at the Mach numbers of a flight (n,); where these are unknown, the rms of all."""
    if error is None:
        return np.zeros(mach.shape)
    values = np.array(error.elsewhere if elsewhere else error.own)
    whole = float(np.sqrt(np.mean(values**2)))
    if not error.mach:
        return np.full(mach.shape, whole)
    known = np.isfinite(mach)
    found = np.sqrt(np.interp(np.where(known, mach, error.mach[0]), error.mach, values**2))
    return np.where(known, found, whole)
