"""Accuracy of the reconstruction on simulated flights: `python -m tests.motion.study [SEEDS]` prints the
table for perfect instruments, `python -m tests.motion.study SEEDS GRADE` that for erring ones.

Errors are rms over time and seeds: alpha in deg, phi_w in rad where alpha > 0.2 deg, moments in per cent of
their rms. `ratio` is rms error over rms stated standard deviation.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.model.reconstruction import reconstruct as reconstruct_record
from brv_hypo.motion import Reconstruction, ReconstructionConfig, reconstruct
from tests.motion.tolerances import erring
from tests.motion.truth import CAPSULE, CONE, SLENDER, Scenario, Truth, fly, observe

_MERIDIAN_FROM = np.radians(0.2)


@dataclass(frozen=True)
class Score:
    """Errors of a method on one scenario, over seeds; ratios to the stated standard deviations."""

    alpha_deg: float
    alpha_ratio: float
    phi_w_rad: float
    phi_w_ratio: float
    moment_percent: float
    moment_ratio: float
    seconds: float


def score(truth: Truth, seeds: Iterable[int], config: ReconstructionConfig | None = None, **changes: object) -> Score:
    """Reconstruct the scenario once for each seed."""
    squares, seconds = [], []
    for seed in seeds:
        flight = observe(truth, seed, **changes)
        started = time.process_time()
        result = reconstruct(flight, config)
        seconds.append(time.process_time() - started)
        squares.append(_squares(truth, result))
    alpha, alpha_s, phi, phi_s, moment, moment_s, size = np.sqrt(np.mean(squares, axis=0))
    return Score(
        np.degrees(alpha),
        alpha / alpha_s,
        phi,
        phi / phi_s,
        100 * moment / size,
        moment / moment_s,
        float(np.median(seconds)),
    )


def _squares(truth: Truth, result: Reconstruction) -> list[float]:
    known = truth.alpha > _MERIDIAN_FROM
    usable = result.moments.usable
    turn = np.angle(np.exp(1j * (result.motion.windward_meridian - truth.meridian)))[known]
    return [
        float(np.mean(np.abs(values) ** 2))
        for values in (
            result.motion.alpha - truth.alpha,
            result.alpha_sigma,
            turn,
            result.phi_w_sigma[known],
            (result.moments.body - truth.moment)[usable],
            np.sqrt(2.0) * result.moments.sigma[usable],
            truth.moment[usable],
        )
    ]


@dataclass(frozen=True)
class FlightScore:
    """One flight: rms error and rms stated standard deviation of alpha rad, meridian rad, moments (relative)."""

    error: tuple[float, float, float]
    stated: tuple[float, float, float]

    @property
    def honesty(self) -> tuple[float, ...]:
        """Stated over true error of each."""
        return tuple(stated / error for stated, error in zip(self.stated, self.error, strict=True))


def score_with_errors(scenario: Scenario, seed: int, grade: str, factor: float = 1.0) -> FlightScore:
    """One flight whose record errs as the grade allows, times `factor`, reconstructed with all tolerances."""
    truth, flight = erring(scenario, seed, grade, factor)
    alpha, alpha_s, phi, phi_s, moment, moment_s, size = np.sqrt(_squares(truth, reconstruct_record(flight)))
    return FlightScore((alpha, phi, moment / size), (alpha_s, phi_s, moment_s / size))


def print_with_errors(seeds: int, grade: str) -> None:
    """Print rms errors, rms stated sigmas, and the median and the tenth percentile of their ratio."""
    for scenario in (CONE, CAPSULE, SLENDER):
        found = [score_with_errors(scenario, seed, grade) for seed in range(seeds)]
        error, stated = (
            np.sqrt(np.mean(np.square([getattr(flight, name) for flight in found]), axis=0))
            for name in ("error", "stated")
        )
        honesty = np.array([flight.honesty for flight in found])
        for k, (name, unit) in enumerate((("alpha", 180.0 / np.pi), ("meridian", 1.0), ("moments", 100.0))):
            print(
                f"{scenario.name:10s} {name:10s} error {unit * error[k]:9.5f} stated {unit * stated[k]:9.5f} "
                f"ratio: rms {stated[k] / error[k]:5.2f} median {np.median(honesty[:, k]):5.2f} "
                f"one in ten below {np.quantile(honesty[:, k], 0.1):5.2f}",
                flush=True,
            )


def variations() -> Iterator[tuple[str, Scenario, dict[str, object]]]:
    """Name, scenario to fly, changes of its instruments."""
    for base in (CONE, CAPSULE, SLENDER):
        yield base.name, base, {}
    for roll in (0.2, 2.0, 20.0):
        yield f"cone, roll {roll} rad/s", replace(CONE, roll_rate=roll), {}
    yield "capsule, roll 0.2 rad/s", replace(CAPSULE, roll_rate=0.2), {}
    yield "slender, roll 20 rad/s", replace(SLENDER, roll_rate=20.0), {}
    yield "cone, 3 s", replace(CONE, duration=3.0), {}
    yield "slender, 3 s", replace(SLENDER, duration=3.0), {}
    yield "cone, 400 Hz", replace(CONE, sample_rate=400.0), {}
    yield "slender, 50 Hz", replace(SLENDER, sample_rate=50.0), {}
    yield (
        "capsule, 160 s, 8 Hz",
        replace(CAPSULE, duration=160.0, sample_rate=8.0, altitude=72000.0, flight_path=-0.03, roll_rate=0.3),
        {},
    )
    for base in (CONE, CAPSULE, SLENDER):
        for factor in (0.1, 5.0):
            noise = {"gyro_noise": factor * base.gyro_noise, "accel_noise": factor * base.accel_noise}
            yield f"{base.name}, noise x {factor}", base, noise
        biased = {"gyro_bias": (2e-4, -3e-4, 2e-4), "accel_bias": (0.05, 0.03, -0.04)}
        yield f"{base.name}, biased", base, biased
    yield "cone, trim", replace(CONE, trim=0.002 + 0.001j), {}


def main(seeds: int) -> None:
    """Print the table."""
    print(f"{'scenario':26s} {'alpha deg':>10s} ratio {'phi_w rad':>10s} ratio {'moment %':>9s} ratio {'s':>6s}")
    for name, scenario, changes in variations():
        _row(name, score(fly(scenario), range(seeds), **changes))
    print("other methods")
    for base in (CONE, CAPSULE, SLENDER):
        truth = fly(base)
        for method in ("velocity", "rates"):
            _row(f"{base.name}, {method}", score(truth, range(seeds), ReconstructionConfig(method=method)))


def _row(name: str, s: Score) -> None:
    print(
        f"{name:26s} {s.alpha_deg:10.5f} {s.alpha_ratio:5.2f} {s.phi_w_rad:10.5f} {s.phi_w_ratio:5.2f} "
        f"{s.moment_percent:9.3f} {s.moment_ratio:5.2f} {s.seconds:6.3f}",
        flush=True,
    )


if __name__ == "__main__":
    if len(sys.argv) > 2:
        print_with_errors(int(sys.argv[1]), sys.argv[2])
    else:
        main(int(sys.argv[1]) if len(sys.argv) > 1 else 10)
