"""A prediction's outcome in a few sentences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from brv_hypo.constants import (
    PREDICTED_DISTINCT,
    PREDICTED_GREATLY,
    PREDICTED_HOLDS,
    PREDICTED_NEARLY_ALL,
    PREDICTED_SMALL,
)
from brv_hypo.residuals.prediction import Band, Difference, LocalChange
from brv_hypo.thresholds import REFUSED

_NARROW = " Its errors are larger here than on the flights that it was found on: this interval is too narrow."


@dataclass(frozen=True)
class Shares:
    """What the frozen model explains, and the same model refitted; the share of the samples that both are told of.

    Of the whole record: what the frozen model leaves (`left`), and what it would if record and vehicle erred within
    their tolerances (`freed`).
    """

    left: float
    freed: float
    frozen: float
    own: float
    flown: float


def reason(
    shares: Shares,
    band: Band,
    noise: float,
    remedy: str,
    left_out: Sequence[str],
    differs: tuple[LocalChange | None, Difference | None],
) -> str:
    """The outcome in a few sentences.

    `noise` is its mean square, `remedy` what `--refit` would name as well; `left_out` are mechanisms of the model that
    belong to its own flights; `differs` is where and in what this flight differs.
    """
    if shares.flown == 0.0:
        nowhere = (
            "All samples lie at other Mach numbers or angles of attack than the model was found at: it predicts "
            "nothing about this flight."
        )
        return nowhere + _held_too_much(shares, remedy)
    beyond = (
        f" {100.0 * (1.0 - shares.flown):.0f} % of the samples lie at other Mach numbers or angles of attack than the "
        "model was found at, and are not counted in these shares."
    )
    return (
        f"The frozen model {_explains(shares.frozen)} the moments' mean square, noise aside; "
        f"the same model fitted to this flight {_explains(shares.own)} it. The frozen model's "
        f"{100.0 * band.level:.0f} % prediction interval holds {100.0 * band.inside:.1f} % of the samples."
        + (_NARROW if band.inside < PREDICTED_HOLDS else "")
        + _of_the_model(band, noise)
        + (beyond if shares.flown < PREDICTED_NEARLY_ALL else "")
        + _of_a_difference(differs[1])
        + _of_a_change(differs[0])
        + _held_too_much(shares, remedy)
        + _of_other_times(left_out)
    )


def _explains(share: float) -> str:
    """What a model does to a mean square; one that explains less than nothing does not hold."""
    if share > 0.9995:
        return "explains more than 99.9 % of"
    if share >= 0.0:
        return f"explains {100.0 * share:.1f} % of"
    return f"does not hold here: its error is {1.0 - share:.3g} times"


def _of_a_difference(found: Difference | None) -> str:
    """The coefficient that contradicts the model."""
    if found is None or found.p_value >= REFUSED:
        return ""
    units = "" if found.units == "1" else f" {found.units}"
    beside = ", processes fitted beside the model" if found.beside_processes else ""
    return (
        f" This flight contradicts the model (p {found.p_value:.2g}): {found.term} is {found.frozen:.4g}{units} there, "
        f"and {found.value:+.2g} ± {found.std_error:.2g} more here{beside}."
    )


def _of_a_change(change: LocalChange | None) -> str:
    """Where slope or damping differ from the model's, and by how much."""
    if change is None:
        return ""
    where = f"{change.start_s:.2f} and {change.stop_s:.2f} s"
    if change.mach is not None:
        where += f", Mach {change.mach[1]:.4g} to {change.mach[0]:.4g}"
    units = "" if change.units == "1" else f" {change.units}"
    return (
        f" This flight differs most from the model between {where}: {change.term} is "
        f"{'larger' if change.value > 0.0 else 'smaller'} there by {abs(change.value):.3g} ± {change.std_error:.2g}"
        f"{units} than elsewhere (F {change.f_ratio:.0f})."
    )


def _held_too_much(shares: Shares, remedy: str) -> str:
    """What to do where the model fails, or would fail far less, for what record and vehicle are held not to err by."""
    much = shares.left > PREDICTED_SMALL and shares.freed < PREDICTED_GREATLY * shares.left
    if not remedy or not (much or shares.left > 1.0 or shares.frozen < 0.0):
        return ""
    return (
        f" Over the whole record its error is {shares.left:.3g} of the mean square. Errors of the record were assumed "
        "zero, and those of the vehicle as on the flights that the model was found on; "
        f"`--refit {remedy}` lets this flight have its own"
        + (f", for an error of about {shares.freed:.2g}." if much else ".")
    )


def _of_other_times(left_out: Sequence[str]) -> str:
    if not left_out:
        return ""
    act, are, they = ("acts", "is", "it") if len(left_out) == 1 else ("act", "are", "they")
    return (
        f" {', '.join(left_out)} of the model {act} at times of the flight that it was found on, and {are} left out "
        f"here; the moment that {they} explained there is included in the prediction interval."
    )


def _of_the_model(band: Band, noise: float) -> str:
    """What is said of a band that is wider than the noise for what the model left where it was found."""
    if band.model_error**2 < PREDICTED_DISTINCT * noise:
        return ""
    return (
        f" On held-out blocks of the flights that it was found on its residual was {band.model_error:.2g} (rms), "
        f"{band.model_error / np.sqrt(noise):.1f} times the noise: it is not adequate there, and the prediction "
        "interval includes this residual."
    )
