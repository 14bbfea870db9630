"""What a model leaves beyond the noise, as measured on stretches that took no part in its fit: for predictive bands.

A record's noise says how far its moments lie from a model that is right. One that is only the best that was found errs
besides, by as much as it did where it had to predict.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.mechanisms.contract import Mechanism
from brv_hypo.mechanisms.filed import FiledMechanism
from brv_hypo.model.columns import Column
from brv_hypo.regression.residual_moments import ResidualMoments
from brv_hypo.residuals.linearisation import Seen
from brv_hypo.residuals.saved import ModelError

# Weights of a held-out stretch and of its neighbours in Mach number: one stretch alone holds few cycles.
_NEIGHBOURS = (0.25, 0.5, 0.25)


def lasting(columns: Sequence[Column], mechanisms: Mapping[str, Mechanism]) -> BoolArray:
    """Which columns do not belong to the times of one record, and mean the same on another (columns,)."""
    return np.array([not _follows_time(column, mechanisms[column.mechanism]) for column in columns], dtype=bool)


def _follows_time(column: Column, mechanism: Mechanism) -> bool:
    terms = mechanism.definition if isinstance(mechanism, FiledMechanism) else ()
    return column.course.kind != "constant" or any(t.name == column.term and t.follows_time for t in terms)


def model_error(seen: Seen, own: ResidualMoments, elsewhere: ResidualMoments) -> ModelError:
    """What the model leaves on the held-out part, and what it leaves there without what belongs to its own flights."""
    pieces = [rows for a, b in seen.held_out.pieces if np.any(own.usable[rows := seen.held_out.rows[a:b]])]
    mach = np.concatenate([rec.motion.mach[seen.samples_of(k)] for k, rec in enumerate(seen.reconstructions)])
    noise = np.concatenate(
        [rec.moments.noise_sigma[seen.samples_of(k)] for k, rec in enumerate(seen.reconstructions)]
    )
    excess = np.array([[_excess(left, rows, noise) for rows in pieces] for left in (own, elsewhere)])
    sizes = np.array([np.count_nonzero(own.usable[rows]) for rows in pieces], dtype=float)
    places = np.array([float(np.mean(mach[rows])) for rows in pieces])
    if not np.all(np.isfinite(places)) or np.unique(places).size < places.size:
        return ModelError(**_told(excess @ sizes[:, np.newaxis] / sizes.sum()))
    order = np.argsort(places)
    weights = _near(places.size) * sizes[order]
    smooth = (excess[:, order] @ weights.T) / weights.sum(axis=1)
    return ModelError(mach=tuple(places[order].tolist()), **_told(smooth))


def _excess(left: ResidualMoments, rows: IntArray, noise: FloatArray) -> float:
    """Mean square of either coefficient on some rows, less that of the noise."""
    kept = rows[left.usable[rows]]
    return float(np.mean(np.abs(left.body[kept]) ** 2 / 2.0 - noise[kept] ** 2))


def _near(count: int) -> FloatArray:
    """Weights (count, count) of every stretch's neighbours."""
    before, here, after = _NEIGHBOURS
    off = np.ones(max(count - 1, 0))
    return np.asarray(here * np.eye(count) + np.diag(before * off, -1) + np.diag(after * off, 1), dtype=float)


def _told(variances: FloatArray) -> dict[str, tuple[float, ...]]:
    own, elsewhere = np.sqrt(np.maximum(variances, 0.0)).tolist()
    return {"own": tuple(own), "elsewhere": tuple(elsewhere)}


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
