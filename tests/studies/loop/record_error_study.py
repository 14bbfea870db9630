"""Errors of the record that change along it, planted into a measured record: which family of processes explains them?

By hand: python -m tests.studies.loop.record_error_study FLIGHT.h5 --instruments FILE --times 1,10 --seeds 3

Air whose density is off by a layer or a smooth profile in altitude, and gyros that drift steadily or as a random walk,
at so many times what is ordinary: 2 % of density, 0.05 deg/s. Each line has the family that is first, those that make
90 % of what is explained, and of the family that was planted the share and the log evidence that it gains beside those
before it, and the same of the record as it is. `next` is the family that is first once the first one is explained.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.flight.format import load_flight
from brv_hypo.flight.record import Flight
from brv_hypo.tracing import Trace, TraceConfig, trace
from brv_hypo.tracing.result import Family
from tests.studies.independent.imperfections import SCALE_HEIGHT, lines

MOST = 0.9  # of what is explained, that a set of families explains
NONE = Family(family="", share=0.0, interval_95=(0.0, 0.0))
# Longest and shortest wave of a profile of density, m, as `imperfections` has them, and the layer's half thickness.
_WAVES = (4.0 * SCALE_HEIGHT, 2000.0)
_LAYER = 0.5 * SCALE_HEIGHT


def _layer(flight: Flight, size: float, draw: np.random.Generator) -> Flight:
    """Denser or thinner air about one altitude, by `size` at most."""
    height = _altitude(flight)
    middle = draw.uniform(*np.percentile(height, [25.0, 75.0]))
    return _denser(flight, size * draw.choice([-1.0, 1.0]) * np.exp(-(((height - middle) / _LAYER) ** 2)))


def _profile(flight: Flight, size: float, draw: np.random.Generator) -> Flight:
    """Air with a density that is off by a random profile in altitude of rms `size`."""
    profile = lines(draw, size, *(2.0 * np.pi / wave for wave in _WAVES))
    return _denser(flight, np.array([float(profile.at(height)[0]) for height in _altitude(flight)]))


def _altitude(flight: Flight) -> FloatArray:
    assert flight.altitude is not None
    return flight.altitude


def _denser(flight: Flight, share: FloatArray) -> Flight:
    """The record with so much (n,) more in all that is derived from its density."""
    read = {name: getattr(flight, name) for name in ("dynamic_pressure", "density", "reynolds")}
    return replace(flight, **{name: values * (1.0 + share) for name, values in read.items() if values is not None})


def _ramp(flight: Flight, size: float, draw: np.random.Generator) -> Flight:
    """A bias in a random direction across the spin axis that grows steadily to `size`, rad/s."""
    place = (flight.time - flight.time[0]) / (flight.time[-1] - flight.time[0])
    drift = size * np.exp(1j * draw.uniform(0.0, 2.0 * np.pi)) * place
    return replace(flight, q=flight.q + drift.real, r=flight.r + drift.imag)


def _walk(flight: Flight, size: float, draw: np.random.Generator) -> Flight:
    """Gyros whose biases walk, to an rms of `size` rad/s at the end, from none at the start."""
    steps = draw.standard_normal((3, flight.samples)) * size / np.sqrt(flight.samples)
    walks = zip("pqr", np.cumsum(steps, axis=1), strict=True)
    return replace(flight, **{name: getattr(flight, name) + walk for name, walk in walks})


@dataclass(frozen=True)
class Kind:
    """A kind of error: its family, what is ordinary in SI units, how it is planted."""

    family: str
    ordinary: float
    units: str
    plant: Callable[[Flight, float, np.random.Generator], Flight]


KINDS = {
    "layer": Kind("air", 0.02, "of density", _layer),
    "course": Kind("air", 0.02, "of density", _profile),
    "ramp": Kind("gyros", float(np.radians(0.05)), "rad/s", _ramp),
    "walk": Kind("gyros", float(np.radians(0.05)), "rad/s", _walk),
}


def planted(flight: Flight, kind: str, times: float, seed: int) -> Flight:
    """The record with an error of that kind at so many times its ordinary size."""
    draw = np.random.default_rng([seed, *(ord(letter) for letter in kind)])
    return KINDS[kind].plant(flight, times * KINDS[kind].ordinary, draw)


def most(result: Trace) -> list[str]:
    """The families that make most of what is explained of the first residual, the largest first."""
    found = result.steps[0].decomposition
    shares = np.cumsum([each.share for each in found])
    return [each.family for each in found[: int(np.searchsorted(shares, MOST * shares[-1])) + 1]]


def of_family(result: Trace, family: str) -> Family:
    """What a family explains of the first residual."""
    return next((each for each in result.steps[0].decomposition if each.family == family), NONE)


def line(what: str, family: str, result: Trace, record: Trace) -> str:
    """A planted record in words, beside the record as it is."""
    step, own, before = result.steps[0], of_family(result, family), of_family(record, family)
    first, *others = sorted(step.decomposition, key=lambda each: -each.share)
    rises = own.interval_95[0] > before.interval_95[1]
    warned = ", warned of by axial force" if any("(family air)" in each for each in result.caveats) else ""
    found = ", ".join([*result.findings, *(f"{name} (hint)" for name in result.hints)]) or "nothing"
    return (
        f"{what}: residual {step.residual.noise_ratio:.0f} times the noise, first {first.family} {first.share:.0%}, "
        f"next {others[0].family if others else 'none'}, 90 % {', '.join(most(result))}; {family} {_in_words(own)}, "
        f"without it {_in_words(before)}{', rises' if rises else ''}{warned}; found {found}"
    )


def _in_words(family: Family) -> str:
    low, high = family.interval_95
    return f"{family.share:.1%} ({low:.1%} to {high:.1%}), {family.evidence:.0f} nats"


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("flight", type=Path)
    parser.add_argument("--instruments", default=None)
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--times", default="1,10", help="of what is ordinary")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--effects", action="store_true", help="try all effects too, not the decomposition alone")
    given = parser.parse_args(arguments)
    flight = load_flight(given.flight, instruments=given.instruments)
    settings = TraceConfig() if given.effects else TraceConfig(effects=(), discover=False)
    record = trace(flight, settings)
    shares = (f"{each.family} {_in_words(each)}" for each in record.steps[0].decomposition)
    print(f"the record itself: {'; '.join(shares)}", flush=True)
    for kind in given.kinds.split(","):
        for times in map(float, given.times.split(",")):
            for seed in range(1, given.seeds + 1):
                own = KINDS[kind]
                what = f"{kind} {times * own.ordinary:.2g} {own.units} ({times:g} times), seed {seed}"
                print(line(what, own.family, trace(planted(flight, kind, times, seed), settings), record), flush=True)


if __name__ == "__main__":
    main()
