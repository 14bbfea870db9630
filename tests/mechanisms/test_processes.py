"""Processes: smooth time histories of moments and channels, which every hypothesis has; their contract."""

from __future__ import annotations

import contextlib
import json
import re
import sys
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from brv_hypo.comparison import compare
from brv_hypo.errors import MechanismError, UsageError
from brv_hypo.flight.record import CHANNELS, Flight
from brv_hypo.mechanisms import (
    MomentProcess,
    Parameter,
    RecordProcess,
    find,
    installed,
    mechanisms,
    parse_hypothesis,
    record_effects,
    registry,
    use_plugin_files,
)
from brv_hypo.mechanisms.checked import is_checked
from brv_hypo.mechanisms.conformance import conformance, sample_flight, sample_motion, uniform_time
from brv_hypo.mechanisms.contract import FAMILIES
from brv_hypo.motion.interpolation import time_splines
from brv_hypo.testing import check_mechanism
from tests.cli.conftest import brv_hypo
from tests.flights import nominal
from tests.mechanisms.test_registry import plugin
from tests.studies.independent.flights import make_flight, stream
from tests.studies.independent.imperfections import ordinary

__all__ = ["brv_hypo"]

OF_MOMENTS = [entry.item for entry in installed().values() if isinstance(entry.item, MomentProcess)]
OF_RECORDS = [entry.item for entry in installed().values() if isinstance(entry.item, RecordProcess)]
COUNTS = st.one_of(st.just(1), st.integers(4, 40))
STARTS = st.floats(-1e3, 1e3)
LENGTHS = st.floats(1e-2, 1e4)


# ---- The splines ----


@given(COUNTS, STARTS, LENGTHS)
def test_splines_sum_to_one_and_keep_their_ends_outside(count, start, length):
    stop = start + length
    time = np.linspace(start - length, stop + length, 61)
    found = time_splines(time, start, stop, count)
    assert found.shape == (61, count)
    np.testing.assert_allclose(found.sum(axis=-1), 1.0, rtol=1e-12)
    assert np.all(found >= 0.0)
    ends = time_splines(np.array([start, stop]), start, stop, count)
    np.testing.assert_array_equal(found[time < start], np.broadcast_to(ends[0], found[time < start].shape))
    np.testing.assert_array_equal(found[time > stop], np.broadcast_to(ends[1], found[time > stop].shape))


@given(st.integers(5, 40), STARTS, LENGTHS)
def test_splines_are_even(count, start, length):
    """Read backwards they are the same; one interval on, the next is what the one before was."""
    time, step = np.linspace(start, start + length, 97), length / (count - 3)
    found = time_splines(time, start, start + length, count)
    np.testing.assert_allclose(found, found[::-1, ::-1], atol=1e-6)
    inside = time < start + length - 1.001 * step
    later = time_splines(time[inside] + step, start, start + length, count)
    np.testing.assert_allclose(later[:, 1:], found[inside, :-1], atol=1e-6)


@pytest.mark.parametrize("shape", [(6,), (1,), (5, 1), (3, 2)])
def test_splines_follow_the_shape_of_time(shape):
    time = np.linspace(0.0, 1.0, int(np.prod(shape)))
    flat = time_splines(time, 0.0, 1.0, 7)
    np.testing.assert_array_equal(time_splines(time.reshape(shape), 0.0, 1.0, 7), flat.reshape(*shape, 7))


# ---- Their terms, and their errors of the record ----


def test_all_are_there_with_a_family():
    assert {process.name for process in OF_MOMENTS} >= {"static_change", "damping_change", "body_change", "flow"}
    assert {process.name for process in OF_RECORDS} >= {"gyro_drift", "accel_drift", "density_change", "turbulence"}
    assert {process.family for process in (*OF_MOMENTS, *OF_RECORDS)} <= set(FAMILIES)


@pytest.mark.parametrize("process", OF_MOMENTS, ids=lambda process: process.name)
@settings(max_examples=10)
@given(st.floats(-2.0, 3.0), st.floats(0.5, 9.0))
def test_terms_are_shapes_times_splines(process, start, length):
    made = process.model_copy(update={"start": start, "stop": start + length})
    motion = sample_motion(uniform_time(80))
    splines = time_splines(motion.time, start, start + length, process.splines)
    terms, shapes = made.terms(motion, {}), process.shapes(motion)
    assert len({term.name for term in terms}) == len(terms) == len(shapes) * process.splines
    assert not any("." in term.name for term in terms), "variations of a simulation part a path at its dots"
    columns = np.array([term.in_plane + 1j * term.out_of_plane for term in terms]).reshape(len(shapes), -1, 80)
    np.testing.assert_allclose(columns, np.array(shapes)[:, np.newaxis] * splines.T, rtol=1e-12, atol=0.0)
    np.testing.assert_allclose(columns.sum(axis=1), shapes, rtol=1e-12)


