"""`brv-hypo simulate` and `brv-hypo demo`: flights whose mechanism is known."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from brv_hypo.cli import completion, options
from brv_hypo.cli.command import in_session
from brv_hypo.cli.compare import Mechanisms, chosen, report_comparison
from brv_hypo.cli.session import Session
from brv_hypo.report.chart_names import comparison_names

if TYPE_CHECKING:
    from brv_hypo.simulation import SimulatedFlight

DEMO = "demo"
DEFAULT_SEED = 1

Plant = Annotated[
    str | None,
    typer.Option(
        "--plant", metavar="NAME,NAME", help="Plant these of the configuration's plantable mechanisms."
    ),
]


@in_session("json", "force", "plugin")
def simulate(
    session: Session,
    config: Annotated[
        str,
        typer.Argument(
            metavar="CONFIG.yaml",
            autocompletion=completion.configurations,
            help="Configuration, or the name of one that comes along.",
        ),
    ],
    output: options.Output,
    plant: Plant = None,
    seed: options.Seed = None,
) -> None:
    """Fly a vehicle with planted mechanisms and instrument errors."""
    session.claim(output)
    from brv_hypo.report.simulate import simulation_data, simulation_text

    flown = fly(session, config, seed, () if plant is None else tuple(plant.split(",")))
    flown.save(output, overwrite=session.force)
    session.show(simulation_text(flown), f"Wrote {output}.")
    session.write_json(simulation_data(flown, output))


@in_session("json", "report", "figures", "force", "plugin")
def demo(
    session: Session,
    mechanisms: Mechanisms = None,
    config: options.Config = None,
    seed: options.Seed = None,
) -> None:
    """Simulate a flight with planted flow sticking, then compare."""
    session.claim(charts=comparison_names(1))
    from brv_hypo.ranking import CompareConfig, compare
    from brv_hypo.report.simulate import simulation_text
    from brv_hypo.settings import read_settings

    settings = read_settings(CompareConfig, config, **chosen(mechanisms))
    flown = fly(session, DEMO, seed, ())
    session.show(simulation_text(flown), "")
    with session.progress("comparing") as progress:
        comparison = compare([flown.flight], settings, progress=progress)
    report_comparison(session, comparison, settings)


def fly(session: Session, config: str, seed: int | None, plant: tuple[str, ...]) -> SimulatedFlight:
    """Simulate one flight, with a progress bar."""
    from brv_hypo.simulation import simulate as simulated

    with session.progress("simulating") as progress:
        return simulated(
            config,
            seed=DEFAULT_SEED if seed is None else seed,
            plant=plant,
            progress=lambda fraction: progress("simulating", fraction),
        )
