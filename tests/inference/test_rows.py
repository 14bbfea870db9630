"""Rows of flights: processes as the regression has the same moments and errors, nothing of what has no prior."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.linalg import block_diag

from brv_hypo.arrays import ComplexArray, FloatArray
from brv_hypo.comparison import CompareConfig
from brv_hypo.comparison.preparation import linearised_about, shared_problem
from brv_hypo.flight.record import Flight
from brv_hypo.inference import Rows, maximised, rows_of
from brv_hypo.inference.build import point_of
from brv_hypo.inference.fit import HypothesisFit, fit_hypothesis
from brv_hypo.inference.rows import SETTLING
from brv_hypo.mechanisms import Mechanism, MomentProcess, Term, registry, use_plugin_files
from brv_hypo.mechanisms.registry import moment_processes, record_processes, requested
from brv_hypo.model.reconstruction import reconstruct
from brv_hypo.model.term import Regressor, TimeBasis
from brv_hypo.motion.interpolation import time_splines
from brv_hypo.motion.motion import Motion
from tests.chains import judged_cone
from tests.flights import flown
from tests.inference.small import without_prior

PROCESSES = moment_processes()


def one_flight() -> Rows:
    """Of the research cone with a body-fixed moment."""
    return judged_cone("bodyfixed").rows


def of_baseline(*flights: Flight) -> Rows:
    """Rows about the baseline's fit."""
    config = CompareConfig(mechanisms=("damping",), knot_count=3)
    problem, chosen = shared_problem([reconstruct(flight) for flight in flights], config)
    fit = fit_hypothesis(problem, "none", ())
    whole, _ = linearised_about(problem, point_of(problem, fit), chosen, config)
    return rows_of(whole, fit)


@cache
def two_flights() -> Rows:
    """Of two short ones."""
    return of_baseline(*(flown("research_cone", *plant).flight.window(0.0, 2.5) for plant in ((), ("bodyfixed",))))


class OneHistory(Mechanism):
    """A shape of a process times one history in time, as a mechanism would have it."""

    name = "one_history"
    title = claims = source = "a moment for this test"

    process: MomentProcess
    shape: int
    coefficients: tuple[float, ...]
    start: float
    stop: float

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        history = time_splines(motion.time, self.start, self.stop, len(self.coefficients)) @ self.coefficients
        product = self.process.shapes(motion)[self.shape] * history
        return (Term("C", product.real.copy(), product.imag.copy()),)


def place_of(rows: Rows, name: str) -> int:
    return next(k for k, group in enumerate(rows.groups) if group.name == name)


@pytest.mark.parametrize("process", PROCESSES, ids=lambda process: process.name)
def test_rows_of_a_process_are_those_of_the_same_moment_in_the_regression(process: MomentProcess) -> None:
    """One unit of its amplitude is a history whose moment is as large as the static one."""
    rows = one_flight()
    (block,), (motion,), place = rows.blocks, rows.frame.motions, place_of(rows, process.name)
    shapes = np.array(process.shapes(motion))
    unit = rows.moment / np.sqrt(np.mean(np.abs(shapes) ** 2))
    coefficients = np.random.default_rng(1).standard_normal((len(shapes), process.splines))
    made = block.raw[:, block.columns[place]] @ coefficients.ravel()
    start, stop = float(motion.time[0]), float(motion.time[-1])
    fit = judged_cone("bodyfixed").leading.fit
    expected = np.zeros(rows.y.size)
    for shape, own in enumerate(coefficients):
        mechanism = OneHistory(process=process, shape=shape, coefficients=tuple(own), start=start, stop=stop)
        column = Regressor(mechanism.name, "C", (), TimeBasis("constant"), "1")
        frame = rows.frame_of(fit).with_mechanisms([mechanism])
        expected += unit * rows.problem.raw_design(frame, [column])[: rows.y.size, 0]
    assert made == pytest.approx(expected[block.rows], rel=1e-9, abs=1e-9 * float(np.abs(expected).max()))
    whitened = rows.whitened(expected[:, np.newaxis])[block.rows, 0]
    assert block.z[:, block.columns[place]] @ coefficients.ravel() == pytest.approx(
        whitened, rel=1e-6, abs=1e-6 * float(np.abs(whitened).max())
    )