def change(process: RecordProcess, component: str, value: float) -> np.ndarray:
    """What the process does to the channels and the wind, over what they are in the sample."""
    flight: Flight = sample_flight()
    found = process.perturb(flight, component, value)
    wind = np.zeros((3, flight.samples)) if found.wind is None else found.wind.T
    return np.array([*(getattr(found, name) - getattr(flight, name) for name in CHANNELS), *wind])


@pytest.mark.parametrize("process", OF_RECORDS, ids=lambda process: process.name)
@settings(max_examples=8)
@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.integers(0, 10**6))
def test_perturbing_is_linear(process, one, other, chosen):
    components = process.components(sample_flight())
    name, _, size = components[chosen % len(components)]
    together = change(process, name, (one + other) * size)
    apart = change(process, name, one * size) + change(process, name, other * size)
    np.testing.assert_allclose(together, apart, atol=1e-9 * np.max(np.abs(change(process, name, size))))


@pytest.mark.parametrize("process", OF_RECORDS, ids=lambda process: process.name)
def test_all_splines_of_a_channel_together_are_a_constant_error(process):
    flight = sample_flight()
    for channel in process.channels:
        changed = flight
        for component in process.components(flight):
            if component.name.startswith(f"{channel} "):
                changed = process.perturb(changed, component.name, process.size)
        whole = process.changed(flight, channel, np.full(flight.samples, process.size))
        for name in CHANNELS:
            # A share of a channel compounds: its square counts where the size is 2 %.
            np.testing.assert_allclose(getattr(changed, name), getattr(whole, name), rtol=process.size**2, atol=1e-12)
        if whole.wind is not None:
            np.testing.assert_allclose(changed.wind, whole.wind, atol=1e-9)


# ---- The conformance kit ----


class Sound(MomentProcess):
    """A moment of a four-lobed cross-section."""

    name, family, splines = "four_lobes", "harmonic", 6
    title = "moment of a four-lobed cross-section"

    def shapes(self, motion):
        """Two, a quarter of a lobe apart."""
        turn = motion.alpha * np.exp(4j * motion.windward_meridian)
        return turn, 1j * turn


class SoundDrift(RecordProcess):
    """A drift of the speed."""

    name, family, kind = "speed_drift", "data quality", "instrument"
    title = "drift of the speed"
    channels, splines, units, size = ("velocity",), 5, "m/s", 2.0

    def changed(self, flight, channel, history):
        """That much faster."""
        return replace(flight, velocity=flight.velocity + history)


SET_BY_DRIFT = {"name", "family", "kind", "title", "channels", "splines", "units", "size", "changed"}


def bad(base, **parts):
    """A class like `base`, with other parts."""
    return type("Bad", (base,), {"__doc__": "Broken.", "__module__": __name__, **parts})


def without(attribute):
    """The drift of the speed, but for one of its attributes."""
    parts = {name: value for name, value in vars(SoundDrift).items() if name in SET_BY_DRIFT - {attribute}}
    return type("Bad", (RecordProcess,), {"__doc__": "Broken.", "__module__": __name__, **parts})


BREACHES = {
    "no family": (bad(Sound, family="whatever"), "`family` is 'whatever', expected one of stiffness"),
    "three splines": (bad(Sound, splines=3), "`splines` is 3"),
    "splines in parts": (bad(Sound, splines=5.5), "`splines` is 5.5"),
    "a tolerance": (bad(Sound, tolerance=lambda self, flight: (0.1,) * 12), "its size is estimated"),
    "a parameter": (
        bad(Sound, parameters=lambda self: (Parameter("n", "1", (1.0,), (0.5, 2.0), "lobes"),)),
        "a process is linear",
    ),
    "a number for a shape": (bad(Sound, shapes=lambda self, motion: (1.0 + 0j,)), r"of shape \(\)|have the shapes"),
    "no shape": (bad(Sound, shapes=lambda self, motion: ()), "have the shapes|`terms` gave"),
    "not finite": (bad(Sound, shapes=lambda self, motion: (motion.alpha * (np.nan + 0j),)), "not finite"),
    "terms of its own": (
        bad(Sound, terms=lambda self, motion, theta: MomentProcess.terms(self, motion, theta)[::-1]),
        "write `shapes`, and no `terms`",
    ),
    "another kind": (bad(Sound, kind="mechanism"), "`kind` is 'mechanism', expected one of .*process"),
    "nuisance": (bad(SoundDrift, carried=True), "`carried` is True"),
    "no family of the record": (bad(SoundDrift, family=""), "`family` is ''"),
    "no splines": (bad(SoundDrift, splines=0), "`splines` is 0"),
    "no size": (bad(SoundDrift, size=0.0), "typical size is 0"),
    **{f"without {name}": (without(name), f"`{name}` is missing: set it") for name in ("channels", "units", "size")},
    "no change": (bad(SoundDrift, changed=lambda self, flight, channel, history: flight), "changes nothing"),
    "not linear": (
        bad(
            SoundDrift,
            changed=lambda self, flight, channel, history: replace(flight, velocity=flight.velocity + history**2),
        ),
        "departs from linear",
    ),
}  # fmt: skip


