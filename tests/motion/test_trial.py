"""The data compatibility check: sound records pass, and a mistake of sign, axis or unit is named with its channel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from brv_hypo import compare
from brv_hypo.errors import UnanswerableError
from brv_hypo.flight import load_flight
from brv_hypo.flight.format import assemble, unassemble
from brv_hypo.flight.record import RecordFault
from brv_hypo.motion import try_record
from tests.motion.truth import CAPSULE, CONE, SLENDER, fly, observe, thinned
from tests.shared_data import shared_file
from tests.studies.independent.flights import draw_flight
from tests.studies.independent.imperfect_study import drawn_flight

DEGREES, GRAVITY, FEET, RPM, PSI_IN_KPA = 180.0 / np.pi, 9.80665, 0.3048, 6.0, 6.894757
THOROUGH = pytest.mark.thorough
TACTICAL = {"gyro_bias": (3.5e-4, -3.5e-4, 3.5e-4), "accel_bias": (0.01, 0.01, -0.01)}


@pytest.fixture(scope="module")
def flights():
    truths = (fly(CONE), thinned(fly(CAPSULE), 2), thinned(fly(SLENDER), 2))
    return {truth.scenario.name: observe(truth, 3, **TACTICAL) for truth in truths}


def scaled(flight, factor, *names):
    return replace(flight, **{name: factor * getattr(flight, name) for name in names})


@pytest.mark.parametrize("name", ["cone", "capsule", "slender"])
def test_a_sound_record_is_sound_and_not_changed(flights, name):
    kept, trial = try_record(flights[name])
    assert kept is flights[name]
    assert trial.sound
    assert trial.faults == ()


@pytest.mark.thorough
@pytest.mark.parametrize("roll_rate", [0.2, 20.0])
def test_slow_and_fast_roll_raise_no_alarm(roll_rate):
    assert try_record(observe(fly(replace(CONE, roll_rate=roll_rate)), 1))[1].sound


@pytest.mark.parametrize(
    ("corrupt", "channel", "fault"),
    [
        *(
            pytest.param(lambda f, n=n: scaled(f, -1.0, n), n, "sign", marks=() if n == "q" else THOROUGH)
            for n in ("p", "q", "r", "ax", "ay", "az")
        ),
        pytest.param(lambda f: replace(f, q=f.r, r=f.q), "q, r", "axes", marks=THOROUGH),
        pytest.param(lambda f: replace(f, ay=f.az, az=f.ay), "ay, az", "axes", marks=THOROUGH),
        pytest.param(lambda f: scaled(f, DEGREES, "q"), "q", "units", marks=THOROUGH),
        pytest.param(lambda f: scaled(f, 1.0 / DEGREES, "p", "q", "r"), "p, q, r", "units", marks=THOROUGH),
        pytest.param(lambda f: scaled(f, 1.0 / GRAVITY, "ax", "ay", "az"), "ax, ay, az", "units", marks=THOROUGH),
        (lambda f: scaled(f, GRAVITY, "ay"), "ay", "units"),
        (lambda f: scaled(f, 1.0 / RPM, "q"), "q", "units"),
        pytest.param(lambda f: scaled(f, RPM, "p", "q", "r"), "p, q, r", "units", marks=THOROUGH),
        pytest.param(
            lambda f: scaled(f, 1.0 / PSI_IN_KPA, "dynamic_pressure"), "dynamic_pressure", "units", marks=THOROUGH
        ),
        pytest.param(lambda f: scaled(f, 1.0 / FEET, "velocity"), "velocity", "units", marks=THOROUGH),
    ],
)
def test_a_mistake_is_named_with_its_channel(flights, corrupt, channel, fault):
    trial = try_record(corrupt(flights["slender"]))[1]
    assert not trial.sound
    assert [(one.channel, one.fault, one.decisive) for one in trial.faults] == [(channel, fault, True)]
    assert "correct the map" in trial.faults[0].action


@pytest.mark.parametrize(
    ("factors", "missing", "channel"),
    [
        ({"velocity": 1.0 / FEET}, ("altitude",), "velocity"),
        ({"velocity": 1.0 / FEET}, ("dynamic_pressure",), "velocity"),
        ({"velocity": 3600.0 / 1852.0}, (), "velocity"),
        ({"dynamic_pressure": 1.0 / 47.88026}, ("altitude",), "dynamic_pressure"),
    ],
)
def test_air_data_that_follow_from_the_speed_are_no_witness_of_its_units(flights, factors, missing, channel):
    """Without altitude the density follows from a wrong speed: the accelerometers were blamed for it."""
    record = unassemble(flights["cone"])
    left_out = {*missing, "density", "mach", "reynolds"}
    channels = {name: factors.get(name, 1.0) * each for name, each in record.channels.items() if name not in left_out}
    trial = try_record(assemble(record.model_copy(update={"channels": channels, "notes": ()})))[1]
    assert channel in {one.channel for one in trial.faults if one.decisive}
    assert not any(one.channel in ("ax", "ax, ay, az") for one in trial.faults)


def test_a_drag_of_no_body_names_the_units_of_pressure_that_would_make_it_usual(flights):
    wrong = scaled(flights["capsule"], 1.0 / 47.88026, "dynamic_pressure")
    said = [one.action for one in try_record(wrong)[1].faults if one.channel == "ax, dynamic_pressure"]
    assert len(said) == 1
    assert "it is usual if the pressure is in lbf/ft^2, tagged Pa" in said[0]


def test_forces_in_other_units_turn_no_unit():
    """In g, tagged m/s^2, what the lever arm makes of the rates leaned the nose by four degrees."""
    flight = drawn_flight(1092000, 0, "tactical", "one")[0].flight
    faults = try_record(scaled(flight, GRAVITY, "ax", "ay", "az"))[1].faults
    assert [(one.channel, one.fault) for one in faults] == [("ax, ay, az", "units")]


def test_the_nose_is_known_no_better_than_the_place_of_the_accelerometers():
    """At 30 rad/s the 5 mm of an industrial unit make a sixth of the drag across the axis."""
    flight = drawn_flight(1262004, 4, "industrial", "one", drawn=True)[0].flight
    assert try_record(flight)[1].sound
    better = replace(flight, instruments=drawn_flight(1262004, 4, "tactical", "tolerances")[0].flight.instruments)
    assert [one.fault for one in try_record(better)[1].faults] == ["mounting"]


def test_a_speed_that_its_mach_number_contradicts_is_named(flights):
    """In knots, without altitude: nothing else shows that."""
    flight = flights["cone"]
    flight = replace(flight, altitude=None, mach=flight.velocity / 300.0)
    assert try_record(flight)[1].sound
    faults = try_record(scaled(flight, 3600.0 / 1852.0, "velocity"))[1].faults
    assert ("velocity, mach", "units", True) in [(one.channel, one.fault, one.decisive) for one in faults]


@pytest.mark.parametrize("turns", [pytest.param(0.5, marks=THOROUGH), 1.0, pytest.param(2.0, marks=THOROUGH)])
@pytest.mark.parametrize("phase", [0.0, *(pytest.param(phase, marks=pytest.mark.slow) for phase in (2.0, 4.0))])
@pytest.mark.parametrize("name", ["slender", pytest.param("cone", marks=THOROUGH)])
def test_wind_along_the_path_raises_no_alarm(flights, name, turns, phase):
    """Airspeed shows a slow wind as a deceleration that is not sensed."""
    flight = flights[name]
    wind = 6.0 * np.sin(2.0 * np.pi * turns * (flight.time - flight.time[0]) / np.ptp(flight.time) + phase)
    assert try_record(replace(flight, velocity=flight.velocity + wind))[1].sound


@pytest.mark.thorough
def test_a_body_that_tumbles_breaks_no_relation_of_small_angles():
    """Drag grew 16-fold as it turned; "the sign of az", or feet, seemed to explain the rest."""
    tumbling = drawn_flight(906023, 23, "tactical", "one")[0].flight
    assert try_record(tumbling)[1].faults == ()
    with pytest.raises(UnanswerableError, match=r"the vehicle tumbles.*--stop"):
        compare(tumbling, mechanisms=["damping"], maximum_likelihood="none")


def test_a_spin_that_goes_with_the_crossflow_turns_no_unit():
    """Forces beside a c.g. off the axis drive the roll: the mean spin leans by 7 deg, the nose by nothing."""
    assert try_record(draw_flight(1700, vehicle="biconic", truth="none", grade="industrial").flight)[1].faults == ()


@pytest.mark.thorough
def test_isolated_spikes_never_decide(flights):
    rng, flight = np.random.default_rng(5), flights["cone"]
    wrong = {name: getattr(flight, name).copy() for name in ("p", "q", "r", "ax", "ay", "az")}
    for values in wrong.values():
        values[rng.choice(flight.samples, flight.samples // 200, replace=False)] += 100.0 * np.std(values)
    trial = try_record(replace(flight, **wrong))[1]
    assert trial.faults
    assert not any(fault.decisive for fault in trial.faults)


def test_a_flight_of_which_nothing_can_be_used_is_reported(flights):
    flight = flights["cone"]
    kept, trial = try_record(replace(flight, q=np.full(flight.samples, np.nan)))
    assert kept.samples == flight.samples
    assert [(one.channel, one.fault, one.decisive) for one in trial.faults] == [("record", "unusable", True)]


def test_a_window_too_short_for_any_record_counts_as_sound(flights):
    kept, trial = try_record(flights["cone"].window(None, flights["cone"].time[7]))
    assert (kept.samples, trial.sound, trial.faults) == (8, True, ())


def test_noise_in_place_of_forces_raises_no_alarm(flights):
    rng = np.random.default_rng(4)
    flight = flights["cone"]
    noisy = {name: 40.0 * rng.standard_normal(flight.samples) for name in ("ay", "az")}
    assert try_record(replace(flight, **noisy))[1].sound


def test_a_stuck_gyro_ends_a_segment(flights):
    flight = flights["cone"]
    q = flight.q.copy()
    q[500:540] = q[500]
    kept, trial = try_record(replace(flight, q=q))
    assert trial.sound
    assert [(one.channel, one.fault) for one in trial.faults] == [("q", "stuck")]
    assert kept.segments == ((0, 500), (540, flight.samples))


@pytest.mark.shared
@pytest.mark.parametrize(("start", "stop"), [(None, None), (1030.0, 1100.0), (1060.0, 1150.0)])
def test_the_measured_entry_of_opportunity_is_sound(start, stop):
    flight = load_flight(shared_file("data/opportunity/opportunity_entry.h5"), start=start, stop=stop)
    assert try_record(flight)[1].sound


def test_a_window_too_short_to_try_is_no_fault_of_the_record(flights):
    """The record is valid; that its window cannot answer is no fault of it."""
    window = next(iter(flights.values())).window(100.0, 100.01)
    tried, trial = try_record(window)
    assert tried is window
    assert trial.sound
    assert trial.faults == ()


def test_a_comparison_is_refused_by_the_flight_that_is_at_fault_and_its_fault(flights):
    """Of the first flight only a spike is masked; what may be done is said once, by the command that has the option."""
    spiked, turned = flights["slender"], scaled(flights["slender"], -1.0, "q")
    q = spiked.q.copy()
    q[100] += 1.0
    faults = (RecordFault("q", "spikes", 0.0, 0.0, "a spike replaced", False),)
    sound, at_fault = replace(spiked, q=q, faults=faults, path="first.h5"), replace(turned, path="second.h5")
    found = compare([sound, at_fault])
    assert found.verdict.outcome == "record fault"
    assert found.record.faults[0].fault == "sign"
    assert found.verdict.reason.startswith("The record of second.h5 contradicts itself (sign: q;")
    assert found.verdict.reason.endswith("correct the map. `compare --accept-record` compares it nevertheless.")
    assert not any("--accept-record" in fault.action for fault in found.record.faults)


@pytest.mark.parametrize("factor", [1.0 / 32.174, 32.174])
def test_an_inertia_of_other_units_is_said(flights, factor: float) -> None:
    """Pounds for slugs: the motion knows the ratio of the inertias alone, and nothing contradicts it."""
    flight = flights["slender"]
    vehicle = replace(flight.vehicle, ixx=factor * flight.vehicle.ixx, iyy=factor * flight.vehicle.iyy)
    _, trial = try_record(replace(flight, vehicle=vehicle))
    assert trial.sound
    (fault,) = [each for each in trial.faults if each.channel == "vehicle"]
    assert "check the units of ixx, mass and reference_length" in fault.action
    assert not any(each.channel == "vehicle" for each in try_record(flight)[1].faults)


@pytest.mark.thorough
@pytest.mark.parametrize(("seed", "number", "world"), [(1201008, 8, "one"), (1202000, 0, "all"), (1202003, 3, "all")])
def test_a_record_of_any_vehicle_has_no_fault(seed: int, number: int, world: str) -> None:
    """Trim that mean spin and drag lean by nearly alike; swings of a slender body that are no thrust."""
    made, _, _ = drawn_flight(seed, number, "tactical", world, drawn=True)
    _, trial = try_record(made.flight)
    assert trial.sound, [fault.action for fault in trial.faults]