@pytest.mark.parametrize(
    ("process", "channel", "tolerance", "component"),
    [
        ("gyro_drift", "p", "gyro_bias", "p"),
        ("gyro_drift", "q", "gyro_bias", "q"),
        ("accel_drift", "ay", "accel_bias", "y"),
        ("density_change", "dynamic_pressure", "dynamic_pressure_scale", "scale"),
    ],
)
def test_a_record_process_that_does_not_change_is_the_error_within_tolerance(
    process: str, channel: str, tolerance: str, component: str
) -> None:
    """Splines sum to one: all of a channel's together are its constant error, of another size."""
    rows = one_flight()
    items = rows.problem.rows.nuisances.items
    design = rows.problem.rows.nuisance_design[: rows.y.size, -len(items) :]
    (constant,) = (k for k, item in enumerate(items) if (item.name, item.component) == (tolerance, component))
    own = next(each for each in record_processes() if each.name == process)
    first = own.channels.index(channel) * own.splines
    columns = rows.blocks[0].raw[:, rows.blocks[0].columns[place_of(rows, process)]]
    expected = design[rows.blocks[0].rows, constant] * own.size / items[constant].size
    made = np.sum(columns[:, first : first + own.splines], axis=1)
    assert np.linalg.norm(made - expected) < 1e-6 * np.linalg.norm(expected)


@pytest.mark.parametrize("flights", [1, 2])
def test_what_has_no_prior_is_in_nothing(flights: int) -> None:
    rows = one_flight() if flights == 1 else two_flights()
    parts: list[FloatArray] = [rows.y[:, np.newaxis], rows.shared, rows.terms(None).x]
    if flights == 1:
        fits = judged_cone("bodyfixed").fits
        parts += [rows.terms(fit).x for fit in fits if fit.selected]
    for block in rows.blocks:
        z = np.zeros((rows.y.size, block.z.shape[1]))
        z[block.rows] = block.z
        parts.append(z)
    for part in parts:
        lengths = np.maximum(np.linalg.norm(part, axis=0), 1e-12)
        assert np.max(np.abs(without_prior(rows).T @ (part / lengths)), initial=0.0) < 1e-9
    assert rows.size == np.sum(rows.counted) - without_prior(rows).shape[1]
    assert np.sum(~rows.counted) == 4 * flights * SETTLING // rows.problem.rows.noise.thinning
    assert without_prior(rows).T @ without_prior(rows) == pytest.approx(np.eye(without_prior(rows).shape[1]), abs=1e-9)


def test_columns_of_the_baseline_are_orthonormal_and_their_coefficients_those_of_its_own() -> None:
    rows = two_flights()
    flat = rows.shared[:, np.isinf(rows.spread)]
    assert flat.T @ flat == pytest.approx(np.eye(flat.shape[1]), abs=1e-9)
    design = rows.of_moments(rows.frame, rows.problem.baseline)
    scale = np.linalg.norm(design, axis=0)
    assert design @ rows.coefficients == pytest.approx(flat, abs=1e-9)
    assert (design / scale).T @ flat @ flat.T @ (design / scale) == pytest.approx(
        (design / scale).T @ (design / scale), abs=1e-9
    )


