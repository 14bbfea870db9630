"""What the likelihood of a comparison says of a record's errors, against those that were drawn.

    python -m tests.studies.independent.instrument_errors --seed 400000 --flights 24 [--grade tactical]

Flights as in `study`, compared with the likelihood; an error counts where its standard error is below `ESTIMATED` of
its tolerance: elsewhere its prior is all that there is to say. Gyros that are late are accelerometers that are early,
and the place of accelerometers is that about the true c.g.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from brv_hypo import compare
from brv_hypo.comparison import CompareConfig
from tests.studies.identification.study import NORMAL_95
from tests.studies.independent.flights import Made
from tests.studies.independent.instruments import Errors
from tests.studies.independent.study import NAMES, drawn_flight

ESTIMATED = 0.7
_AXES = {"gyro_bias": "pqr", "gyro_scale": "pqr", "accel_bias": "xyz", "accel_scale": "xyz", "accel_position": "xyz"}


@dataclass(frozen=True)
class EstimatedError:
    """One error of one flight: estimate less truth, over its standard error."""

    name: str
    scaled: float


def true_errors(errors: Errors) -> Mapping[str, float]:
    """By the names that the program has for them."""
    found = {"time_skew accelerometers": -errors.time_skew}
    for name, axes in _AXES.items():
        values = getattr(errors, name).tolist()
        found |= {f"{name} {axis}": value for axis, value in zip(axes, values, strict=True)}
    for axis, offset in zip("yz", errors.cg_offset.tolist(), strict=True):
        found[f"accel_position {axis}"] -= offset
    return found


def estimated_errors(made: Made) -> Iterator[EstimatedError]:
    """Every error that the leader's likelihood estimates; none where it has not converged."""
    found = compare([made.flight], CompareConfig(mechanisms=NAMES, maximum_likelihood="quick")).ranking[0].ml
    if found is None or found.status != "converged":
        return
    known = true_errors(made.true.errors)
    sizes = {key.split()[0]: getattr(made.flight.instruments, key.split()[0])[0] for key in known}
    for estimate in found.instrument:
        size = sizes.get(estimate.name.split()[0], 0.0)
        if estimate.name in known and estimate.std_error < ESTIMATED * size:
            yield EstimatedError(estimate.name, (estimate.value - known[estimate.name]) / estimate.std_error)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.studies.independent.instrument_errors", description=__doc__)
    parser.add_argument("--seed", type=int, default=400000)
    parser.add_argument("--flights", type=int, default=24)
    parser.add_argument("--grade", default="tactical")
    given = parser.parse_args()
    every: list[EstimatedError] = []
    for number in range(given.flights):
        found = list(estimated_errors(drawn_flight(given.seed + number, number, given.grade, 1.0, 0)))
        every += found
        beyond = sum(abs(each.scaled) > NORMAL_95 for each in found)
        print(f"{given.seed + number}: {len(found)} estimated, {beyond} beyond", flush=True)
    print(f"{'error':28}{'count':>6}{'within 1.96 sigma, %':>22}{'scatter':>9}{'mean':>7}")
    for name in (*sorted({each.name for each in every}), "all"):
        scaled = np.array([each.scaled for each in every if name in (each.name, "all")])
        share = 100.0 * np.mean(np.abs(scaled) < NORMAL_95)
        print(f"{name:28}{scaled.size:6}{share:22.1f}{np.std(scaled):9.2f}{np.mean(scaled):7.2f}")


if __name__ == "__main__":
    main()