@pytest.mark.parametrize("sound", [Sound(), SoundDrift()], ids=["moment", "record"])
def test_a_sound_process_passes(sound):
    outcomes = conformance(sound)
    assert [outcome for outcome in outcomes if not outcome.passed] == []
    assert {"has_a_family_and_splines", "has_an_estimated_size"} <= {outcome.check for outcome in outcomes}


def test_a_sound_process_needs_no_fit_to_be_checked():
    check_mechanism(Sound())


@pytest.mark.parametrize("how", BREACHES)
def test_each_breach_has_a_reason_in_words(how):
    kind, says = BREACHES[how]
    failed = {outcome.check: outcome.detail for outcome in conformance(kind()) if not outcome.passed}
    assert any(re.search(says, detail) for detail in failed.values()), failed


@pytest.mark.parametrize("how", BREACHES)
def test_a_foreign_process_with_a_breach_is_left_out_with_that_reason(how):
    kind, says = BREACHES[how]
    with pytest.raises(MechanismError, match=says):
        registry._check(kind(), "stranger", "strangers")


# ---- A process of another distribution: one file ----


FOREIGN = """
from dataclasses import replace
import numpy as np
from brv_hypo.mechanisms import MomentProcess, RecordProcess

class FourLobes(MomentProcess):
    "A moment of a four-lobed cross-section."
    name, family, splines = "four_lobes", "harmonic", {splines}
    title = "moment of a four-lobed cross-section"

    def shapes(self, motion):
        {early}
        return (motion.alpha * np.exp(4j * motion.windward_meridian),)

class SpeedDrift(RecordProcess):
    "A drift of the speed."
    name, family, kind = "speed_drift", "data quality", "instrument"
    title = "drift of the speed"
    channels, splines, units, size = ("velocity",), 5, "m/s", 2.0

    def changed(self, flight, channel, history):
        return replace(flight, velocity=flight.velocity + history)

def brv_hypo_mechanisms():
    return [FourLobes()]

def brv_hypo_record_effects():
    return [SpeedDrift()]
"""
NAMES = {"four_lobes", "speed_drift"}


def written(folder, **parts):
    path = folder / "lobes.py"
    path.write_text(FOREIGN.format(**{"splines": 6, "early": "pass", **parts}))
    return path


@pytest.fixture(autouse=True)
def _no_plugin_files_afterwards():
    yield
    use_plugin_files(())


@pytest.fixture
def distribution(tmp_path, monkeypatch):
    """A distribution that is installed and has two processes."""
    with monkeypatch.context() as patch:
        plugin(tmp_path, "lobes", written(tmp_path).read_text())
        patch.syspath_prepend(tmp_path)
        use_plugin_files(())
        yield
    sys.modules.pop("lobes", None)


def in_every_hypothesis() -> set[str]:
    return {item.name for item in (*registry.moment_processes(), *registry.record_processes())}


OWN = in_every_hypothesis()


QUICK = {"maximum_likelihood": "none", "max_terms": 2, "exact_terms": 2, "knot_count": 3, "refine": False}


class _Enough(Exception):  # noqa: N818 - no error: what was requested is known
    """The comparison has begun."""


def in_comparison(*names: str) -> set[str]:
    """The processes that are in every hypothesis once a comparison with these mechanisms has begun."""
    found: set[str] = set()

    def say(fraction: float | None, message: str) -> None:
        if message != "checking the record":
            found.update(in_every_hypothesis())
            raise _Enough

    with contextlib.suppress(_Enough):
        compare(nominal().flight, {"mechanisms": list(names)}, progress=say)
    return found


def test_a_file_is_enough(tmp_path):
    assert not NAMES & OWN
    use_plugin_files([written(tmp_path)])
    assert in_every_hypothesis() == OWN | NAMES
    assert in_comparison("bodyfixed") == OWN | NAMES


