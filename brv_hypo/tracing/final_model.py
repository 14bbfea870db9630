"""The model that a trace ends with: coefficients on the whole record, and what they make of slopes.

Entrance: `gathered`, the result of a trace.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from brv_hypo.arrays import BoolArray, ComplexArray, FloatArray
from brv_hypo.comparison import diagnostics
from brv_hypo.comparison.intervals import Excess, estimate
from brv_hypo.comparison.result import RecordError, TermEstimate
from brv_hypo.comparison.summary import estimates, flight_summary, motion_histories, motion_summary, of_flight
from brv_hypo.inference.derivatives import Derivative, along_flights, damping, slope
from brv_hypo.inference.evidence import Evidence
from brv_hypo.inference.fit import HypothesisFit
from brv_hypo.io.text import estimated, times
from brv_hypo.linearisation.channels import effective_samples
from brv_hypo.linearisation.frame import ResidualMoments
from brv_hypo.mechanisms.yaml_mechanism import MechanismFile, YamlMechanism
from brv_hypo.model.model import Model, ModelError, SavedModel, SavedRecordError, digest
from brv_hypo.model.term import Regressor
from brv_hypo.tracing.acceptance import impossible_value
from brv_hypo.tracing.description import GENERIC, file_of
from brv_hypo.tracing.fit import Corrected, Fit
from brv_hypo.tracing.result import Account, ModelSummary, Picture, Step, Stop, Trace, names_added

UNSTABLE_SIGMAS = 3.0  # of the worst of 32 places (`REPORTED_SLOPES`): at 5 % (Bonferroni)
OF_AN_ERROR = {"value", "std_error", "units"}  # of the record, that an estimate has too
MODEL_ERROR_CHANCE = 0.05  # that noise alone leaves as much on any held-out stretch of a flight


def impossible_in(whole: Fit, beside: Evidence) -> Excess | None:
    """A value of the final model that is significantly beyond what its mechanism allows; its errors have what processes
    make of them. None where there is none, and of several flights, whose values differ.
    """
    if len(whole.data.records) > 1:
        return None
    columns, frame, covariance = whole.model.columns, whole.data.frame, whole.joint_covariance.copy()
    covariance[: len(columns), : len(columns)] += beside.errors_of_processes[0]
    mechanisms = tuple(frame.mechanisms[name] for name in dict.fromkeys(column.mechanism for column in columns))
    known = columns, 0, whole.values, np.zeros(0), 0, 1.0, 0, whole.nonlinear, covariance
    return impossible_value(HypothesisFit("model", mechanisms, frame, *known))


def gathered(
    fit: Fit,
    whole: Fit,
    impossible: Excess | None,
    before: ResidualMoments,
    beside: Evidence,
    steps: Sequence[Step],
    account: tuple[Account, ...],
    stopped: Stop,
    discovery: MechanismFile | None,
) -> Trace:
    """The result of the contract, of residual moments `before`, and the last model's evidence `beside` processes."""
    data, flights, final = fit.data, fit.data.source.records, fit.residual
    columns, values, covariance = whole.coefficients
    # The coefficients are fitted without processes, and have the errors that these make of them besides; the columns of
    # the baseline's tolerances, of which they make none, come last.
    of_processes = np.pad(beside.errors_of_processes[0], (0, values.size - len(fit.model.columns)))
    covariance = covariance + of_processes
    terms = estimates(columns, values, covariance, data.frame)
    weight = beside.rows.problem.efficiency_of(beside.residual)  # errors count samples that are independent
    slopes, damped = (
        along_flights(beside, beside.rows.problem.baseline, beside.rows.frame, by, weight) for by in (slope, damping)
    )
    number = final.flight or 0  # the one of several that is drawn
    rows = np.arange(fit.left.usable.size)[data.frame.span(number)]
    kept = (before.usable & fit.left.usable)[rows]
    samples, rows = data.frame.samples(number)[kept], rows[kept]
    pairs = zip(flights, slopes, strict=True)
    alone = [data.source.read(k, Model(), {})[1] for k in range(len(flights))]
    motions, moved = diagnostics.motions_beside(data.frame.reconstructions, alone)
    in_record = _record_terms(whole)
    added = [  # beyond their tolerances
        RecordError(name=f"{t.mechanism} {t.name}", tolerance=a.size, **t.model_dump(include=OF_AN_ERROR))
        for a, t in zip(whole.model.applied, in_record, strict=True)
        if a.effect.carried
    ]
    known = sorted((*added, *diagnostics.record_errors(beside, weight)), key=lambda each: -each.sigmas)
    caveats = [each for flight, own in pairs for each in diagnostics.caveats_of(flight, own)]
    beyond = [f"{each.mechanism} is beyond what is possible: {each.words}" for each in [impossible] if each is not None]
    return Trace(
        flight=flight_summary(flights[0]),
        flights=tuple(flight_summary(flight) for flight in flights),
        steps=tuple(steps),
        findings=names_added(steps, "finding"),
        hints=names_added(steps, "hint"),
        families=steps[0].families,
        account=account,
        model=ModelSummary(terms=(*terms, *in_record), definition=_definition(fit, whole, covariance, of_processes)),
        reconstruction=motion_summary(motions, moved),
        record_errors=tuple(known),
        **diagnostics.collinear(terms, covariance),
        static_slopes=slopes,
        static_stability=stability_in_words(slopes),
        damping=damped,
        dynamic_stability=damping_in_words(damped),
        stopped=stopped,
        unexplained=None if final.white else f"The residual has {final.words}.",
        caveats=(*beyond, *dict.fromkeys(caveats)),
        noise=fit.left.mean_square_of_noise(data.reported.rows),
        final_residual=final,
        discovered=_described(fit.model, columns, values) or discovery,
        picture=Picture(
            measured=pair(data.moments(data.frame.observed).body[rows]),
            before=pair(before.body[rows]),
            after=pair(fit.left.body[rows]),
            sigma=tuple(fit.left.noise[rows].tolist()),
            whitened=diagnostics.whitened(beside, number),
            **motion_histories(motions[number], samples),
        ),
    )


