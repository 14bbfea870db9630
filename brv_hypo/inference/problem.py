"""The one least-squares problem: rows for the rates, for the specific force and for priors.

What is fitted along in every hypothesis is projected out of response and columns alike. Columns of moments show in
the rates; columns that are given as histories show in both channels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from brv_hypo.arrays import ComplexArray, FloatArray, IntArray
from brv_hypo.inference.bordered import Bordered, joined
from brv_hypo.linearisation.channels import Channels, Noise, Part, Whitening, effective_samples, side_by_side
from brv_hypo.linearisation.frame import RateFrame
from brv_hypo.linearisation.linear import lengths, orthonormal
from brv_hypo.linearisation.nuisance import AT_ONCE, Nuisances
from brv_hypo.mechanisms.contract import Mechanism, Term
from brv_hypo.model.baseline import PitchDamping, StaticMoment
from brv_hypo.model.term import Regressor
from brv_hypo.motion.inertial import InertialRecord
from brv_hypo.motion.motion import Motion

NOISE_MOST_EQUAL = 0.995  # of a direction's noise, that goes to unknowns: what is left keeps the rows regular
GIVEN = "given"
_CUTOFF = 1e-12  # singular values of unit columns that count, of the largest


class GivenColumns(Mechanism):
    """The mechanism of columns that are given as histories: no moment belongs to it."""

    name = GIVEN
    title = "columns given as histories"
    claims = "nothing of its own"
    source = "the regression"

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """None."""
        return ()


def given_column(name: str) -> Regressor:
    """The column of a history that is given."""
    return Regressor(GIVEN, name)


@dataclass(frozen=True)
class FlightRows:
    """One flight's whitened rows: where its four channels are among all, its rows of the frame, and `own_noise`, the
    whitened rates (rate rows, unknowns) of what one unit of each correlated unknown is of the noise.
    """

    part: Part
    whitening: Whitening
    channels: tuple[slice, ...]
    span: slice
    own_noise: FloatArray

    @property
    def size(self) -> int:
        """Rows of each channel."""
        return int(self.channels[0].stop - self.channels[0].start)

    @property
    def places(self) -> IntArray:
        """Its rows among all."""
        return np.concatenate([np.arange(each.start, each.stop) for each in self.channels])

    def white(self, histories: Channels) -> FloatArray:
        """Histories in both channels (rows of the flight, columns) at unit noise."""
        if not self.size:
            return np.zeros((0, histories.rates.shape[1]))
        white = self.whitening.both(histories.at(self.part.rows - self.span.start))
        white[: 2 * self.size] = self.decorrelated(white[: 2 * self.size])
        return white

    def white_moments(self, rates: ComplexArray) -> FloatArray:
        """Rate histories of moments (rows of the flight, columns) as its rows of the rates."""
        if not self.size:
            return np.zeros((0, rates.shape[1]))
        return self.decorrelated(self.whitening.rates(rates[self.part.rows - self.span.start]))

    def decorrelated(self, rates: FloatArray) -> FloatArray:
        """Whitened rates (rate rows, columns) at unit noise once that of the correlated unknowns is theirs."""
        directions, gain = self._sharpening
        return np.asarray(rates + directions @ (gain[:, np.newaxis] * (directions.T @ rates)), dtype=float)

    @cached_property
    def _sharpening(self) -> tuple[FloatArray, FloatArray]:
        """Directions (rate rows, rank) of the noise that is in unknowns, and what they gain as it leaves the rates."""
        directions, share, _ = np.linalg.svd(self.own_noise, full_matrices=False)
        share = np.minimum(share, NOISE_MOST_EQUAL)
        return directions, 1.0 / np.sqrt(1.0 - share**2) - 1.0


@dataclass(frozen=True)
class WhitenedRows:
    """A part of the record at unit noise; constants of integration and nuisances are what is projected out.
    `correlated`: the random walk of the attitude is the integral of the very noise that the rates show, and no unknown
    beside it. What belongs to the walk goes to its unknowns, and the rates have that much less noise of their own. It
    mixes rows of all times: where rows are held out, the walk has to count as independent, which only loses.
    """

    part: Part
    noise: Noise
    nuisances: Nuisances
    correlated: bool = True

    @cached_property
    def rates(self) -> int:
        """Rows of the rates; as many of the force follow, then one for each prior."""
        return 2 * self.part.thinned_rows(self.noise)

    @cached_property
    def size(self) -> int:
        """All rows."""
        return 2 * self.rates + self.nuisances.bounded.size

    @cached_property
    def of_flights(self) -> tuple[FlightRows, ...]:
        """The rows of each flight."""
        found, first, count = [], 0, self.rates // 2
        for number, own in enumerate(self.nuisances.flights):
            part = self.part.of_flight(number)
            whitening, last = Whitening(part, self.noise), first + part.thinned_rows(self.noise)
            shown = np.zeros((2 * (last - first), own.walks.size if self.correlated and last > first else 0))
            for some in own.at_once(shown.shape[1]):
                shown[:, some] = whitening.rates(own.grid.all_of(own.noise[:, some])[part.rows - own.span.start])
            channels = tuple(slice(first + k * count, last + k * count) for k in range(4))
            found.append(FlightRows(part, whitening, channels, own.span, shown))
            first = last
        return tuple(found)

    def white_moments(self, rates: ComplexArray) -> FloatArray:
        """Rate histories of moments (frame rows, columns) as rows of the rates alone, which are the first."""
        out = np.empty((self.rates, rates.shape[1]))
        for own in self.of_flights:
            for rows, part in zip(own.channels[:2], np.split(own.white_moments(rates[own.span]), 2), strict=True):
                out[rows] = part
        return out

    def white_histories(self, histories: Channels) -> FloatArray:
        """Histories in both channels (frame rows, columns) as rows, those of the priors left out."""
        out = np.empty((2 * self.rates, histories.rates.shape[1]))
        for own in self.of_flights:
            for rows, part in zip(own.channels, np.split(own.white(histories.at(own.span)), 4), strict=True):
                out[rows] = part
        return out

    def of_moments(self, rates: ComplexArray) -> FloatArray:
        """Rate histories of moments (frame rows, columns) as rows."""
        out = np.zeros((self.size, rates.shape[1]))
        out[: self.rates] = self.white_moments(rates)
        return out

    @cached_property
    def nuisance_design(self) -> FloatArray:
        """Constants of integration, then the nuisances with a one in the row of each prior (rows, unknowns)."""
        out = np.empty((self.size, self.unknowns.size))
        out[:, self.order] = self.unknowns.times(np.eye(self.unknowns.size))
        return out

    @cached_property
    def order(self) -> IntArray:
        """Where each of the `unknowns` is: constants of integration first, then as the nuisances do."""
        constants, items = 2 * len(self.part.levels), self.nuisances.items
        first_of = dict(zip((a for a, _ in self.part.pieces), self.part.flights, strict=True))
        flight_of = np.repeat([first_of[a] for a, _ in self.part.levels], 2)
        of_items = np.array([-1 if item.flight is None else item.flight for item in items])
        own = [
            np.append(np.flatnonzero(flight_of == number), constants + np.flatnonzero(of_items == number))
            for number in range(len(self.of_flights))
        ]
        shared = constants + np.flatnonzero(of_items == -1)
        return np.concatenate([*own, shared]).astype(np.int64)

    @cached_property
    def unknowns(self) -> Bordered:
        """Of each flight its constants and nuisances with a one in the row of each prior, and those of all flights."""
        items, top = self.nuisances.items, 2 * self.rates
        common = np.flatnonzero([item.flight is None for item in items])
        prior_of = {int(k): top + row for row, k in enumerate(self.nuisances.bounded)}
        shared, parts, ranges = np.zeros((self.size, common.size)), [], []
        for own, histories in zip(self.of_flights, self.nuisances.flights, strict=True):
            white = np.zeros((4 * own.size, histories.places.size))
            for some in histories.at_once(histories.places.size):
                white[:, some] = own.white(histories.all_of(histories.kept.of(some)))
            if own.own_noise.size:
                walks = np.searchsorted(histories.places, histories.walks)
                white[: 2 * own.size, walks] -= own.decorrelated(own.own_noise)
            mine = ~np.isin(histories.places, common)
            for rows, part in zip(own.channels, np.split(white[:, ~mine], 4), strict=True):
                shared[rows] = part
            priors = [(at, prior_of[k]) for at, k in enumerate(histories.places[mine].tolist()) if k in prior_of]
            constants = np.zeros((white.shape[0], 2 * len(own.part.levels)))
            if own.size:
                constants[: 2 * own.size] = own.decorrelated(own.whitening.rates(own.part.constants()))
            ones = np.zeros((len(priors), constants.shape[1] + int(np.sum(mine))))
            ones[np.arange(len(priors)), constants.shape[1] + np.array([c for c, _ in priors], dtype=int)] = 1.0
            parts.append(np.concatenate([np.column_stack([constants, white[:, mine]]), ones]))
            last = [slice(priors[0][1], priors[-1][1] + 1)] if priors else []
            ranges.append(joined([*(own.channels if own.size else ()), *last]))
        known = [(place, prior_of[k]) for place, k in enumerate(common.tolist()) if k in prior_of]
        for place, row in known:
            shared[row, place] = 1.0
        return Bordered(self.size, tuple(ranges), tuple(parts), shared)

    @property
    def basis(self) -> Bordered:
        """Orthonormal columns that span constants and nuisances (rows, unknowns)."""
        return self.unknowns.factors.basis

    def solved(self, rows: FloatArray) -> FloatArray:
        """Constants and nuisances (unknowns,) that fit rows (rows,) best."""
        factors, out = self.unknowns.factors, np.zeros(self.unknowns.size)
        out[self.order] = factors.coefficients(factors.basis.coordinates(rows[:, np.newaxis]))[:, 0]
        return out

    def projected(self, rows: FloatArray) -> FloatArray:
        """Rows (rows, columns) with constants and nuisances projected out."""
        return self.basis.less(rows)

    @cached_property
    def samples(self) -> IntArray:
        """The first of the frame's rows that each row of one channel is made of."""
        starts = [np.arange(a, b, self.noise.thinning) for a, b in self.part.pieces]
        return self.part.rows[np.concatenate(starts)]


