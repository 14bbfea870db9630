"""How `compare` answers on flights with what no list of tolerances has: one kind of imperfection in turn, or all.

By hand: python -m tests.studies.independent.imperfect_study --seed 1000 --flights 75 --jobs 2

Flight k has seed SEED + k and the kind k of `imperfections.KINDS` (`--world all`: every kind at half of its ordinary
size; `--world tolerances`: none). Nothing and one of the five mechanisms take turns, one in three empty; the mechanism
has 30 to 100 % of its full size, in the world of tolerances 3 to 100 %, log-uniform. `--gap 0.03`: that share of each
record is lost, in one piece that begins between a fifth and four fifths of it. `--drawn`: vehicles that no one has
designed (`drawn_vehicles`) in place of the four.
Counts come with exact 95 % intervals (Clopper and Pearson 1934). Of right names, stated errors are counted: every
value of the mechanism, its delay and the knot nearest to one of its edges, against what was planted. `--likelihood`
counts those of maximum likelihood too, of a mechanism that begins at once.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from time import process_time

import numpy as np
from joblib import delayed
from scipy.stats import beta

from brv_hypo import compare
from brv_hypo.comparison import CompareConfig, Comparison
from brv_hypo.comparison.result import DerivedEstimate, MaximumLikelihood
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight.format import assemble, unassemble
from tests.studies.identification.study import NORMAL_95
from tests.studies.independent.drawn_vehicles import draw_craft
from tests.studies.independent.flights import Made, make_flight
from tests.studies.independent.imperfections import KINDS
from tests.studies.independent.instruments import GRADES
from tests.studies.independent.mechanisms import LISTED, Planted
from tests.studies.independent.reporting import fly_and_report
from tests.studies.independent.study import share_of
from tests.studies.independent.vehicles import CRAFTS, Craft

AMPLITUDE = (0.3, 1.0)  # of a mechanism's full size
SMALLEST = 0.03  # of it, in the world of tolerances
NAMED_SIZE = 0.1  # of it, from which names are counted apart there
BINS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)  # of probabilities, for the calibration error
EMPTY_EVERY = 3  # flights, of which one has nothing planted
HALF = 0.5  # of the ordinary size, where all kinds come together
GAPS = (0.2, 0.8)  # of the record, between which a gap begins
_STREAM, _GAP, _VEHICLE = 7, 8, 77


@dataclass(frozen=True)
class Outcome:
    """One flight: what it had, what the program said."""

    seed: int
    kind: str
    vehicle: str
    truth: str
    share: float
    outcome: str
    winner: str | None
    leads: str
    chance: float
    amplitude: float
    seconds: float
    limit: float
    """That the program allows the planted mechanism, as a share of the moment; NaN where it is withheld."""
    misses: dict[str, float]
    """Of a right name: estimate less truth, over its standard error."""
    of_likelihood: dict[str, float] = field(default_factory=dict)
    """The same by maximum likelihood, where it was requested and converged."""
    likelihood: str = ""
    """How that ended; empty where it was not requested."""


def drawn_flight(
    seed: int, number: int, grade: str, world: str, unit: int = 0, drawn: bool = False
) -> tuple[Made, str, float]:
    """The flight of this number, the kind of its imperfection, and the mechanism's part of its full size; the record is
    that of an inertial unit aboard, the vehicle one of four or `drawn`.

    Raises RuntimeError where none can be flown.
    """
    rng = np.random.default_rng([seed, _STREAM])
    vehicle: str | Craft = str(rng.choice(sorted(CRAFTS)))
    if drawn:
        vehicle = draw_craft(np.random.default_rng([seed, _VEHICLE]))
    truth, amplitude = str(rng.choice(LISTED)), float(rng.uniform(*AMPLITUDE))
    if world == "tolerances":
        amplitude = float(np.exp(rng.uniform(np.log(SMALLEST), 0.0)))
    if sum(divmod(number, len(KINDS))) % EMPTY_EVERY == 0:  # every kind in turn
        truth = "none"
    kind = KINDS[number % len(KINDS)] if world == "one" else world
    kinds = {"tolerances": (), "all": KINDS}.get(world, (kind,))
    size = HALF if world == "all" else 1.0
    made = make_flight(vehicle, truth, amplitude, seed, grade, imperfect=kinds, imperfect_size=size, unit=unit)
    return made, kind, amplitude


def with_gap(made: Made, seed: int, share: float) -> Made:
    """The flight without that share of its record, read again as a file is; shares of the moment are of the rest."""
    record, kept = unassemble(made.flight), np.ones(made.flight.samples, dtype=bool)
    first = int(np.random.default_rng([seed, _GAP]).uniform(*GAPS) * kept.size)
    kept[first : first + round(share * kept.size)] = False
    channels = {name: values[kept] for name, values in record.channels.items()}
    true = replace(made.true, turning=made.true.turning[kept], contribution=made.true.contribution[kept])
    flight = assemble(record.model_copy(update={"time": record.time[kept], "channels": channels}))
    return replace(made, flight=flight, true=true)


def fly(
    seed: int, number: int, grade: str, world: str, likelihood: bool = False, drawn: bool = False, gap: float = 0.0
) -> Outcome | str:
    """Draw, compare and note one flight; the reason in words where it cannot be flown."""
    try:
        made, kind, amplitude = drawn_flight(seed, number, grade, world, drawn=drawn)
        made = with_gap(made, seed, gap) if gap else made
    except (RuntimeError, ValueError) as error:
        return f"seed {seed}: not flown ({error})"
    begun = process_time()
    settings = CompareConfig(mechanisms=LISTED, maximum_likelihood="quick" if likelihood else "none")
    try:
        comparison = compare([made.flight], settings)
    except UnanswerableError as error:  # it tumbles
        return f"seed {seed}: {error}"
    verdict, fitted = (
        comparison.verdict,
        next((each.ml for each in comparison.ranking), None),
    )  # none of a faulty record
    seconds = process_time() - begun
    right = verdict.winner == made.truth != "none"
    leads = max(verdict.probability, key=verdict.probability.__getitem__, default="record fault")
    return Outcome(
        seed=seed,
        kind=kind,
        vehicle=made.vehicle,
        truth=made.truth,
        share=share_of(made),
        outcome=verdict.outcome,
        winner=verdict.winner,
        leads=leads,
        chance=verdict.probability.get(leads, 0.0),
        amplitude=amplitude,
        seconds=seconds,
        misses=misses(made, comparison) if right else {},
        of_likelihood=likelihood_misses(made, fitted) if right and fitted and not fitted.trouble else {},
        likelihood=fitted.status if right and fitted else "",
        limit=next((x.share_of_moment_95 for x in verdict.limits if x.mechanism == made.truth), float("nan")),
    )


def misses(made: Made, found: Comparison) -> dict[str, float]:
    """What the leader states, less what was planted, in standard errors: values at mid-region, its rms moment, delays,
    the knot that is nearest to when the mechanism begins or ends.
    """
    planted, fitted = made.true.planted, found.ranking[0]
    true, middle = _values(planted), 0.5 * (planted.start + planted.stop)
    out = {
        each.name: (each.value - true[each.name]) / each.std_error
        for interval in fitted.intervals
        if interval.start_s <= middle < interval.stop_s
        for each in interval.values
        if each.name in true
    }
    (sized,) = (each for each in found.verdict.limits if each.mechanism == made.truth)
    moment = (sized.share_of_moment - share_of(made)) / sized.share_std_error
    return out | {"moment": moment} | _times(planted, fitted.derived, " knot")


def likelihood_misses(made: Made, found: MaximumLikelihood) -> dict[str, float]:
    """The same of maximum likelihood; values where they jump once before the middle of the region."""
    planted = made.true.planted
    true, middle = _values(planted), 0.5 * (planted.start + planted.stop)
    before = [each for each in found.terms if each.region_s is None or each.region_s[0] < middle]
    names = [each.name.removeprefix("jump in ") for each in before]
    out = {
        name: (each.value - true[name]) / each.std_error
        for name, each in zip(names, before, strict=True)
        if name in true and names.count(name) == 1
    }
    return out | _times(planted, found.derived, " start")


def _values(planted: Planted) -> dict[str, float]:
    """Of each coefficient by its name."""
    angle = planted.values.get("angle", 0.0)
    return {
        "C_damping": planted.amplitude,
        "C_m0": planted.amplitude * planted.values.get("offset", np.nan),
        "C_malpha": planted.amplitude * planted.values.get("slope", np.nan),
        "C_b cos(phi_b)": planted.amplitude * np.cos(angle),
        "C_b sin(phi_b)": planted.amplitude * np.sin(angle),
        "lag fraction": 1.0,
        "eps": planted.amplitude,
    }


def _times(planted: Planted, derived: Sequence[DerivedEstimate], knot: str) -> dict[str, float]:
    """Of the first delay, and of the knot that is nearest to an edge of what was planted."""
    delays = [each for each in derived if each.name.endswith(" delay")]
    out = {each.name: (each.value - planted.delay) / each.std_error for each in delays[:1]}
    knots = [each for each in derived if each.name.split(" (")[0].endswith(knot)]
    found = [(each, edge) for each in knots for edge in (planted.start, planted.stop)]
    near = min(found, key=lambda each: abs(each[0].value - each[1]), default=None)
    return out | ({} if near is None else {"knot": (near[0].value - near[1]) / near[0].std_error})


def line(found: Outcome) -> str:
    """One flight in a line."""
    return (
        f"{found.seed} {found.kind} {found.vehicle} {found.truth} share {found.share:.4f} (limit {found.limit:.4f}): "
        f"{found.outcome} {found.winner}, {found.leads} leads with {found.chance:.2f}; size {found.amplitude:.2f}, "
        f"{found.seconds:.1f} s {', '.join(f'{name} {miss:.1f}' for name, miss in found.misses.items())}"
    )


def report(outcomes: Sequence[Outcome]) -> Iterable[str]:
    """Counts with their intervals, and the kinds with which a planted mechanism is not named."""
    planted = [o for o in outcomes if o.truth != "none"]
    empty = [o for o in outcomes if o.truth == "none"]
    yield count("planted: named right", [o.winner == o.truth for o in planted])
    large = [o for o in planted if o.amplitude >= NAMED_SIZE]
    yield count(f"planted, {NAMED_SIZE:.0%} of full size or more: named right", [o.winner == o.truth for o in large])
    yield count("planted: a wrong mechanism is named", [o.winner not in (None, "none", o.truth) for o in planted])
    yield count("planted: 'none adequate'", [o.outcome == "none adequate" for o in planted])
    yield count("planted: the truth leads", [o.leads == o.truth for o in planted])
    yield count("nothing planted: a mechanism is named", [o.winner not in (None, "none") for o in empty])
    yield count("nothing planted: baseline only is named", [o.winner == "none" for o in empty])
    yield count("nothing planted: 'none adequate'", [o.outcome == "none adequate" for o in empty])
    yield count("records refused", [o.outcome == "record fault" for o in outcomes])
    yield count(
        "planted, limits stated: cover the true share", [o.limit >= o.share for o in planted if o.limit == o.limit]
    )
    for what in ("misses", "of_likelihood"):
        stated = [(name, abs(miss)) for o in outcomes for name, miss in getattr(o, what).items()]
        if stated or what == "misses":
            title = "stated errors" if what == "misses" else "errors of maximum likelihood"
            yield count(f"right names, {title}: within 1.96", [miss <= NORMAL_95 for _, miss in stated])
        for name in sorted({name for name, _ in stated}):
            yield count(f"  {name}", [miss <= NORMAL_95 for own, miss in stated if own == name])
    if ended := [o.likelihood for o in outcomes if o.likelihood]:
        yield count("right names, maximum likelihood: converged", [each == "converged" for each in ended])
    yield f"calibration error {calibration_error(outcomes):.3f}"
    seconds = [o.seconds for o in outcomes]
    yield f"CPU seconds: median {np.median(seconds):.1f}, most {max(seconds):.1f}"
    for kind in dict.fromkeys(o.kind for o in outcomes):
        own = [o for o in planted if o.kind == kind]
        if own:
            yield f"{kind}: {sum(o.winner == o.truth for o in own)} of {len(own)} named right"


def calibration_error(outcomes: Sequence[Outcome]) -> float:
    """Expected calibration error of the leader's probability: mean distance from the share that is right, by bins."""
    judged = [o for o in outcomes if o.outcome != "record fault"]
    right = np.array([o.leads == o.truth for o in judged], dtype=float)
    chance = np.array([o.chance for o in judged])
    place = np.digitize(chance, BINS[1:-1])
    return float(sum(abs(np.sum(right[place == k] - chance[place == k])) for k in range(len(BINS))) / len(judged))