@pytest.mark.parametrize("flights", [1, 2])
def test_errors_within_tolerances_are_noise(flights: int) -> None:
    """A unit of any of them is at most a unit of the whitened noise, and what is far from all is what it was."""
    rows = one_flight() if flights == 1 else two_flights()
    items, processes = rows.problem.rows.nuisances.items, {each.name for each in record_processes()}
    design = rows.problem.rows.nuisance_design[: rows.y.size, -len(items) :]
    for flight, block in enumerate(rows.blocks):
        mine = [
            k
            for k, item in enumerate(items)
            if item.flight == flight and np.isfinite(item.present) and item.name not in processes
        ]
        errors = rows.counted[:, np.newaxis] * design[:, mine]
        errors -= without_prior(rows) @ (without_prior(rows).T @ errors)
        own = errors[block.rows]
        assert np.all(np.linalg.norm(rows.whitened(errors), axis=0) <= 1.0 + 1e-9)
        given = np.random.default_rng(2).standard_normal((own.shape[0], 2))
        given -= block.own @ (block.own.T @ given)
        noise = np.eye(own.shape[0]) + own @ own.T
        expected = given.T @ np.linalg.solve(noise, given)
        lengths = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        found = block.whitened(given).T @ block.whitened(given)
        assert found / lengths == pytest.approx(expected / lengths, abs=1e-6)


def test_blocks_of_several_flights_are_disjoint_and_make_up_all_rows() -> None:
    rows = two_flights()
    assert len(rows.blocks) == 2
    assert sorted(np.concatenate([block.rows for block in rows.blocks])) == list(range(rows.y.size))
    for block in rows.blocks:
        assert block.z.shape[0] == block.rows.size
        assert len(block.columns) == len(rows.groups)
        assert [own.start for own in block.columns] == [0, *(own.stop for own in block.columns[:-1])]
        assert block.columns[-1].stop == block.z.shape[1]


def test_a_flights_errors_show_in_its_own_rows_alone() -> None:
    """Its histories are nothing in those of another, once what has no prior is projected out."""
    rows, problem = two_flights(), two_flights().problem
    items = problem.rows.nuisances.items
    design = problem.rows.nuisance_design[: rows.y.size, -len(items) :]
    for flight, block in enumerate(rows.blocks):
        mine = [k for k, item in enumerate(items) if item.flight == flight]
        elsewhere = np.setdiff1d(np.arange(rows.y.size), block.rows)
        assert mine
        outside = rows.whitened(design[:, mine])[elsewhere]
        assert np.max(np.abs(outside)) < 1e-9 * np.max(np.abs(design[:, mine]))


def test_stretches_of_time_are_of_one_flight() -> None:
    rows = two_flights()
    ones, others = (set(rows.time_blocks[block.rows]) for block in rows.blocks)
    assert ones.isdisjoint(others)
    assert len(ones) == len(others) > 1


def test_terms_are_scaled_and_what_knots_move_is_not() -> None:
    judged = judged_cone("bodyfixed")
    fit, rows = replace(judged.leading.fit, ends=False), judged.rows
    terms = rows.terms(fit)
    assert terms.x.shape == (rows.y.size, len(fit.selected) + len(fit.nonlinear))
    assert terms.scaled.tolist() == [True] * len(fit.selected) + [False] * len(fit.nonlinear)
    moments = rows.frame_of(fit).moments(fit.selected)
    sizes = np.sqrt(np.mean(np.abs(moments) ** 2, axis=0))
    assert terms.spread[terms.scaled] * sizes == pytest.approx(np.full(len(fit.selected), rows.moment))
    time = rows.frame.coefficient_time
    knots = [each.kind == "knot" for each in fit.nonlinear]
    assert any(knots)
    expected = float(time.max() - time.min()) / np.sqrt(12.0)
    assert terms.spread[~terms.scaled][knots] == pytest.approx(np.full(sum(knots), expected))


