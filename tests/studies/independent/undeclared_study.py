"""What `trace` says of effects that no plugin has: the family that explains the residual, findings that are none.

By hand: python -m tests.studies.independent.undeclared_study --seed 1000 --flights 46 --jobs 2 [--grammar] [--drawn]

Flight k has seed SEED + k and the kind k of `KINDS`, in turn at its ordinary size, which any flight has, and at 2 to 8
times that, log-uniform: then it is the undeclared effect; with --grammar a kind drawn from `grammar` at 3 to 30 times
its detection limit; --drawn: on vehicles that are drawn. Nothing else moves the vehicle but its baseline. Counts come
with exact 95 % intervals (Clopper and Pearson 1934).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from time import process_time

import numpy as np
from joblib import delayed

from brv_hypo.errors import UnanswerableError
from brv_hypo.tracing import TraceConfig, trace
from brv_hypo.tracing.description import GENERIC
from tests.studies.independent import grammar
from tests.studies.independent.drawn_vehicles import draw_craft
from tests.studies.independent.flights import Made, make_flight
from tests.studies.independent.imperfect_study import count
from tests.studies.independent.reporting import fly_and_report
from tests.studies.independent.vehicles import CRAFTS, Craft

SETTINGS = TraceConfig(max_steps=4)
FAMILY = {
    "wind_shear": "air",
    "turbulence": "air",
    "density_profile": "air",
    "density_layer": "air",
    "inertia_asymmetry": "harmonic",
    "cg_drift": "body",
    "tip_change": "body",
    "slosh": "body",
    "three_lobes": "harmonic",
    "two_lobes": "harmonic",
    "static_alpha_squared": "stiffness",
    "static_mach": "stiffness",
    "damping_mach": "rate",
    "damping_alpha": "rate",
    "side_moment": "side",
    "random_flow": "body",
    "gyro_walk": "gyros",
    "gyro_g": "gyros",
    "accel_drift": "accelerometers",
    "rectification": "accelerometers",
}
# Effects of the list that are what was planted, or make the same moment.
ALSO = {
    "tip_change": ("bodyfixed", "trim"),
    "two_lobes": ("stiffness_asymmetry",),
    "inertia_asymmetry": ("stiffness_asymmetry",),
    "side_moment": ("magnus",),
    "static_mach": ("mach_stiffness", "reynolds_stiffness"),
    "damping_mach": ("mach_damping", "reynolds_damping"),
    "static_alpha_squared": ("cubic_stiffness",),
    "cg_drift": ("trim",),
    "gyro_g": ("gyro_bias",),
}
KINDS = tuple(FAMILY)
FAMILY |= {kind.name: kind.family for kind in grammar.KINDS}
ALSO |= {"side alpha^1": ("magnus",), "two lobes alpha^1": ("stiffness_asymmetry",)}
LARGER = (2.0, 8.0)  # times an ordinary size
SHOWN = 1.2**0.5  # times the noise, the first residual's rms, from which there is something to explain
MOST = 0.9  # of what is explained, that a set of families explains
DRAWN = "drawn"  # name of a vehicle that is drawn
_STREAM, _VEHICLE = 13, 14


@dataclass(frozen=True)
class Outcome:
    """One flight: what it had, what the program said."""

    seed: int
    kind: str
    size: float
    vehicle: str
    families: dict[str, float]
    findings: tuple[str, ...]
    hints: tuple[str, ...]
    before: float
    """Rms of the first residual over the noise's."""
    white: bool
    left: float
    """The same of the last residual."""
    seconds: float

    @property
    def shows(self) -> bool:
        """Whether an undeclared effect was planted and shows."""
        return self.size > 1.0 and self.before > SHOWN

    @property
    def true(self) -> tuple[str, ...]:
        """Effects of the list that the flight has; the static moment of vehicles that are drawn bends."""
        return ALSO.get(self.kind, ()) + (("cubic_stiffness",) if self.vehicle == DRAWN else ())

    @property
    def false(self) -> tuple[str, ...]:
        """Findings that are not what was planted."""
        return tuple(name for name in self.findings if name not in self.true)

    @property
    def other_names(self) -> tuple[str, ...]:
        """Hints that name an effect of the list which was not planted."""
        return tuple(name for name in self.hints if name not in self.true and not name.startswith(GENERIC))

    @property
    def most(self) -> tuple[str, ...]:
        """The families that make most of what is explained, the largest first."""
        order = sorted(self.families, key=lambda each: -self.families[each])
        shares = np.cumsum([self.families[each] for each in order])
        return tuple(order[: int(np.searchsorted(shares, MOST * shares[-1])) + 1])


