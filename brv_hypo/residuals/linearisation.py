"""`Corrected`: flights without the record errors of a model, reconstructed again and ready to be regressed."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from brv_hypo.arrays import BoolArray, FloatArray, IntArray
from brv_hypo.constants import MODEL_MOMENT_ROUNDS
from brv_hypo.flight.record import Flight
from brv_hypo.mechanisms.contract import Mechanism, RecordEffect
from brv_hypo.mechanisms.registry import without
from brv_hypo.model.reconstruction import reconstruct
from brv_hypo.model.term import Regressor
from brv_hypo.motion import ReconstructionConfig
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.reconstruction import Reconstruction
from brv_hypo.motion.responses import superposed
from brv_hypo.regression.build import linearised, on_rows
from brv_hypo.regression.channels import Noise, Part, part, split, whole
from brv_hypo.regression.frame import RateFrame, build_frame
from brv_hypo.regression.linear import solve_scaled
from brv_hypo.regression.nuisance import Errors
from brv_hypo.regression.propagated_motion import linearisation_point
from brv_hypo.regression.whitening import difference
from brv_hypo.residuals.config import TraceConfig


@dataclass(frozen=True)
class Applied:
    """A component of a record effect that the model holds, with the value that was taken out of one flight's record."""

    effect: RecordEffect
    component: str
    units: str
    size: float
    value: float
    flight: int = 0


@dataclass(frozen=True)
class Model:
    """What explains the flights: moment columns of these mechanisms, and components of record effects."""

    mechanisms: Mapping[str, Mechanism]
    columns: tuple[Regressor, ...]
    applied: tuple[Applied, ...] = ()
    added: tuple[str, ...] = ()


@dataclass(frozen=True)
class Corrected:
    """Flights, with what the model takes out of their records taken out, reconstructed.

    `corrections`, one a flight, are the errors that were found within the tolerances. The regression knows them by
    their priors still, but is linearised where those of the record are corrected and those of the vehicle act.
    """

    records: tuple[InertialRecord, ...]
    frame: RateFrame
    fitted: Part
    held_out: Part
    whole: Part
    corrections: tuple[Errors, ...]

    @property
    def reconstructions(self) -> tuple[Reconstruction, ...]:
        """One a flight."""
        return self.frame.reconstructions

    @property
    def flights(self) -> tuple[Flight, ...]:
        """The records as they are read."""
        return tuple(reconstruction.flight for reconstruction in self.frame.reconstructions)

    def rows_of(self, number: int) -> IntArray:
        """Rows of the frame that belong to one flight."""
        return np.flatnonzero(self.frame.flight_of_row == number)

    def samples_of(self, number: int) -> IntArray:
        """The sample of the flight that each of these rows is."""
        own = [np.arange(s.rows.start, s.rows.stop) for s in self.frame.segments if s.flight == number]
        return np.concatenate(own) if own else np.zeros(0, dtype=int)

    def part_of(self, chosen: Collection[int]) -> Part:
        """All of some of the flights."""
        return self.part_where(np.isin(self.frame.flight_of_row, list(chosen)))

    def part_where(self, chosen: BoolArray) -> Part:
        """The rows that are chosen (frame rows,)."""
        valid = np.zeros(self.frame.observed.size, dtype=bool)
        valid[self.whole.rows] = self.whole.valid
        return part(self.frame, valid, chosen, shared=True)

    def values(self, part: Part, columns: tuple[Regressor, ...]) -> FloatArray:
        """Coefficients (columns,) of the moments on a part, by plain least squares of the rates' differences."""
        noise = Noise(difference(), difference())
        design = part.white_rates(self.frame.columns(columns)[part.rows], noise)
        constants = part.white_rates(part.constants(), noise)
        response = part.white_rates(self.frame.observed[part.rows], noise)[:, 0]
        return solve_scaled(np.column_stack([design, constants]), response)[: len(columns)]


def correct(
    flights: Sequence[Flight], model: Model, config: TraceConfig, corrections: Sequence[Errors] | None = None
) -> Corrected:
    """Reconstruct the flights as the model reads their records, `corrections` out of each besides.

    What the reconstruction finds of the remaining errors within their tolerances is taken out too.
    """
    corrections = tuple(corrections) if corrections is not None else tuple({} for _ in flights)
    settings = ReconstructionConfig(method=config.method)
    points = []
    for number, flight in enumerate(flights):
        read = without(flight, corrections[number])
        own = [applied for applied in model.applied if applied.flight == number]
        read = superposed(read, [each.effect.perturb(read, each.component, -each.value) for each in own])
        points.append(linearisation_point(reconstruct(read, settings), settings))
    records = tuple(record for record, _ in points)
    frame = build_frame([reconstruction for _, reconstruction in points], list(model.mechanisms.values()))
    valid = _force_valid(frame, records)
    fitted, held_out = split(frame, valid, config.blocks)
    return Corrected(records, frame, fitted, held_out, whole(frame, valid), corrections)


def with_in_plane_moment(data: Corrected, columns: tuple[Regressor, ...]) -> Corrected:
    """The flight with C_mw of Eq. 5.1 where columns look into its past."""
    if not any(column.theta for column in columns):
        return data
    for _ in range(MODEL_MOMENT_ROUNDS):
        values = data.values(data.fitted, columns)
        data = replace(data, frame=data.frame.with_in_plane_moment(columns, values))
    return data


def _force_valid(frame: RateFrame, records: Sequence[InertialRecord]) -> BoolArray:
    """Where the transverse force was measured and is no spike against the normal-force model (frame rows,)."""
    pairs = zip(records, frame.reconstructions, strict=True)
    return on_rows(frame, [linearised(*pair, frame, (), np.zeros(0)) for pair in pairs])[1]
