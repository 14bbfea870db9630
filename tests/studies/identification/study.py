"""Study of the estimates on simulated flights: `python -m tests.studies.identification.study --help`.

For each mechanism: how often the 95 % intervals contain the truth, scatter of the estimates over their standard
errors, error of maximum likelihood over that of the regression, and seconds of a fit. Options draw the errors of
record, vehicle and air within the tolerances of the record, plant one, or colour the noise.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.flight.record import Flight
from brv_hypo.identification.identify import Estimate, Identification, identify
from brv_hypo.linearisation.channels import Noise, Whitening, difference, fit_noise, whole
from brv_hypo.linearisation.frame import RateFrame, build_frame
from brv_hypo.linearisation.linear import solve_scaled
from brv_hypo.mechanisms import find, record_effects
from brv_hypo.mechanisms.registry import nuisance_mechanisms
from brv_hypo.model.baseline import PitchDamping, StaticMoment
from brv_hypo.model.reconstruction import reconstruct
from brv_hypo.model.term import Regressor, TimeBasis, delays_among
from brv_hypo.simulation import SimulatedFlight, SimulationConfig, load_config, simulate
from brv_hypo.simulation.config import PlantedConfig
from tests.varied import varied

CASES = ("none", "inplane", "bodyfixed", "damping", "lag", "sticking")
NORMAL_95 = 1.96


@dataclass(frozen=True)
class Trial:
    """One flight's model: frame, columns with delays and knots, regression values, and the truth by estimate
    name.
    """

    frame: RateFrame
    columns: tuple[Regressor, ...]
    values: FloatArray
    truth: dict[str, float]
    coefficients: FloatArray


def flights(
    case: str,
    count: int,
    seed: int = 0,
    *,
    colour: float = 0.0,
    instruments: Mapping[str, float] | None = None,
    delay: float | None = None,
    tolerances: float = 0.0,
) -> Iterator[tuple[SimulatedFlight, Flight]]:
    """Flights of the research cone with one mechanism, of random start and knots; `colour` is the noise's
    AR(1) coefficient.

    `instruments` are dotted paths below `instruments` of the simulation's configuration; `delay` s that of
    the mechanism; `tolerances` how many times its tolerance is 1 sigma of each error that is drawn.
    """
    draws = np.random.default_rng(seed)
    plant = () if case == "none" else (case,)
    variations: dict[str, FloatArray] = {
        "start.alpha": draws.uniform(0.03, 0.055, count),
        "start.windward_meridian": draws.uniform(-np.pi, np.pi, count),
        "start.roll_rate": draws.uniform(5.0, 10.0, count),
        "start.coning_rate": draws.uniform(3.5, 6.0, count),
    }
    if plant:
        shift = draws.uniform(-0.2, 0.2, count)
        variations |= {"mechanisms.0.start": 2.0 + shift, "mechanisms.0.stop": _stop(case) + shift}
    if delay is not None:
        variations["mechanisms.0.theta.delay"] = np.full(count, delay)
    variations |= {f"instruments.{path}": np.full(count, value) for path, value in (instruments or {}).items()}
    seeds = [seed + 1 + i for i in range(count)]
    config = load_config("research_cone", plant=plant)
    if tolerances > 0.0:
        config, moments = with_tolerated_moments(config, draws, count, tolerances)
        variations |= moments
    for i, own in enumerate(seeds):
        changes = {path: float(values[i]) for path, values in variations.items()}
        simulated = simulate(varied(config, changes), seed=own)
        flight = simulated.flight if colour == 0.0 else coloured(simulated, colour)
        yield simulated, with_record_errors(flight, np.random.default_rng(simulated.seed), tolerances)


def with_tolerated_moments(
    config: SimulationConfig, draws: np.random.Generator, count: int, tolerances: float
) -> tuple[SimulationConfig, dict[str, FloatArray]]:
    """The configuration with every moment that has a tolerance, and coefficients (count,) of each by path."""
    nominal = simulate(config, seed=0)
    motion = reconstruct(nominal.flight).motion
    planted, coefficients = list(config.mechanisms), {}
    for mechanism in nuisance_mechanisms(nominal.flight):
        sizes = mechanism.tolerance(nominal.flight)
        assert sizes is not None
        names = [term.name for term in mechanism.terms(motion, {})]
        for name, size in zip(names, sizes, strict=True):
            path = f"mechanisms.{len(planted)}.terms.{name}"
            coefficients[path] = tolerances * size * draws.standard_normal(count)
        terms = dict.fromkeys(names, 0.0)
        planted.append(PlantedConfig(mechanism=mechanism.name, terms=terms, kind="constant"))
    return config.model_copy(update={"mechanisms": tuple(planted)}), coefficients


def with_record_errors(flight: Flight, draws: np.random.Generator, tolerances: float) -> Flight:
    """The flight with every nuisance effect of the record drawn at so many times its tolerance."""
    if tolerances == 0.0:
        return flight
    for effect in record_effects():
        if effect.carried:
            for component in effect.components(flight):
                value = tolerances * component.size * float(draws.standard_normal())
                flight = effect.perturb(flight, component.name, value)
    return flight


def _stop(case: str) -> float:
    return 3.2 if case == "lag" else 4.0


def coloured(simulated: SimulatedFlight, coefficient: float) -> Flight:
    """The flight with first-order Markov noise of the same size instead of white noise on gyros and
    accelerometers.
    """
    quiet = simulated.config.instruments
    gyro, accel = quiet.gyro.noise, quiet.accelerometer.noise
    silent = quiet.model_copy(
        update={
            "gyro": quiet.gyro.model_copy(update={"noise": 0.0}),
            "accelerometer": quiet.accelerometer.model_copy(update={"noise": 0.0}),
        }
    )
    clean = simulate(simulated.config.model_copy(update={"instruments": silent}), seed=simulated.seed)
    draws = np.random.default_rng(simulated.seed)
    flight = clean.flight

    def noisy(channel: FloatArray, sigma: float) -> FloatArray:
        white = draws.standard_normal(channel.size)
        white[1:] *= np.sqrt(1.0 - coefficient**2)
        return np.asarray(channel + sigma * lfilter([1.0], [1.0, -coefficient], white))

    sigmas = dict.fromkeys(("p", "q", "r"), gyro) | dict.fromkeys(("ax", "ay", "az"), accel)
    channels: dict[str, Any] = {name: noisy(getattr(flight, name), sigma) for name, sigma in sigmas.items()}
    return replace(flight, **channels)


def trial(simulated: SimulatedFlight, flight: Flight, delay_error: float = 0.0) -> Trial:
    """The true model's columns, regressed; delays start `delay_error` s off."""
    config = simulated.config
    reconstruction = reconstruct(flight)
    static = StaticMoment(start=float(flight.time[0]), stop=float(flight.time[-1]), offset_degree=0, slope_degree=1)
    tolerated = {mechanism.name for mechanism in nuisance_mechanisms(flight)}
    planted = [item for item in config.mechanisms if item.mechanism not in tolerated]
    mechanisms = {item.mechanism: find(item.mechanism, item.options) for item in planted}
    frame = build_frame([reconstruction], [static, PitchDamping(), *mechanisms.values()])
    always = TimeBasis("constant")
    aerodynamics = config.aerodynamics
    columns = [Regressor(static.name, term.name, (), always, term.units) for term in static.terms(frame.motions[0], {})]
    columns.append(Regressor(PitchDamping.name, "C_mq", (), always, "1/rad"))
    coefficients = [aerodynamics.C_m0, aerodynamics.C_malpha, 0.0, aerodynamics.C_mq]
    moved: dict[str, float] = {}
    for item in planted:
        assert item.start is not None
        assert item.stop is not None
        theta = tuple((name, value + delay_error) for name, value in item.theta.items())
        time_basis = TimeBasis(item.kind, item.start, item.stop)
        late_by = delays_among(mechanisms[item.mechanism].parameters())
        columns += [
            Regressor(item.mechanism, name, theta, time_basis, "1", len(item.terms) > 1, late_by) for name in item.terms
        ]
        coefficients += list(item.terms.values())
        moved |= {"start": item.start, "stop": item.stop, **item.theta}
    values = regress(frame, columns)
    if mechanisms:
        frame = frame.with_in_plane_moment(columns, values)
        values = regress(frame, columns)
    moved["C_Nalpha_force"] = aerodynamics.C_Nalpha_force
    return Trial(frame, tuple(columns), values, moved, np.array(coefficients))