def test_an_installed_effect_that_was_not_requested_is_in_no_hypothesis(distribution):
    assert set(installed()) > NAMES
    assert in_every_hypothesis() == OWN == in_comparison("bodyfixed")
    with registry.requested({"four_lobes"}):
        assert in_every_hypothesis() == OWN | {"four_lobes"}
    with registry.requested(NAMES, faulty={"four_lobes"}):
        assert in_every_hypothesis() == OWN | {"speed_drift"}


def test_its_name_in_the_comparison_is_enough(distribution):
    assert in_comparison("bodyfixed", "four_lobes") == OWN | {"four_lobes"}
    assert in_comparison("bodyfixed", *NAMES) == OWN | NAMES


@pytest.mark.parametrize("names", [("four_lobes",), ("gyro_bias", "speed_drift")])
def test_names_of_which_none_is_a_hypothesis_are_refused(distribution, names):
    with pytest.raises(UsageError, match=f"every hypothesis has {', '.join(names)}.*Name mechanisms too"):
        compare(nominal().flight, mechanisms=names)


@pytest.mark.thorough
def test_the_verdict_has_it_without_a_hypothesis_of_its_own(distribution):
    found = compare(nominal().flight, QUICK | {"mechanisms": ["bodyfixed", *NAMES]})
    assert {row.mechanism for row in found.ranking} == {"none", "bodyfixed"}
    assert {process.name for process in found.verdict.processes} == OWN | NAMES
    unasked = compare(nominal().flight, QUICK | {"mechanisms": ["bodyfixed"]})
    assert {process.name for process in unasked.verdict.processes} == OWN


@pytest.mark.thorough
def test_one_that_breaks_on_the_flight_is_named_and_the_other_used(tmp_path):
    """The kit's sample motions have 600 samples at most: there it is sound."""
    use_plugin_files([written(tmp_path, early="assert motion.time.size <= 600")])
    found = compare(nominal().flight, QUICK | {"mechanisms": ["bodyfixed"]})
    assert {process.name for process in found.verdict.processes} == OWN | {"speed_drift"}
    (reason,) = (text for text in found.warnings if "four_lobes" in text)
    assert "AssertionError" in reason
    assert f"{tmp_path}/lobes.py, line" in reason


def test_it_is_neither_a_mechanism_nor_an_effect_to_try(tmp_path):
    use_plugin_files([written(tmp_path)])
    names = {item.name for kind in ("mechanism", "aerodynamic") for item in mechanisms(kind)}
    assert not (names | {effect.name for effect in record_effects()}) & (NAMES | OWN)
    with pytest.raises(UsageError, match="names a process"):
        parse_hypothesis("lag+four_lobes")


def test_a_foreign_process_is_checked_and_so_is_its_copy(tmp_path):
    use_plugin_files([written(tmp_path, early="assert motion.time.size < 700")])
    assert set(installed()) > NAMES
    made = find("four_lobes", {"start": 0.0, "stop": 6.0})
    for process in (made, made.model_copy(update={"stop": 9.0})):
        assert isinstance(process, MomentProcess)
        assert is_checked(process)
        assert len(process.terms(sample_motion(uniform_time()), {})) == 6
        for method in (process.shapes, lambda motion, process=process: process.terms(motion, {})):
            with pytest.raises(MechanismError, match=r"'four_lobes' of .*lobes.py.* breaks its contract"):
                method(sample_motion(uniform_time(800)))
    assert made.model_copy(update={"stop": 9.0}).stop == 9.0


class _NotAlways(Sound):
    """Not finite late in the motion."""

    name: ClassVar[str] = "not_always"

    def shapes(self, motion):
        """One that ends."""
        return (np.where(motion.time < 5.0, 1.0, np.nan) * motion.alpha * 1j,)


def test_shapes_that_are_not_finite_are_said():
    from brv_hypo.mechanisms.checked import checked

    early, whole = sample_motion(0.5 * uniform_time()), sample_motion(uniform_time())
    assert len(checked(_NotAlways()).shapes(early)) == 1
    with pytest.raises(MechanismError, match=r"C_m,in of `shapes\(...\)\[0\]` with 100 values that are not finite"):
        checked(_NotAlways()).shapes(whole)


def test_a_file_of_which_one_breaks_its_contract_is_refused(tmp_path):
    path = written(tmp_path, splines=3)
    with pytest.raises(MechanismError, match="`splines` is 3, expected 1, a constant, or at least 4") as refusal:
        use_plugin_files([path])
    assert "'four_lobes' of" in str(refusal.value)
    assert f"{path}, line" in str(refusal.value)