def test_a_mechanism_that_ends_is_one_that_acts_between_two_times() -> None:
    judged = judged_cone("bodyfixed")
    fit, rows = judged.leading.fit, judged.rows
    first = fit.selected[0].time_basis.start
    last = 0.5 * (first + float(rows.frame.coefficient_time.max()))
    components = {column.term: column for column in fit.selected}.values()

    def acting(*bases: TimeBasis, ends: bool = False) -> HypothesisFit:
        columns = tuple(column.at(column.theta, basis) for basis in bases for column in components)
        return replace(fit, columns=(*fit.columns[: fit.baseline_size], *columns), nonlinear=(), ends=ends)

    ended, between = (
        rows.terms(acting(TimeBasis("jump", first), TimeBasis("jump", last), ends=True)),
        rows.terms(acting(TimeBasis("jump", first, last))),
    )
    assert ended.acting.tolist() == [True] * len(components) + [False] * len(components)
    between = replace(between, spread=ended.spread[ended.acting])  # that of a moment that acts to the end
    found, expected = maximised(rows, ended), maximised(rows, between)
    assert found.level == pytest.approx(expected.level, abs=1e-3)
    assert found.share_of_terms == pytest.approx(expected.share_of_terms, rel=1e-5)
    changes, values = found.values[fit.baseline_size :], expected.values[fit.baseline_size :]
    assert changes == pytest.approx([*values, *-values], rel=1e-4)
    errors, sigmas = (np.sqrt(np.diag(each.covariance))[fit.baseline_size :] for each in (found, expected))
    assert errors == pytest.approx([*sigmas, *sigmas], rel=1e-4)


def test_the_baseline_has_no_terms() -> None:
    rows = two_flights()
    assert rows.terms(None).x.shape == (rows.y.size, 0)
    null = next(fit for fit in judged_cone("bodyfixed").fits if not fit.mechanisms)
    assert one_flight().terms(null).x.shape[1] == 0


# ---- What is requested ----

FOREIGN = '''
from collections.abc import Sequence

import numpy as np

from brv_hypo.mechanisms import MomentProcess, hookimpl


class FourLobes(MomentProcess):
    """Four lobes."""

    name, family, splines = "four_lobes", "harmonic", 4
    title = "moment of a four-lobed cross-section"

    def shapes(self, motion):
        """Cosine and sine."""
        turn = motion.alpha * np.exp(4j * motion.windward_meridian)
        return turn, 1j * turn


@hookimpl
def brv_hypo_mechanisms():
    return [FourLobes()]
'''


def again() -> Rows:
    """The rows of one flight with what is requested now."""
    judged = judged_cone("bodyfixed")
    return rows_of(judged.rows.problem, judged.leading.fit)


class FourLobes(MomentProcess):
    """A process of another distribution."""

    name, family, splines = "four_lobes", "harmonic", 4
    title = "moment of a four-lobed cross-section"

    def shapes(self, motion: Motion) -> Sequence[ComplexArray]:
        """Cosine and sine."""
        turn = motion.alpha * np.exp(4j * motion.windward_meridian)
        return turn, 1j * turn


def test_an_installed_process_that_was_not_requested_is_in_no_group(monkeypatch: pytest.MonkeyPatch) -> None:
    known = registry.installed()
    entry = replace(known["flow"], item=FourLobes(), package="somebody")
    monkeypatch.setattr(registry, "installed", lambda: {**known, "four_lobes": entry})
    own = {group.name for group in one_flight().groups}
    assert {group.name for group in again().groups} == own
    with requested(["four_lobes"]):
        on_request = again()
    assert {group.name for group in on_request.groups} == {*own, "four_lobes"}
    assert on_request.blocks[0].columns[place_of(on_request, "four_lobes")].stop > 0
    with requested(["four_lobes"], faulty=["four_lobes"]):
        assert {group.name for group in again().groups} == own


@pytest.mark.thorough
def test_a_process_of_a_file_that_was_named_is_in_every_comparison(tmp_path) -> None:
    path = tmp_path / "four_lobes.py"
    path.write_text(FOREIGN)
    use_plugin_files([path])
    assert "four_lobes" in {group.name for group in again().groups}


