"""Whether what a trace finds persists when the record is cut, blocked or scaled otherwise.

By hand: python -m tests.studies.loop.variants FLIGHT.h5 [--baseline constant] [--instruments FILE]

A finding persists in a variant that finds the same effect; where it has a time, within a sixteenth of the record of it.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from brv_hypo.flight.format import load_flight
from brv_hypo.flight.record import Flight
from brv_hypo.tracing import Trace, TraceConfig, trace
from brv_hypo.tracing.result import Step

# Share of the record that a later start and an earlier stop leave out, and by which a finding's time may move.
_PART = 1.0 / 16.0
# By how much mass properties and dynamic pressure are changed, and how many blocks are tried.
_SCALE = 1.1
_BLOCKS = (24, 40)  # a quarter fewer and more than the usual 32
# What else a changed Ix may be called: it is that error.
_OF_IX = "inertia_ratio"


@dataclass(frozen=True)
class Variant:
    """A changed record and configuration; `also` is what a finding may be called there instead."""

    name: str
    change: Callable[[Flight], Flight] = lambda flight: flight
    blocks: int | None = None
    also: str | None = None


def variants() -> tuple[Variant, ...]:
    """Other blocks, a later start, an earlier stop, Ix, all inertia, and dynamic pressure changed by a tenth."""
    return (
        *(Variant(f"{blocks} blocks", blocks=blocks) for blocks in _BLOCKS),
        Variant("later start", lambda flight: flight.window(_within(flight, _PART), None)),
        Variant("earlier stop", lambda flight: flight.window(None, _within(flight, 1.0 - _PART))),
        Variant(f"Ix x {_SCALE}", lambda flight: _heavier(flight, _SCALE, 1.0), also=_OF_IX),
        Variant(f"inertia x {_SCALE}", lambda flight: _heavier(flight, _SCALE, _SCALE)),
        Variant(
            f"dynamic pressure x {_SCALE}",
            lambda flight: replace(flight, dynamic_pressure=_SCALE * flight.dynamic_pressure),
        ),
    )


def _within(flight: Flight, share: float) -> float:
    return float(flight.time[0] + share * (flight.time[-1] - flight.time[0]))


def _heavier(flight: Flight, axial: float, transverse: float) -> Flight:
    vehicle = flight.vehicle
    return replace(flight, vehicle=replace(vehicle, ixx=axial * vehicle.ixx, iyy=transverse * vehicle.iyy))


def run(flight: Flight, variant: Variant, config: TraceConfig) -> Trace:
    """The changed record, traced."""
    settings = config if variant.blocks is None else config.model_copy(update={"blocks": variant.blocks})
    return trace(variant.change(flight), settings)


def times_of(result: Trace, name: str) -> tuple[float, ...]:
    """The times (s) at which an effect of the model begins; none where it acts throughout."""
    definition = result.model.definition
    own = [column.start for column in definition.columns if column.mechanism == name and column.kind != "constant"]
    own += [error.options.get("time") for error in definition.record if error.effect == name]
    return tuple(sorted({float(time) for time in own if time is not None}))


def persists(name: str, base: Trace, other: Trace, also: str | None = None) -> bool | None:
    """Whether a finding of `base` is one of `other`; None where that has not its region."""
    times, span = times_of(base, name), base.flight.stop_s - base.flight.start_s
    inside = [time for time in times if other.flight.start_s < time < other.flight.stop_s]
    if times and not inside:
        return None
    if also is not None and also in other.added:
        return True
    if name not in other.findings:
        return False
    there = times_of(other, name)
    return not inside or any(abs(one - time) < _PART * span for one in there for time in inside)


def line(label: str, result: Trace) -> str:
    """A trace in words: what each step adds, with the held-out error before and after."""
    steps = "; ".join(_in_words(step) for step in result.steps if step.added is not None)
    return f"{label}: {steps or 'nothing is added'}"


def _in_words(step: Step) -> str:
    after = step.error_after.held_out if step.error_after is not None else float("nan")
    return (
        f"{step.status} {step.added} ({step.description}) {step.error_before.held_out:.3g} to {after:.3g}, ratio "
        f"{step.error_ratio_held_out:.3g} ± {step.error_ratio_std_error:.2g}, named in {step.named_in:.0%}"
    )


def report(base: Trace, others: Sequence[tuple[Variant, Trace]]) -> Iterable[str]:
    """In how many variants with its region each finding persists."""
    for name in base.findings:
        persistent = {variant.name: persists(name, base, other, variant.also) for variant, other in others}
        applicable = {variant: found for variant, found in persistent.items() if found is not None}
        lost = [variant for variant, found in applicable.items() if not found]
        yield f"{name} persists in {sum(applicable.values())} of {len(applicable)}" + (
            f", not in {', '.join(lost)}" * bool(lost)
        )
    for variant, other in others:
        more = [name for name in other.findings if name not in base.findings]
        if more:
            yield f"{variant.name}: found there alone: {', '.join(more)}"


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("flight", type=Path)
    parser.add_argument("--baseline", choices=("scheduled", "constant"), default="scheduled")
    parser.add_argument("--instruments", default=None)
    parser.add_argument("--steps", type=int, default=8, help="that a trace may take")
    parser.add_argument("--start", type=float, default=None)
    parser.add_argument("--stop", type=float, default=None)
    given = parser.parse_args(arguments)
    flight = load_flight(given.flight, instruments=given.instruments).window(given.start, given.stop)
    config = TraceConfig(baseline=given.baseline, max_steps=given.steps)
    base = trace(flight, config)
    print(line("the record as it is", base), flush=True)
    others = []
    for variant in variants():
        others.append((variant, run(flight, variant, config)))
        print(line(variant.name, others[-1][1]), flush=True)
    print("\n".join(report(base, others)))


if __name__ == "__main__":
    main()