def fly(seed: int, number: int, drawn: bool) -> Outcome | str:
    """Draw, trace and note one flight; the reason in words where it cannot be flown."""
    rng = np.random.default_rng([seed, _STREAM])
    vehicle, kind = str(rng.choice(sorted(CRAFTS))), KINDS[number % len(KINDS)]
    larger = float(np.exp(rng.uniform(*np.log(LARGER))))
    size = larger if sum(divmod(number, len(KINDS))) % 2 else 1.0
    flown = _drawn(seed) if drawn else vehicle
    try:
        made = make_flight(flown, "none", 1.0, seed, "tactical", imperfect=(kind,), imperfect_size=size)
    except (RuntimeError, ValueError) as error:
        return f"seed {seed}: not flown ({error})"
    return traced(made, kind, size)


def fly_sentence(seed: int, drawn: bool) -> Outcome | str:
    """The same with an effect drawn from the grammar, its size in detection limits."""
    kind = grammar.KINDS[int(np.random.default_rng([seed, _STREAM]).integers(len(grammar.KINDS)))]
    try:
        made, times = grammar.sized(seed, kind, **({"vehicle": _drawn(seed)} if drawn else {}))
    except (RuntimeError, ValueError) as error:
        return f"seed {seed}: {kind.name} not flown ({error})"
    return traced(made, kind.name, times)


def _drawn(seed: int) -> Craft:
    return draw_craft(np.random.default_rng([seed, _VEHICLE]))


def traced(made: Made, kind: str, size: float) -> Outcome | str:
    """What `trace` says of a flight, noted beside what was planted; the reason in words where it is too short."""
    begun = process_time()
    try:
        found = trace(made.flight, SETTINGS)
    except UnanswerableError as error:
        return f"seed {made.seed}: not traced ({error})"
    seconds = process_time() - begun
    first, last = found.steps[0].residual, found.final_residual
    assert last is not None
    names = found.families, found.findings, found.hints
    white = found.stopped == "white"
    return Outcome(made.seed, kind, size, made.vehicle, *names, first.noise_ratio, white, last.noise_ratio, seconds)


def line(found: Outcome) -> str:
    """One flight in a line."""
    shares = ", ".join(f"{name} {found.families[name]:.0%}" for name in found.most if found.families[name] > 0.0)
    return (
        f"{found.seed} {found.kind} x {found.size:.1f} {found.vehicle}, {found.before:.2f} times the noise: {shares}; "
        f"found {', '.join(found.findings) or 'nothing'}, hints {', '.join(found.hints) or 'none'}; "
        f"{'noise' if found.white else 'not noise'} at {found.left:.2f}, {found.seconds:.0f} s"
    )


def report(outcomes: Sequence[Outcome]) -> Iterable[str]:
    """Counts with their intervals."""
    ordinary, shown = [o for o in outcomes if o.size == 1.0], [o for o in outcomes if o.shows]
    yield count("undeclared effect that shows: its family first", [o.most[0] == FAMILY[o.kind] for o in shown])
    yield count("undeclared effect that shows: in the set of most", [FAMILY[o.kind] in o.most for o in shown])
    yield count("undeclared effect: a false finding", [bool(o.false) for o in outcomes if o.size > 1.0])
    if ordinary:
        yield count("ordinary size: a false finding", [bool(o.false) for o in ordinary])
    yield count("a hint by another name", [bool(o.other_names) for o in outcomes])
    yield count("'noise' at 1.2 times the noise's mean square", [o.left > SHOWN for o in outcomes if o.white])
    seconds = [o.seconds for o in outcomes]
    yield f"CPU seconds: median {np.median(seconds):.0f}, most {max(seconds):.0f}"


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--flights", type=int, default=len(KINDS))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--grammar", action="store_true", help="effects drawn from the grammar")
    parser.add_argument("--drawn", action="store_true", help="on vehicles that are drawn")
    given = parser.parse_args(arguments)
    drawn, seeds = given.drawn, range(given.seed, given.seed + given.flights)
    runs = (delayed(fly_sentence)(k, drawn) if given.grammar else delayed(fly)(k, k - given.seed, drawn) for k in seeds)
    fly_and_report(runs, given.jobs, line, report)


if __name__ == "__main__":
    main()
