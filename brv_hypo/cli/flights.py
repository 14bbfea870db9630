"""Commands `inspect`, `import`, `reconstruct`, `simulate` and `demo`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from brv_hypo.cli.analyses import Mechanisms, chosen, report_comparison
from brv_hypo.cli.session import ANALYSIS, RESULT, FlightFile, Output, Seed, Session, complete_configs, in_session
from brv_hypo.errors import UsageError
from brv_hypo.io.files import write_whole
from brv_hypo.thresholds import TUMBLING_ALPHA

if TYPE_CHECKING:
    from brv_hypo.simulation import SimulatedFlight

UNSEEN = 1e-4  # share of the moment's rms below which what is planted is said not to act


@in_session("start", "stop", "json", "force")
def inspect(session: Session, flight: FlightFile) -> None:
    """Show what a record holds, its faults, and what is usable."""
    session.claim()
    from brv_hypo.flight import inspect_flight, load_flight
    from brv_hypo.motion import try_record
    from brv_hypo.report.listings import inspection_blocks, inspection_data, inspection_line

    inspection = inspect_flight(flight, start=session.start, stop=session.stop)
    trial = try_record(load_flight(flight, start=session.start, stop=session.stop))[1]
    faults = ", ".join(dict.fromkeys(fault.fault for fault in trial.faults)) or "none"
    said = f"{inspection_line(inspection)}; faults: {faults}{'' if trial.sound else ', the record contradicts itself'}"
    session.show(*inspection_blocks(inspection, trial), conclusion=said)
    session.write_json(inspection_data(inspection, trial))


@in_session("force")
def import_(
    session: Session,
    data: Annotated[
        list[Path], Argument(metavar="DATA", help="Foreign record: csv, parquet, mat. With --guess, others' files too.")
    ],
    mapping: Annotated[
        Path | None, Option("--map", metavar="MAP.yaml", help="Which column is which channel, in what units.")
    ] = None,
    output: Annotated[
        Path | None, Option("-o", "--output", metavar="FILE", help="Record to write; with --guess, the map.")
    ] = None,
    guess: Annotated[bool, Option("--guess", help="Write a commented map, from names and physics, instead.")] = False,
) -> None:
    """Bring a foreign record in by a map; --guess writes one."""
    if guess and mapping is None:
        _write_guess(session, data, output or Path(f"{data[0].stem}.map.yaml"))
    elif guess or mapping is None:
        raise UsageError(
            "import needs either --map MAP.yaml, which says what the columns are, or --guess, which writes such a map."
        )
    elif len(data) > 1:
        others = "the map names the others under recorders and vehicle. Only --guess takes several."
        raise UsageError(f"import --map brings in one file, got {len(data)}: {others}")
    elif output is None:
        raise UsageError("import --map needs the record to write: -o flight.h5.")
    else:
        _bring_in(session, data[0], mapping, output)


def _write_guess(session: Session, data: Sequence[Path], output: Path) -> None:
    session.claim(output)
    from brv_hypo.importing.guess import guess_map
    from brv_hypo.report.document import Texts

    found = guess_map(*data)
    write_whole(output, found.text, overwrite=session.force)
    session.show(Texts(found.unsure, "Missing or unsure", warning=True))
    then = f"brv-hypo import {data[0]} -o flight.h5 \\\n    --map {output}"
    session.show(f"Wrote {output}. Read it, fill in the vehicle, then:\n  {then}")


def _bring_in(session: Session, data: Path, mapping: Path, output: Path) -> None:
    session.claim(output, hdf5=True)
    from brv_hypo.flight import save_flight
    from brv_hypo.importing import bring_in
    from brv_hypo.motion import try_record
    from brv_hypo.report.document import Texts
    from brv_hypo.report.listings import phase_texts

    found = bring_in(data, mapping)
    flight = found.flight
    save_flight(flight, output, overwrite=session.force)
    session.show(Texts(flight.notes, "Notes"), Texts(phase_texts(found.phases), "Phases (a map's window names one)"))
    session.show(f"Wrote {output}: {flight.samples} samples at {flight.sample_rate:.4g} Hz.")
    for fault in (fault for fault in try_record(flight)[1].faults if fault.decisive):  # with -q and in scripts too
        session.warn(f"warning: the record contradicts itself ({fault.fault}): {fault.action}")


@in_session(*ANALYSIS)
def reconstruct(
    session: Session,
    flight: FlightFile,
    output: Annotated[
        Path | None, Option("-o", "--output", metavar="motion.h5", help="Write the histories as HDF5.")
    ] = None,
    method: Annotated[
        str | None, Option("--method", help="How to find the wind: joint (if left out), velocity or rates.")
    ] = None,
) -> None:
    """Find wind-relative motion and moments, with uncertainty."""
    session.claim(output, hdf5=True)
    from brv_hypo.model.reconstruction import reconstruct as reconstructed
    from brv_hypo.motion import ReconstructionConfig, write_motion
    from brv_hypo.report.reconstruction import reconstruction_data, reconstruction_document
    from brv_hypo.settings import settings_of

    settings = settings_of(ReconstructionConfig, session.config, {} if method is None else {"method": method})
    with session.progress("reconstructing") as progress:
        result = reconstructed(session.load(flight), settings, progress=progress)
    data, records = reconstruction_data(result), [result.flight.path]
    session.deliver(reconstruction_document(result), data, settings, records)
    if output is not None:
        write_motion(result, output, overwrite=session.force)
        session.show(f"Wrote {output}.")


@in_session("json", "force", "plugin")
def simulate(
    session: Session,
    config: Annotated[
        str, Argument(metavar="CONFIG.yaml", autocompletion=complete_configs, help="File, or one that comes along.")
    ],
    output: Output,
    plant: Annotated[
        str | None, Option("--plant", metavar="NAME,NAME", help="Plant these of the configuration's plantable sets.")
    ] = None,
    draw: Annotated[
        float | None,
        Option("--draw", metavar="TIMES", min=0.0, help="Draw errors from so many times the tolerances; 1 is usual."),
    ] = None,
    seed: Seed = None,
) -> None:
    """Fly a vehicle with planted mechanisms and instrument errors."""
    session.claim(output, hdf5=True)
    from brv_hypo.report.listings import simulation_blocks, simulation_data

    flown = fly(session, config, seed, () if plant is None else tuple(plant.split(",")), draw)
    flown.save(output, overwrite=session.force)
    session.show(*simulation_blocks(flown, verbose=session.verbose), f"Wrote {output}.")
    session.write_json(simulation_data(flown, output))


@in_session("config", *RESULT)
def demo(session: Session, mechanisms: Mechanisms = None, seed: Seed = None) -> None:
    """Simulate a flight with planted flow sticking, then compare."""
    session.claim()
    from brv_hypo.comparison import CompareConfig, compare
    from brv_hypo.report.listings import simulation_blocks
    from brv_hypo.settings import settings_of

    settings = settings_of(CompareConfig, session.config, chosen(mechanisms))
    flown = fly(session, "demo", seed)
    session.show(*simulation_blocks(flown, verbose=session.verbose), "")
    with session.progress("comparing") as progress:
        comparison = compare([flown.flight], settings, progress=progress)
    report_comparison(session, comparison, settings)


def fly(
    session: Session, config: str, seed: int | None, plant: tuple[str, ...] = (), draw: float | None = None
) -> SimulatedFlight:
    """Simulate one flight, with a progress bar; a record without noise and a vehicle that tumbles are warned of."""
    from brv_hypo.simulation import load_config
    from brv_hypo.simulation import simulate as simulated

    chosen = load_config(config, plant=plant, keywords={} if draw is None else {"instruments": {"draw": draw}})
    if chosen.instruments.silent:
        session.warn("no instrument has noise: a comparison of this record says nothing of a real one")
    with session.progress("simulating") as progress:
        flown = simulated(chosen, seed=1 if seed is None else seed, progress=progress)
    truth, largest = flown.truth, math.radians(TUMBLING_ALPHA)
    if truth.planted and max(truth.planted_share) < UNSEEN:
        session.warn("what is planted makes next to none of the moment: on this flight it does not act, or too briefly")
    if beyond := truth.time[truth.alpha > largest].tolist():
        session.warn(
            f"the vehicle tumbles: alpha is above {TUMBLING_ALPHA:.0f} deg from {beyond[0]:.3g} s on, and no moment is "
            "fitted there. Likely cause: what is planted is too large, or acts for too long"
        )
    return flown
