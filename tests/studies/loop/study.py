"""How often the loop names what was planted: `python -m tests.studies.loop.study --help`.

Flights of several vehicles, each with one undeclared effect at 3 to 10 times its detection limit, two at
once, none, or one that no plugin describes. What is discovered is tried on another flight of the same vehicle.
The truth is used to count only, never by the loop.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from pydantic import TypeAdapter

from brv_hypo.errors import BrvHypoError
from brv_hypo.mechanisms.yaml_mechanism import MechanismFile, mechanism_text
from brv_hypo.residuals.config import TraceConfig
from brv_hypo.residuals.result import Step
from brv_hypo.residuals.trace_loop import trace
from brv_hypo.simulation import simulate
from brv_hypo.simulation.config import SimulationConfig
from tests.studies.loop.planting import EFFECTS, UNNAMED, Case, another_flight, planted

VEHICLES = ("research_cone", "blunt_capsule", "sounding_rocket")
# Added to a flight's seed for another flight of its vehicle.
_ANOTHER = 50_000
_SIGNIFICANT = TraceConfig().significance


@dataclass(frozen=True)
class Outcome:
    """What the loop said of a case.

    `times`: how many detection limits each effect is large. `first`: what step 1 added or, where it added nothing, its
    first candidate that counts; `alike` what step 1 cannot tell from it: its near-equals, and what fits as well.
    `named`: the first of each step's candidates that count, added or not. `found`: all that was added, and what cannot
    be told from it. `second_ratio`: of the held-out error of another flight, with what was discovered on this one;
    `second_added` whether that was added there.
    """

    key: str
    effects: tuple[str, ...]
    first: str | None
    alike: tuple[str, ...]
    named: tuple[str, ...]
    added: tuple[str, ...]
    found: tuple[str, ...]
    stopped: str
    held_out: float
    noise_floor: float
    sizes: tuple[str, ...]
    times: tuple[float, ...]
    seconds: float
    second_ratio: float | None = None
    second_added: bool | None = None


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study, or go on with it, and print its table."""
    options = _options(arguments)
    cases = _cases(options)
    done = _read(options.output)
    left = [case for case in cases if case.key not in done]
    for start in range(0, len(left), 4 * options.jobs):
        part = left[start : start + 4 * options.jobs]
        found = Parallel(n_jobs=options.jobs)(delayed(run)(case) for case in part)
        with options.output.open("a", encoding="utf-8") as stream:
            for outcome in found:
                if isinstance(outcome, str):
                    print(outcome, file=sys.stderr)
                    continue
                done[outcome.key] = outcome
                stream.write(json.dumps(asdict(outcome)) + "\n")
        print(f"{len(done)} of {len(cases)} flights", file=sys.stderr)
    print(table([done[case.key] for case in cases if case.key in done]))


def run(case: Case) -> Outcome | str:
    """Simulate one case and trace it; the reason in words where it cannot be flown or told anything of."""
    try:
        return _traced(case)
    except BrvHypoError as error:
        return f"{case.key}: {error}"


def _traced(case: Case) -> Outcome:
    config, sizes = planted(case)
    settings = TraceConfig(baseline=case.baseline, max_steps=4, maximum_likelihood=False)
    result = trace(simulate(config, seed=case.seed).flight, settings)
    first, last = result.steps[0], result.steps[-1]
    known = [(step.added, *_alike(step)) for step in result.steps if step.added is not None]
    ratio, added = None, None
    if set(case.effects) & set(UNNAMED) and result.discovered is not None:
        ratio, added = _second(config, case.seed, result.discovered)
    return Outcome(
        key=case.key,
        effects=case.effects,
        first=_named(first),
        alike=_alike(first),
        named=tuple(dict.fromkeys(name for step in result.steps if (name := _named(step)) is not None)),
        added=result.added,
        found=tuple(dict.fromkeys(name for names in known for name in names)),
        stopped=result.stopped,
        held_out=last.error_before.held_out
        if last.added is None or last.error_after is None
        else last.error_after.held_out,
        noise_floor=result.noise,
        sizes=tuple(size.words for size in sizes),
        times=tuple(size.times for size in sizes),
        seconds=result.seconds,
        second_ratio=ratio,
        second_added=added,
    )


