"""`brv-hypo simulate` and `brv-hypo demo`: flights whose mechanism is known."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from brv_hypo.cli import options
from brv_hypo.cli.compare import Mechanisms, chosen, report_comparison
from brv_hypo.cli.session import Session

if TYPE_CHECKING:
    from brv_hypo.simulate import SimulatedFlight

DEMO = "demo"
DEFAULT_SEED = 1

Plant = Annotated[
    str | None,
    typer.Option(
        "--plant", metavar="NAME,NAME", help="Plant these of the configuration's plantable mechanisms."
    ),
]


def simulate(
    config: Annotated[
        str, typer.Argument(metavar="CONFIG.yaml", help="Configuration, or the name of one that comes along.")
    ],
    output: options.Output,
    plant: Plant = None,
    seed: options.Seed = None,
    json: options.Json = None,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
    force: options.Force = False,
) -> None:
    """Fly a vehicle with planted mechanisms and instrument errors."""
    session = Session(json=json, force=force, quiet=quiet, verbose=verbose)
    session.claim(output)
    from brv_hypo.report.simulate import simulation_data, simulation_text

    flown = fly(session, config, seed, () if plant is None else tuple(plant.split(",")))
    flown.save(output, overwrite=force)
    session.show(simulation_text(flown), f"Wrote {output}.")
    session.write_json(simulation_data(flown, output))


def demo(
    mechanisms: Mechanisms = None,
    config: options.Config = None,
    json: options.Json = None,
    report: options.Report = None,
    seed: options.Seed = None,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
    force: options.Force = False,
) -> None:
    """Simulate a flight with planted flow sticking, then compare."""
    session = Session(json=json, report=report, force=force, quiet=quiet, verbose=verbose)
    session.claim()
    from brv_hypo.ranking import CompareConfig, compare
    from brv_hypo.report.simulate import simulation_text
    from brv_hypo.settings import read_settings

    settings = read_settings(CompareConfig, config, **chosen(mechanisms))
    flown = fly(session, DEMO, seed, ())
    session.show(simulation_text(flown), "")
    with session.progress("comparing") as progress:
        comparison = compare([flown.flight], settings, progress=progress)
    report_comparison(session, comparison)


def fly(session: Session, config: str, seed: int | None, plant: tuple[str, ...]) -> SimulatedFlight:
    """Simulate one flight, with a progress bar."""
    from brv_hypo.simulate import simulate as simulated

    with session.progress("simulating") as progress:
        return simulated(
            config,
            seed=DEFAULT_SEED if seed is None else seed,
            plant=plant,
            progress=lambda fraction: progress("simulating", fraction),
        )
