"""`predict`: what a model that was found on other flights, its coefficients frozen, says of this one.

In order: the model on this flight (`frozen`), whether the flight contradicts it (`changes`), and how far its moments
may lie from the model's (`band`).
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from threadpoolctl import threadpool_limits

from brv_hypo.arrays import BoolArray
from brv_hypo.comparison.summary import estimates, flight_summary, record_summary
from brv_hypo.errors import UsageError
from brv_hypo.flight import FlightSource, one_flight
from brv_hypo.flight.derived import averaged
from brv_hypo.flight.record import Flight
from brv_hypo.linearisation.channels import HELD_OUT_SHORTEST
from brv_hypo.linearisation.frame import ResidualMoments
from brv_hypo.mechanisms.contract import current_name
from brv_hypo.model.model import SavedModel, read_model
from brv_hypo.motion import try_record
from brv_hypo.prediction import result
from brv_hypo.prediction.band import band_of
from brv_hypo.prediction.changes import tested_against
from brv_hypo.prediction.frozen import INSTRUMENTS, frozen_on, tolerated
from brv_hypo.prediction.result import ErrorsOfPrediction, ModelSource, Prediction
from brv_hypo.progress import Progress, report_to
from brv_hypo.settings import settings_of, takes_settings
from brv_hypo.tracing.fit import Corrected, require_samples
from brv_hypo.tracing.result import TRACED_SMALLEST, ModelSummary, Trace, TraceConfig, TraceSettings

PREDICTED_BLOCKS = 8  # at least, of the record's: the fewest that a trace may be set to cut it into
_REGIONS = 8  # stretches of the record whose errors are reported apart


@takes_settings(
    TraceConfig,
    model="Trace, its `model`, SavedModel, str or Path\n    What `trace` returned, the model of it, or a file that "
    "holds either.",
    refit="str or sequence of str\n    What belongs to this vehicle and is fitted here: mechanisms, coefficients, "
    "errors of the record;\n    `instruments` stands for all of these, within their tolerances.",
)
def predict(
    flight: FlightSource,
    model: Trace | ModelSummary | SavedModel | str | Path,
    refit: Sequence[str] | str = (),
    config: TraceConfig | Mapping[str, Any] | str | Path | None = None,
    *,
    progress: Progress | None = None,
    **settings: Unpack[TraceSettings],
) -> Prediction:
    """Errors of the moments that a frozen model predicts for a flight.

    Errors of the record that the model holds, within tolerances or beyond, are those of its own flight, and are left
    out, unless this is that flight (its file, or a copy of its record); so is what belongs to its times, unless `refit`
    names it. On its own record nothing is tested, nor where next to no samples are at Mach numbers and angles of attack
    that the model was found at. What the model left on stretches held out where it was found widens the band. A record
    that contradicts itself is predicted as it is; `record` of the result says so.

    Returns
    -------
    Prediction
        Errors (mean squares of the moment coefficients), by region too, and the prediction interval.

    Examples
    --------
    >>> import brv_hypo
    >>> flown, sister = (brv_hypo.simulate("research_cone", seed=seed, sample_rate=50.0) for seed in (1, 2))
    >>> traced = brv_hypo.trace(flown, effects=["magnus"], discover=False)
    >>> brv_hypo.predict(sister, traced).ratio < 0.01
    True
    """
    report_to(progress)(0.0, "predicting the moments")
    summary = model.model if isinstance(model, Trace) else model
    saved = summary.definition if isinstance(summary, ModelSummary) else summary
    if not isinstance(saved, SavedModel | str | Path):
        raise UsageError(f"got {type(saved).__name__} for a model, expected what `trace` returned, or a file of it.")
    named = refit.split(",") if isinstance(refit, str) else refit
    refitted = tuple(current_name(name.strip()) for name in named if name.strip())
    path = None if isinstance(saved, SavedModel) else Path(saved)
    chosen = settings_of(TraceConfig, config, settings, ["refit"])
    content = saved if isinstance(saved, SavedModel) else read_model(Path(saved))
    own = one_flight(flight)
    record = averaged(own)  # as `trace` has it
    most = record.samples // HELD_OUT_SHORTEST  # blocks, by which nothing is chosen here
    fewest = PREDICTED_BLOCKS * HELD_OUT_SHORTEST
    require_samples(record, fewest, "know its motion and noise. Widen --start and --stop.")
    chosen = chosen.model_copy(update={"blocks": min(chosen.blocks, most)})
    with threadpool_limits(limits=1, user_api="blas"):
        found = _predict(record, content, path, refitted, chosen)
    return found.model_copy(update={"record": record_summary([try_record(own)[1]])})


def _predict(
    flight: Flight, content: SavedModel, path: Path | None, refit: tuple[str, ...], config: TraceConfig
) -> Prediction:
    frozen = frozen_on(flight, content, refit, config)
    fit, data, columns, known = frozen.fit, frozen.fit.data, frozen.fit.model.columns, frozen.known
    # What `--refit` would name as well to let record and vehicle err; nothing where all of it is fitted already.
    more = [name for name in tolerated(flight) if name in {c.mechanism for c in columns} and name not in refit]
    more += [] if INSTRUMENTS in refit else [INSTRUMENTS]
    measured, within, own = data.moments(data.frame.observed), frozen.within.left, frozen.own.left
    left = fit.left if more else within
    errors = ErrorsOfPrediction(
        without=measured.mean_square(),
        frozen=left.mean_square(),
        within=within.mean_square(),
        own=own.mean_square(),
        noise=measured.mean_square_of_noise(),
    )
    # Coefficients that are fitted here are beside errors within tolerances.
    covariance = frozen.within.covariance[: len(columns), : len(columns)].copy()
    covariance[np.ix_(known, known)] = frozen.covariances[0]
    values = np.where(np.isfinite(frozen.fixed), fit.values, frozen.within.values)
    terms = estimates(columns, values, covariance, data.frame)
    # A test of estimates against the record that they are of would count it twice, and one on next to no samples that
    # the model is known at would be one of its extrapolation.
    tested = None if frozen.here or frozen.flown.sum() < TRACED_SMALLEST else tested_against(frozen, terms)
    differences = () if tested is None else tested.differences
    found = Prediction(
        flight=flight_summary(flight),
        model=ModelSource(path=None if path is None else str(path), found_on=content.found_on),
        frozen=tuple(terms[k] for k in known),
        refitted=tuple(term for k, term in enumerate(terms) if k not in known),
        error=errors,
        ratio=errors.frozen / errors.without,
        explained=1.0 - _unexplained(measured, left, errors.noise, frozen.flown),
        flown=float(frozen.flown.mean()),
        band=band_of(frozen, measured),
        regions=_regions(data, measured, left),
        local_change=None if tested is None else tested.change,
        difference=next(iter(differences), None),
        further_differences=differences[1:],
        refused=tested is not None and tested.refused,
        misfit=float("nan") if tested is None else tested.misfit,
        far_processes=() if tested is None else tested.far,
        left_out=frozen.left_out,
        own_record=frozen.here,
        of_own=1.0 if frozen.here else sum(flight.window(*s).samples for s in frozen.own_spans) / flight.samples,
        reason="",
    )
    fitted = 1.0 - _unexplained(measured, own, errors.noise, frozen.flown)
    rest, freely = (_unexplained(measured, each, errors.noise) for each in (left, within))
    remedy = ",".join((*refit, *more)) if more and not (frozen.here and frozen.content.errors) else ""
    return found.model_copy(update={"reason": result.reason(found, fitted, rest, freely, remedy)})


def _regions(data: Corrected, measured: ResidualMoments, left: ResidualMoments) -> tuple[result.Region, ...]:
    """Errors over even stretches of the record, with the Mach numbers that each runs through."""
    time, mach = data.frame.time, data.frame.motions[0].mach[data.frame.samples(0)]
    found = []
    for start, stop in itertools.pairwise(np.linspace(time.min(), time.max(), _REGIONS + 1).tolist()):
        inside = (time >= start) & (time <= stop) & left.usable
        if not np.any(inside):
            continue
        own, ratio = mach[inside], left.mean_square(inside) / measured.mean_square(inside)
        ends = (float(own.min()), float(own.max())) if np.all(np.isfinite(own)) else None
        found.append(result.Region(start_s=start, stop_s=stop, mach=ends, ratio=ratio))
    return tuple(found)


def _unexplained(
    measured: ResidualMoments, left: ResidualMoments, noise: float, kept: BoolArray | slice = slice(None)
) -> float:
    """The share of the moments' mean square, noise aside, that a model does not explain over all or some samples."""
    if not np.any(left.usable[kept]):
        return 1.0
    return max(left.mean_square(kept) - noise, 0.0) / max(measured.mean_square(kept) - noise, 1e-300)