def regress(frame: RateFrame, columns: Sequence[Regressor], passes: int = 4) -> FloatArray:
    """Generalised least squares in the rate frame, its noise model fitted to the residuals; coefficients
    (columns,).
    """
    rates: ComplexArray = frame.columns(columns)
    part, noise = whole(frame, np.ones(frame.observed.size, dtype=bool)), difference()
    unknown = np.column_stack([rates, part.constants()])
    values = np.zeros(len(columns))
    for _ in range(passes):
        white = Whitening(part, Noise(noise, noise)).rates
        found = solve_scaled(white(unknown), white(frame.observed[:, np.newaxis])[:, 0])
        values, residual = found[: len(columns)], frame.observed - rates @ found[: len(columns)]
        noise = fit_noise([residual[a:b] - residual[a:b].mean() for a, b in frame.pieces])
    return np.asarray(values)


def errors(work: Trial, found: Identification) -> dict[str, tuple[float, Estimate]]:
    """Estimate less truth, by a name that is the same in every flight."""
    out = {
        f"{column.mechanism} {column.term}": (estimate.value - true, estimate)
        for column, estimate, true in zip(found.columns, found.terms, work.coefficients, strict=True)
    }
    for estimate in (*found.nonlinear, *found.forces):
        key = next((key for key in work.truth if key in estimate.name), None)
        true = 0.0 if "drift" in estimate.name else work.truth.get(key or "")
        if true is not None:
            name = estimate.name if key is None or key.startswith("C_") else key
            out[name] = (estimate.value - true, estimate)
    return out


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study and print its table."""
    parser = argparse.ArgumentParser(prog="python -m tests.studies.identification.study", description=__doc__)
    parser.add_argument("--flights", type=int, default=40)
    parser.add_argument("--case", choices=CASES, action="append", help="mechanism; all by default")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--colour", type=float, default=0.0, help="AR(1) coefficient of the instruments' noise")
    parser.add_argument("--delay-error", type=float, default=0.0, help="how far off delays start, s")
    parser.add_argument("--delay", type=float, default=None, help="planted delay, s; the mechanism's own by default")
    parser.add_argument(
        "--tolerances", type=float, default=0.0, help="how many times its tolerance each error of the record is drawn"
    )
    parser.add_argument(
        "--plant",
        action="append",
        default=[],
        metavar="PATH=VALUE",
        help="an instrument error, such as gyro.bias.1=0.001",
    )
    chosen = parser.parse_args(arguments)
    planted = {path: float(value) for path, value in (item.split("=") for item in chosen.plant)}
    pooled: list[float] = []
    for case in chosen.case or CASES:
        planned = flights(
            case,
            chosen.flights,
            chosen.seed,
            colour=chosen.colour,
            instruments=planted,
            delay=chosen.delay,
            tolerances=chosen.tolerances,
        )
        pooled += _report(case, planned, chosen.delay_error)
    print(f"pooled over parameters: {_coverage(pooled):.1f} % of {len(pooled)} within 1.96 sigma")


def _report(case: str, planned: Iterator[tuple[SimulatedFlight, Flight]], delay_error: float) -> list[float]:
    """Print one case's table; errors over standard errors of every parameter of every flight."""
    scaled: dict[str, list[float]] = {}
    plain: dict[str, list[float]] = {}
    regression: dict[str, list[float]] = {}
    seconds: list[float] = []
    converged = 0
    for simulated, flight in planned:
        work = trial(simulated, flight, delay_error)
        found = identify(work.frame, work.columns, work.values)
        seconds.append(found.seconds)
        if found.status != "converged":
            print(f"{case} seed {simulated.seed}: {found.status}: {found.message}")
            continue
        converged += 1
        for name, (error, estimate) in errors(work, found).items():
            if not np.isfinite(estimate.std_error):  # a knot that was fixed: no interval is reported
                continue
            scaled.setdefault(name, []).append(error / estimate.std_error)
            plain.setdefault(name, []).append(error)
        for column, value, true in zip(work.columns, work.values, work.coefficients, strict=True):
            regression.setdefault(f"{column.mechanism} {column.term}", []).append(float(value - true))
    print(f"{case}: {converged} of {len(seconds)} converged, median {np.median(seconds):.2f} s a fit")
    print(
        f"  {'parameter':32}{'flights':>9}{'coverage %':>11}{'scatter':>9}{'mean z':>8}"
        f"{'rms error':>12}{'regression':>12}"
    )
    for name, values in scaled.items():
        z = np.array(values)
        other = f"{_rms(regression[name]):12.3g}" if name in regression else ""
        print(
            f"  {name:32}{z.size:9d}{_coverage(values):11.1f}{np.std(z):9.2f}{np.mean(z):8.2f}"
            f"{_rms(plain[name]):12.3g}{other}"
        )
    return [one for values in scaled.values() for one in values]


def _coverage(values: Sequence[float]) -> float:
    """Share within the 95 % interval, %."""
    return 100.0 * float(np.mean(np.abs(values) < NORMAL_95))


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


if __name__ == "__main__":
    main()
