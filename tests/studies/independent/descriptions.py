"""Effects that no plugin has: are they described, and does their file lower a sister flight's error?

By hand: python -m tests.studies.independent.descriptions --seed 1000 --flights 30 [--truths rotating,...]

Flight k has seed SEED + k, and the effects take turns: a moment that turns in the body, a third harmonic of the
windward meridian, a step of the stiffness at a Mach number, each at 3 to 10 times its limit in the record. What step 1
finds is tested on a sister with the same effect (`sisters`), as the one effect that is tried there. At its speed
the sister may show less of it, or never pass that Mach number: those with 3 limits or more are counted by themselves.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from joblib import delayed

from brv_hypo.mechanisms.yaml_mechanism import MechanismFile, YamlTerm, mechanism_text
from brv_hypo.tracing import Trace, TraceConfig, trace
from tests.studies.independent.dynamics import PAD
from tests.studies.independent.effects import TIMES, sized
from tests.studies.independent.flights import Made, make_flight
from tests.studies.independent.loop_study import added_by
from tests.studies.independent.mechanisms import ROTATION, Planted
from tests.studies.independent.oracle import DETECTED
from tests.studies.independent.record_oracle import f_ratios_in_record
from tests.studies.independent.reporting import fly_and_report
from tests.studies.independent.sisters import SECOND, sister

SETTINGS = TraceConfig(max_steps=1)
HARMONIC = 3.0


@dataclass(frozen=True)
class Outcome:
    """One flight: what was planted, at how many limits in the record, and what step 1 said.

    `described`: it is what was planted; `near`: what the step cannot distinguish from it. `ratio` is that of the
    sister's held-out errors with it and without, `score` the fall there in standard errors; None where it says nothing.
    `there` is at how many limits the sister has it.
    """

    seed: int
    vehicle: str
    truth: str
    times: float
    said: str
    described: bool
    near: tuple[str, ...]
    ratio: float | None
    score: float | None
    there: float

    @property
    def lowers(self) -> bool:
        """Whether the sister's error fell with it."""
        return self.ratio is not None and self.ratio < 1.0


def fly(seed: int, truth: str) -> Outcome | str:
    """Fly, trace and test on a sister; the reason in words where none can be flown."""
    try:
        own = sized(seed, truth)
        other = _sister_with(own.made)
    except (RuntimeError, ValueError) as error:
        return f"seed {seed}: {truth} not flown ({error})"
    found, there = trace(own.made.flight, SETTINGS), float(np.sqrt(f_ratios_in_record(other)[0] / DETECTED))
    added = added_by(found)
    if not added:
        return Outcome(seed, own.made.vehicle, truth, own.times, "nothing", False, (), None, None, there)
    first, planted = added[0], own.made.true.planted
    ratio, score = _on_the_sister(other, found, first.name)
    said, right = f"{first.status} {first.name}: {first.description}", _is_described(found, first.name, planted)
    return Outcome(seed, own.made.vehicle, truth, own.times, said, right, first.near, ratio, score, there)


def _sister_with(made: Made) -> Made:
    """A sister of a flight's vehicle with what was planted there; what goes with Mach number does so at any time."""
    true, planted = made.true, made.true.planted
    if planted.name == "mach_step":
        planted = replace(planted, start=-2.0 * PAD, stop=true.craft.duration + 2.0 * PAD)
    return make_flight(sister(true.craft, made.seed), seed=made.seed + SECOND, planted=planted)


def _is_described(found: Trace, name: str, planted: Planted) -> bool:
    file = found.discovered
    if file is None or file.name != name:
        return name == "mach_stiffness" and planted.name == "mach_step"
    return any(_RIGHT[planted.name](term, planted) for term in file.terms)


def _turns(term: YamlTerm, planted: Planted) -> bool:
    """Within the resolution of a rate over the times for which it acts."""
    turn = term.turn
    if turn is None or turn.of != "time":
        return False
    return abs(abs(turn.rate) - ROTATION) < np.pi / (planted.stop - planted.start)


def _has_harmonic(term: YamlTerm, planted: Planted) -> bool:
    rates = [factor.rate for factor in term.factors if factor.of == "windward_meridian"]
    rates += [term.turn.rate] if term.turn is not None and term.turn.of == "windward_meridian" else []
    return any(abs(rate) == HARMONIC for rate in rates)


def _goes_with_mach(term: YamlTerm, planted: Planted) -> bool:
    return any(factor.of == "mach" for factor in term.factors)


_RIGHT: Mapping[str, Callable[[YamlTerm, Planted], bool]] = {
    "rotating": _turns,
    "third_harmonic": _has_harmonic,
    "mach_step": _goes_with_mach,
}


def _on_the_sister(other: Made, found: Trace, name: str) -> tuple[float | None, float | None]:
    """Ratio of held-out errors, and their fall in standard errors, with the effect as the only one that is tried."""
    file = found.discovered
    with tempfile.TemporaryDirectory() as folder:
        effect = _written(Path(folder), file) if file is not None and file.name == name else name
        settings = SETTINGS.model_copy(update={"effects": (effect,), "discover": False})
        step = trace(other.flight, settings).steps[0]
    return step.error_ratio_held_out, step.held_out_score


def _written(folder: Path, file: MechanismFile) -> str:
    path = folder / f"{file.name}.yaml"
    path.write_text(mechanism_text(file), encoding="utf-8")
    return str(path)


def report(outcomes: Sequence[Outcome]) -> Iterable[str]:
    """Lines of counts with their denominators."""
    for truth in (*_RIGHT, "all"):
        own = [o for o in outcomes if truth in (o.truth, "all")]
        described, lowers = _count([o.described for o in own]), _count([o.lowers for o in own])
        visible = _count([o.lowers for o in own if o.there >= TIMES[0]])
        yield f"{truth}: described {described}; the sister's error falls {lowers}, at 3 limits or more there {visible}"


def _count(hits: Sequence[bool]) -> str:
    share = f" ({np.mean(hits):.0%})" if hits else ""
    return f"{sum(hits)} of {len(hits)}{share}"


def line(outcome: Outcome) -> str:
    """One flight in words."""
    near = f", near {', '.join(outcome.near)}" if outcome.near else ""
    there = f"; sister at {outcome.there:.1f} limits"
    there += "" if outcome.ratio is None else f", {outcome.ratio:.3f}, falls by {outcome.score or 0.0:.1f}"
    right = "described" if outcome.described else "NOT DESCRIBED"
    what = f"{outcome.seed} {outcome.vehicle} {outcome.truth} at {outcome.times:.1f} limits"
    return f"{what}, {right}: {outcome.said}{near}{there}"


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--flights", type=int, default=30)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--truths", default=",".join(_RIGHT), metavar="NAME,...", help="what to plant in turn")
    given = parser.parse_args(arguments)
    truths = given.truths.split(",")
    runs = (delayed(fly)(given.seed + k, truths[k % len(truths)]) for k in range(given.flights))
    fly_and_report(runs, given.jobs, line, report)


if __name__ == "__main__":
    main()