def _alike(step: Step) -> tuple[str, ...]:
    """What a step cannot tell from what it names."""
    near = step.candidates[0].near_equals if step.candidates else ()
    return tuple(dict.fromkeys((*near, *step.look_alikes)))


def _named(step: Step) -> str | None:
    """The effect that a step names: its first candidate, where that one counts."""
    told = step.candidates[0] if step.candidates else None
    return told.effect if told is not None and told.p_value_adjusted <= _SIGNIFICANT else None


def _second(config: SimulationConfig, seed: int, discovered: MechanismFile) -> tuple[float | None, bool]:
    """What the file of a discovered mechanism does on another flight: ratio of held-out errors, whether it is added."""
    flight = simulate(another_flight(config, seed), seed=seed + _ANOTHER).flight
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{discovered.name}.yaml"
        path.write_text(mechanism_text(discovered), encoding="utf-8")
        settings = TraceConfig(effects=(str(path),), discover=False, max_steps=1, maximum_likelihood=False)
        step = trace(flight, settings).steps[0]
    return step.error_ratio_held_out, step.added is not None


def table(outcomes: Sequence[Outcome]) -> str:
    """One line for each planted combination, in shares of its flights whose effects are above their detection limits.

    first: named first; alike: or a stated look-alike of that; named: all that was planted was named first by some
    step; added: was added; found: or stated look-alikes; any: something was added; noise: held-out error within 20 %
    of the noise; ratio: mean of the one over the other; second: the held-out error of another flight fell with what
    was discovered.
    """
    lines = ["effect                      flights  first  alike  named  added  found    any  noise  ratio second"]
    seen = [o for o in outcomes if all(times >= 1.0 for times in o.times)]
    for name in dict.fromkeys("+".join(o.effects) or "none" for o in seen):
        own = [o for o in seen if ("+".join(o.effects) or "none") == name]
        unnamed = bool(set(own[0].effects) & set(UNNAMED))
        of_names = [
            np.mean([o.first in o.effects for o in own]),
            np.mean([o.first in o.effects or bool(set(o.effects) & set(o.alike)) for o in own]),
            *(np.mean([set(o.effects) <= set(getattr(o, by)) for o in own]) for by in ("named", "added", "found")),
        ]
        shares = [
            *(of_names if own[0].effects and not unnamed else [np.nan] * len(of_names)),
            np.mean([bool(o.added) for o in own]),
            np.mean([o.held_out < 1.2 * o.noise_floor for o in own]),
            np.mean([o.held_out / o.noise_floor for o in own]),
            np.mean([bool(o.second_added) for o in own]) if unnamed else np.nan,
        ]
        lines.append(f"{name:28s}{len(own):7d}" + "".join(f"{share:7.2f}" for share in shares))
    return "\n".join(lines)


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.studies.loop.study", description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("trace_study.jsonl"), help="results, appended to")
    parser.add_argument("--flights", type=int, default=21, help="flights for each effect")
    parser.add_argument("--short", action="store_true", help="three flights for each effect, one a vehicle")
    parser.add_argument("--effects", default=None, help="comma-separated; a plus joins two; none plants nothing")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    return parser.parse_args(arguments)


def _cases(options: argparse.Namespace) -> list[Case]:
    names = options.effects.split(",") if options.effects else ["none", *EFFECTS, *UNNAMED, *_pairs()]
    flights = len(VEHICLES) if options.short else options.flights
    return [
        Case(() if name == "none" else tuple(name.split("+")), VEHICLES[k % len(VEHICLES)], options.seed + k)
        for k in range(flights)
        for name in names
    ]


def _pairs() -> list[str]:
    return [
        "trim+magnus",
        "bodyfixed+gyro_scale",
        "cubic_stiffness+wind_step",
        "lag+trim",
        "damping+stiffness_asymmetry",
    ]


def _read(path: Path) -> dict[str, Outcome]:
    if not path.exists():
        return {}
    lines = path.read_text(encoding="utf-8").splitlines()
    outcomes = [TypeAdapter(Outcome).validate_json(line) for line in lines]
    return {outcome.key: outcome for outcome in outcomes}


if __name__ == "__main__":
    main()