def count(what: str, hits: Sequence[bool]) -> str:
    """A count, its share and its exact 95 % interval."""
    if not hits:
        return f"{what}: none tried"
    k, n = sum(hits), len(hits)
    low = float(beta.ppf(0.025, k, n - k + 1)) if k else 0.0
    high = float(beta.ppf(0.975, k + 1, n - k)) if k < n else 1.0
    return f"{what}: {k} of {n} ({k / n:.0%}, {low:.0%} to {high:.0%})"


def command_line(
    description: str,
    flights: int,
    world: str,
    arguments: Sequence[str] | None = None,
    switches: Sequence[str] = (),
    shares: Sequence[str] = (),
) -> argparse.Namespace:
    """The options of a study of drawn flights: seed, so many flights unless said, grade, world, jobs, and others."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--flights", type=int, default=flights)
    parser.add_argument("--grade", default="tactical", choices=GRADES)
    parser.add_argument("--world", default=world, choices=("one", "all", "tolerances"))
    parser.add_argument("--jobs", type=int, default=1)
    for name in shares:
        parser.add_argument(f"--{name}", type=float, default=0.0)
    for name in switches:
        parser.add_argument(f"--{name}", action="store_true")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    given = command_line(__doc__.splitlines()[0], len(KINDS), "one", arguments, ("likelihood", "drawn"), ("gap",))
    options = given.grade, given.world, given.likelihood, given.drawn, given.gap
    runs = (delayed(fly)(given.seed + k, k, *options) for k in range(given.flights))
    fly_and_report(runs, given.jobs, line, report)


if __name__ == "__main__":
    main()