@dataclass(frozen=True)
class ProjectedBaseline:
    """The baseline's columns, the nuisances projected out of them. `basis` (rows, rank) is orthonormal, `coefficients`
    (columns, rank) come from coordinates in it; `left` (rows,) is what it leaves of the response.
    """

    basis: FloatArray
    coefficients: FloatArray
    left: FloatArray


@dataclass(frozen=True)
class Problem:
    """Data, baseline columns, knots (s), noise and limits; `efficiency` is effective over actual samples. `records` are
    those of the flights; `force` (frame rows,) m/s^2 is the transverse specific force at the c.g.; `given` histories
    that may be requested as columns, by name.
    """

    frame: RateFrame
    records: tuple[InertialRecord, ...]
    force: ComplexArray
    rows: WhitenedRows
    baseline: tuple[Regressor, ...]
    knots: FloatArray
    max_terms: int
    exact_terms: int
    refine: bool = True
    efficiency: float = 1.0
    given: Mapping[str, Channels] = field(default_factory=dict)

    def projected_baseline(self, frame: RateFrame) -> ProjectedBaseline:
        """The baseline as this frame sees it: most frames differ in other columns, and see the same."""
        known = {name: frame.mechanisms[name] for name in {column.mechanism for column in self.baseline}}
        same = frame.finer is self.frame.finer and all(known[name] is self.frame.mechanisms.get(name) for name in known)
        whatever = all(isinstance(each, StaticMoment | PitchDamping | GivenColumns) for each in known.values())
        if same or (whatever and frame.same_motions(self.frame)):
            return self._own_baseline
        return self._project_baseline(frame)

    @cached_property
    def _own_baseline(self) -> ProjectedBaseline:
        return self._project_baseline(self.frame)

    def _project_baseline(self, frame: RateFrame) -> ProjectedBaseline:
        design = self.design(frame, self.baseline)
        basis, coefficients = orthonormal(design)
        return ProjectedBaseline(basis, coefficients, self.response - basis @ (basis.T @ self.response))

    @cached_property
    def response(self) -> FloatArray:
        """Rates, force and priors, whitened, the nuisances projected out (rows,)."""
        return self.rows.projected(self.raw_response[:, np.newaxis])[:, 0]

    @cached_property
    def raw_response(self) -> FloatArray:
        """Rates, force and present values of what has a prior, whitened (rows,)."""
        observed = Channels(self.frame.observed[:, np.newaxis], self.force[:, np.newaxis])
        histories, nuisances = self.rows.white_histories(observed)[:, 0], self.rows.nuisances
        present = np.array([item.present for item in nuisances.items])
        for own, walks in zip(self.rows.of_flights, nuisances.flights, strict=True):
            if own.own_noise.size:
                shown = own.decorrelated(own.own_noise @ present[walks.walks][:, np.newaxis])[:, 0]
                for rows, part in zip(own.channels[:2], np.split(shown, 2), strict=True):
                    histories[rows] -= part
        return np.append(histories, nuisances.present)

    @cached_property
    def samples(self) -> int:
        """Real residuals less the constants of integration and the nuisances without a prior."""
        free = len(self.rows.nuisances.items) - self.rows.nuisances.bounded.size
        return 2 * self.rows.rates - 2 * len(self.rows.part.levels) - free

    def design(self, frame: RateFrame, columns: Sequence[Regressor]) -> FloatArray:
        """Whitened columns (rows, columns), projected like the response."""
        return self.rows.projected(self.raw_design(frame, columns))

    def raw_design(self, frame: RateFrame, columns: Sequence[Regressor]) -> FloatArray:
        """Whitened columns (rows, columns) as they are."""
        own = self.own_rows(frame, columns)
        out = np.zeros((self.rows.size, len(columns)))
        out[: own.shape[0]] = own
        return out

    def own_rows(self, frame: RateFrame, columns: Sequence[Regressor]) -> FloatArray:
        """The first rows of the raw design, where columns can be other than zero: rates, and force of given ones."""
        given = [j for j, column in enumerate(columns) if column.mechanism == GIVEN]
        if not given:
            return self._white_moments(frame, columns)
        others = [j for j, column in enumerate(columns) if column.mechanism != GIVEN]
        out = np.zeros((2 * self.rows.rates, len(columns)))
        if others:
            out[: self.rows.rates, others] = self._white_moments(frame, [columns[j] for j in others])
        out[:, given] = self.rows.white_histories(side_by_side([self.given[columns[j].term] for j in given]))
        return out

    def _white_moments(self, frame: RateFrame, columns: Sequence[Regressor]) -> FloatArray:
        """Rows of the rates, so many columns at once that their histories stay small."""
        out = np.empty((self.rows.rates, len(columns)))
        for some in self._batches(len(columns)):
            out[:, some] = self.rows.white_moments(frame.columns(columns[some]))
        return out

    def _batches(self, count: int) -> list[slice]:
        """So many columns at once that their histories stay small."""
        width = max(1, AT_ONCE // self.frame.observed.size)
        return [slice(first, first + width) for first in range(0, count, width)]

    def _rates(self, frame: RateFrame, columns: Sequence[Regressor], values: FloatArray) -> ComplexArray:
        """Rates (frame rows, ...) that moments with these coefficients (columns, ...) make."""
        out = np.zeros((frame.observed.size, *values.shape[1:]), dtype=complex)
        for some in self._batches(len(columns)):
            out += frame.columns(columns[some]) @ values[some]
        return out

    def whole_design(self, frame: RateFrame, columns: Sequence[Regressor]) -> FloatArray:
        """The columns as they are, and constants and nuisances after them (rows, columns + unknowns)."""
        return np.column_stack([self.raw_design(frame, columns), self.rows.nuisance_design])

    def on(self, part: Part) -> Problem:
        """The same columns and noise on another part of the record."""
        return replace(self, rows=replace(self.rows, part=part))

    def untied(self) -> Problem:
        """The same with the walk of the attitude independent of the rates' noise, so that rows may be left out."""
        return replace(self, rows=replace(self.rows, correlated=False))

    def under(self, noise: Noise) -> Problem:
        """The same under another noise."""
        return replace(self, rows=replace(self.rows, noise=noise))

    def solution(self, frame: RateFrame, columns: Sequence[Regressor]) -> tuple[FloatArray, FloatArray]:
        """Coefficients (columns,) and nuisances (unknowns,), fitted together."""
        design = self.raw_design(frame, columns)
        scale = lengths(design)
        found = np.linalg.lstsq(self.rows.projected(design) / scale, self.response, rcond=_CUTOFF)[0]
        values = np.asarray(found / scale, dtype=float)
        return values, self.others_beside(frame, columns, values)

    def others_beside(self, frame: RateFrame, columns: Sequence[Regressor], values: FloatArray) -> FloatArray:
        """Nuisances (unknowns,) that go with these coefficients (columns,)."""
        residual = self.raw_response - self.raw_design(frame, columns) @ values
        return self.rows.solved(residual)[2 * len(self.rows.part.levels) :]

    def left(self, frame: RateFrame, columns: Sequence[Regressor], values: FloatArray, others: FloatArray) -> Channels:
        """What coefficients and nuisances leave of rates (but for a constant a piece) and force (frame rows,). Several
        fits at once have a column each: values (columns, fits), histories (frame rows, fits).
        """
        moments = [j for j, column in enumerate(columns) if column.mechanism != GIVEN]
        given = [j for j, column in enumerate(columns) if column.mechanism == GIVEN]
        of_others = self.rows.nuisances.histories(others)
        observed, force = (each.reshape(-1, *(1,) * (values.ndim - 1)) for each in (self.frame.observed, self.force))
        rates = observed - self._rates(frame, [columns[j] for j in moments], values[moments])
        rates, force = rates - of_others.rates, force - of_others.force
        if given:
            more = side_by_side([self.given[columns[j].term] for j in given])
            rates, force = rates - more.rates @ values[given], force - more.force @ values[given]
        return Channels(rates, force)

    def efficiency_of(self, residual: FloatArray) -> float:
        """Effective over actual number of samples of a whitened residual (rows,), rows of priors left out."""
        n = self.rows.rates // 2
        channels = residual[: 4 * n].reshape(4, n)
        pieces = self.rows.part.thinned_pieces(self.rows.noise)
        return effective_samples([channel[a:b] for channel in channels for a, b in pieces]) / (4 * n)