def test_errors_within_tolerances_are_those_of_the_normal_equations() -> None:
    """Of record and vehicle at once, given what baseline, mechanism and processes explain."""
    own = judged_cone("bodyfixed").leading.evidence
    (block,), nuisances = own.rows.blocks, own.rows.problem.rows.nuisances
    present = np.array([nuisances.items[k].present for k in block.items])
    top = own.rows.y.size
    design = own.rows.problem.rows.nuisance_design[:top, -len(nuisances.items) :][:, list(block.items)]
    errors = np.where(own.rows.counted[:, np.newaxis], design, 0.0)
    errors -= without_prior(own.rows) @ (without_prior(own.rows).T @ errors)
    whole = np.eye(top) + errors @ errors.T
    values, vectors = np.linalg.eigh(whole)
    unexplained = vectors @ (np.sqrt(values) * (vectors.T @ own.residual))
    expected = errors.T @ np.linalg.solve(whole, unexplained)
    assert own.errors[list(block.items)] - present == pytest.approx(expected, abs=1e-5)
    scale = np.repeat(np.exp(own.at[1 : 1 + len(own.rows.groups)]), [c.stop - c.start for c in block.columns])
    fitted = np.column_stack([own.rows.shared, own.terms.x, block.z * scale])
    together = np.column_stack([vectors @ (np.sqrt(values)[:, np.newaxis] * (vectors.T @ fitted)), errors])
    spread = np.concatenate([own.rows.spread, np.exp(own.at[-1] * own.terms.scaled) * own.terms.spread])
    priors = np.concatenate([spread**-2.0, np.ones(together.shape[1] - spread.size)])
    variances = own.noise**2 * np.diag(np.linalg.inv(together.T @ together + np.diag(priors)))
    assert own.error_sigmas[list(block.items)] == pytest.approx(np.sqrt(variances[-len(block.items) :]), rel=1e-3)


def test_errors_of_an_estimate_that_knows_no_processes_are_those_of_the_normal_equations() -> None:
    """Least squares of baseline, mechanism, record and vehicle at once, moved by every process of its size."""
    judged = judged_cone("bodyfixed")
    rows = judged.rows
    own = maximised(rows, rows.terms(replace(judged.leading.fit, ends=False)))
    (block,), nuisances = rows.blocks, rows.problem.rows.nuisances
    top, rank, terms = rows.y.size, rows.coefficients.shape[1], own.terms.known
    design = rows.problem.rows.nuisance_design[:top, -len(nuisances.items) :][:, list(block.items)]
    errors = np.where(rows.counted[:, np.newaxis], design, 0.0)
    errors -= without_prior(rows) @ (without_prior(rows).T @ errors)
    values, vectors = np.linalg.eigh(np.eye(top) + errors @ errors.T)
    scale = np.repeat(np.exp(own.at[1 : 1 + len(rows.groups)]), [c.stop - c.start for c in block.columns])
    white = np.column_stack([rows.shared, own.terms.x, block.z * scale])
    measured = vectors @ (np.sqrt(values)[:, np.newaxis] * (vectors.T @ white))
    fixed, made = measured[:, : -scale.size], measured[:, -scale.size :]
    together = np.column_stack([fixed, errors])
    priors = np.concatenate([rows.spread**-2.0, np.zeros(terms), np.ones(errors.shape[1])])
    moved = np.linalg.solve(together.T @ together + np.diag(priors), together.T @ made)
    added, variances = own.errors_of_processes
    chosen = [*range(rank), *range(rows.spread.size, rows.spread.size + terms)]
    makes = block_diag(rows.coefficients, np.eye(terms)) @ moved[chosen]
    expected = own.noise**2 * makes @ makes.T
    scales = np.sqrt(np.diag(expected))
    assert added / np.outer(scales, scales) == pytest.approx(expected / np.outer(scales, scales), abs=1e-4)
    sizes = own.noise * np.linalg.norm(moved[-errors.shape[1] :], axis=1)
    assert np.sqrt(variances[list(block.items)]) == pytest.approx(sizes, rel=1e-3, abs=1e-6)