def _described(model: Model, columns: Sequence[Regressor], values: FloatArray) -> MechanismFile | None:
    """All that was added in generic terms, with its values (columns,)."""
    pieces = []
    for name, piece in model.mechanisms.items():
        if name.startswith(GENERIC) and isinstance(piece, YamlMechanism):
            own = [k for k, column in enumerate(columns) if column.mechanism == name]
            pieces.append((piece, [columns[k] for k in own], values[own]))
    return file_of(pieces) if pieces else None


def pair(values: ComplexArray) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Pitch and yaw of moments (n,), as a result has them."""
    return tuple(values.real.tolist()), tuple(values.imag.tolist())


# ---- In words: stability, the residual, and what in the data could pose as an effect ----


def stability_in_words(slopes: Sequence[Derivative], moment: str = "static moment", doubt: bool = True) -> str:
    """Where a moment is unstable or, with `doubt`, not surely stable: at zero alpha, or as flown where none is near."""
    margin, sentences = diagnostics.STABLE_SIGMAS if doubt else -UNSTABLE_SIGMAS, []
    for one in slopes:
        of = f"{moment} of flight {one.flight + 1}" if len(slopes) > 1 else moment
        beyond, flown = np.array(one.extrapolated), np.array([one.at_flown, one.at_flown_std_error])
        for (values, errors), where in ((flown, beyond), ((one.at_zero, one.at_zero_std_error), ~beyond)):
            chosen = where & (np.add(values, np.multiply(margin, errors)) >= 0.0)
            if not np.any(chosen):
                continue
            worst = int(np.argmax(np.where(chosen, np.divide(values, np.maximum(errors, 1e-300)), -np.inf)))
            said = "is unstable" if values[worst] > UNSTABLE_SIGMAS * errors[worst] else "is not significantly stable"
            words = f"the {of} {said} {_when(one, chosen)}: {estimated(values[worst], errors[worst])} per rad at "
            time, alpha = times(one.time_s[worst]), f"{np.degrees(one.alpha_rad[worst]):.2g} deg"
            if where is beyond:
                sentences.append(f"At the angle flown {words}{time} and {alpha}.")
            else:
                there = f"{estimated(*flown[:, worst])} at the {alpha} flown there"
                sentences.append(f"At alpha = 0 {words}{time}, and {there}.")
    return " ".join(sentences)


def damping_in_words(damped: Sequence[Derivative]) -> str:
    """Where the damping is unstable, and changes by more than the largest of so many differences at 5 % (Tukey)."""
    said = [stability_in_words(damped, "damping moment", doubt=False)]
    for one in damped:
        values, errors = np.array(one.at_flown), np.array(one.at_flown_std_error)
        ends = [int(np.argmin(values)), int(np.argmax(values))]
        most = float(stats.studentized_range.isf(MODEL_ERROR_CHANCE, values.size, np.inf)) / np.sqrt(2.0)
        if np.ptp(values) > most * np.hypot(*errors[ends]):
            said_of = {k: f"{estimated(values[k], errors[k])} {_when(one, np.arange(values.size) == k)}" for k in ends}
            of = f" of flight {one.flight + 1}" if len(damped) > 1 else ""
            said.append(
                f"The damping{of} changes, C_mq least {said_of[ends[0]]}, largest {said_of[ends[1]]}: a course of "
                "time, Mach number or alpha in model and processes; `compare` tests which mechanism it may be."
            )
    return " ".join(filter(None, said))


def _when(slope: Derivative, chosen: BoolArray) -> str:
    """Times and, where they are known, Mach numbers of the places chosen, neighbours as one interval."""
    places, said = np.flatnonzero(chosen), []
    for run in np.split(places, np.flatnonzero(np.diff(places) > 1) + 1):
        ends = list(dict.fromkeys((int(run[0]), int(run[-1]))))
        mach = " to ".join(f"{slope.mach[k]:.3g}" for k in ends)
        known = f" (Mach {mach})" if np.isfinite(slope.mach[run[0]]) else ""
        said.append(f"{'at' if len(ends) == 1 else 'from'} {times(*(slope.time_s[k] for k in ends))}{known}")
    return " and ".join(said)


# ---- The model's coefficients on the whole record, and how well they are known ----


def _record_terms(whole: Fit) -> tuple[TermEstimate, ...]:
    """What was taken out of the record, with the standard errors of a further change, moments and motion fitted too."""
    variances = np.diag(whole.covariance)[len(whole.model.columns) :]
    pairs = zip(whole.nuisances, np.sqrt(np.maximum(variances, 0.0)).tolist(), strict=True)
    of = {(item.name, item.component, item.flight): sigma * item.size for item, sigma in pairs}
    found = []
    for a in whole.model.applied:
        name, sigma = a.component + of_flight(whole.data.frame, a.flight), of[a.effect.name, a.component, a.flight]
        found.append(estimate(name, a.effect.name, a.value, sigma, a.units, channel="record"))
    return tuple(found)


def _definition(fit: Fit, whole: Fit, covariance: FloatArray, of_processes: FloatArray) -> SavedModel:
    """The model as its file has it; `covariance` (columns, columns) includes the part `of_processes`."""
    (columns, values, _), flights = whole.coefficients, fit.data.source.records
    # Small angles of attack, where its moment is nothing, it knows as well as those that it was found at.
    mach, alpha = (np.concatenate([getattr(m, name) for m in fit.data.frame.motions]) for name in ("mach", "alpha"))
    flown = {"alpha": (0.0, float(alpha.max()))}
    if np.all(np.isfinite(mach)):
        flown["mach"] = (float(mach.min()), float(mach.max()))
    saved = whole.model.but(columns=columns).saved().with_coefficients(values, covariance, of_processes)
    errors = [*whole.errors_of_times, *({} for _ in columns[len(whole.values) :])]
    pairs = zip(saved.columns, errors, strict=True)
    return saved.model_copy(
        update={
            "columns": tuple(column.model_copy(update={"time_errors": own}) for column, own in pairs),
            "error": model_error(fit.data, fit.left),
            "found_on": tuple(flight.path or flight.title for flight in flights),
            "times": tuple((float(flight.time[0]), float(flight.time[-1])) for flight in flights),
            "digests": tuple(map(digest, flights)),
            "errors": tuple(
                SavedRecordError(effect=e.name, component=e.component, value=e.whole(value), flight=e.flight or 0)
                for e, value in zip(whole.nuisances, whole.solution[1].tolist(), strict=True)
                if e.stated
            ),
            "flown": flown,
        }
    )


def model_error(data: Corrected, left: ResidualMoments) -> ModelError:
    """What the model leaves on blocks held out of the fit: by Mach number, each stretch with its neighbours, as one
    holds few cycles; nothing that noise may leave by chance.
    """
    parts = [held.rows[a:b] for held in (data.deciding, data.reported) for a, b in held.pieces]
    pieces = [rows for rows in parts if np.any(left.usable[rows])]
    mach = np.concatenate([each.mach[data.frame.samples(k)] for k, each in enumerate(data.frame.motions)])
    places, groups = np.array([float(np.mean(mach[rows])) for rows in pieces]), [np.concatenate(pieces)]
    if apart := bool(np.all(np.isfinite(places))) and np.unique(places).size == places.size:
        order = np.argsort(places)
        places, pieces = places[order], [pieces[k] for k in order]
        groups = [np.concatenate(pieces[max(k - 1, 0) : k + 2]) for k in range(len(pieces))]
    kept = [rows[left.usable[rows]] for rows in pieces]
    normal = [part(left.body[rows] / left.noise[rows]) for part in (np.real, np.imag) for rows in kept]
    share = effective_samples(normal) / sum(rows.size for rows in kept)
    freedom = share * np.array([np.sum(left.usable[rows]) for rows in groups])
    found, noise = np.array([(left.mean_square(rows), left.mean_square_of_noise(rows)) for rows in groups]).T
    # Of a mean square of noise alone with so many degrees of freedom, as the largest of all is beyond one's chance.
    most = noise * stats.chi2.isf(MODEL_ERROR_CHANCE / len(groups), freedom) / freedom
    beyond = np.sqrt(np.where(found > most, found - noise, 0.0))
    return ModelError(mach=tuple(places.tolist()) if apart else (), own=tuple(beyond.tolist()))