@pytest.mark.parametrize("name", sorted(NAMES | {"flow", "turbulence"}))
def test_the_commands_know_it(brv_hypo, tmp_path, name):
    path = written(tmp_path)
    done = brv_hypo("mechanisms", "check", name, "--plugin", path)
    assert done.returncode == 0, done.stderr
    assert "checks." in done.stdout
    listed = json.loads(brv_hypo("mechanisms", "--plugin", path, "--json", "-").stdout)["mechanisms"]
    (entry,) = (entry for entry in listed if entry["name"] == name)
    assert entry["family"] in FAMILIES
    lines = brv_hypo("mechanisms", "--plugin", path, cwd=tmp_path, COLUMNS="200").stdout.splitlines()
    (row,) = (number for number, line in enumerate(lines) if line.startswith(f"{name} "))
    assert f"process  {entry['family']}: {entry['title']}" in " ".join(lines[row].split()).replace(
        "process ", "process  "
    )
    assert (f"package: {path}" in lines[row + 1]) == (name in NAMES)


def test_a_file_of_a_breach_is_refused_in_words(brv_hypo, tmp_path):
    done = brv_hypo("mechanisms", "check", "four_lobes", "--plugin", written(tmp_path, splines=2))
    assert done.returncode == 2
    assert "`splines` is 2" in done.stderr


def test_options_of_a_process_are_those_of_the_comparison(distribution):
    """Of its own fields, checked; of what no hypothesis has they are refused."""
    with registry.requested((), options={"flow": {"stop": 7.0}}):
        assert {each.name: each.stop for each in registry.moment_processes()}["flow"] == 7.0
    for options, said in (
        ({"flow": {"rate": 1.0}}, "bad options for 'flow': 'rate' is not a known key"),
        ({"four_lobes": {"stop": 7.0}}, "'four_lobes', which is not compared"),
    ):
        with pytest.raises(UsageError, match=said):
            compare("nothing.h5", mechanisms=["lag"], options=options)
    with pytest.raises(UsageError, match=r"delay of 1e.09 s, expected less than the record, .* s\. Leave out"):
        compare(nominal().flight, mechanisms=["lag"], options={"lag": {"delays": [0.1, 1e9]}})


LOW = '''
import numpy as np
from brv_hypo.mechanisms import MomentProcess, hookimpl


class Low(MomentProcess):
    """A moment at Mach 2."""

    name, title, family, splines = "low", "moment at Mach 2", "body", 1

    def shapes(self, motion):
        """A bump."""
        return (np.exp(-(((motion.mach - 2.0) / 0.5) ** 2)) * np.exp(1j * motion.windward_meridian),)


@hookimpl
def brv_hypo_mechanisms():
    return [Low()]
'''


@pytest.mark.thorough
def test_one_that_is_nothing_on_a_flight_is_sound_and_estimated_as_nothing(tmp_path):
    """The whole comparison failed at its charts."""
    path = tmp_path / "low.py"
    path.write_text(LOW)
    use_plugin_files([path])
    try:
        check_mechanism(find("low"))
        found = compare(nominal().flight.window(0.0, 3.0), mechanisms=["damping"], maximum_likelihood="none")
    finally:
        use_plugin_files(())
    (own,) = (each for each in found.verdict.processes if each.name == "low")
    assert own.size == 0.0
    assert all(np.all(np.isfinite(each.at_flown)) for one in found.functions.values() for each in one)


@pytest.mark.thorough
def test_unequal_moments_of_inertia_are_a_process_of_their_size() -> None:
    """Their coefficient is J = (Iz - Iy) / (2 S d), Pa s^2, of which Euler's equations make C_m and C_n."""
    made = make_flight("cone", "none", seed=7, duration=3.0, imperfect=("inertia_asymmetry",), imperfect_size=4.0)
    vehicle, drawn = made.flight.vehicle, stream(7, "imperfections")
    asymmetry = ordinary(made.true.craft, ("inertia_asymmetry",), drawn, 4.0).inertia_asymmetry
    found = compare(made.flight, mechanisms=["bodyfixed"], maximum_likelihood="none").verdict
    (own,) = (each for each in found.processes if each.name == "unequal_inertia")
    expected = -0.5 * asymmetry * vehicle.iyy / (vehicle.reference_area * vehicle.reference_length)
    assert found.winner == "none"
    assert own.planted["unequal_inertia 0 0"] == pytest.approx(expected, rel=0.05)
    assert abs(own.planted["unequal_inertia 1 0"]) < 0.05 * abs(expected)
