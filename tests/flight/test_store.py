"""Format 1: round trips, other units, refusals, the truth, whole files or none."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pint
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from brv_hypo.errors import FlightRecordError, UsageError
from brv_hypo.flight import CHANNELS, OPTIONAL_CHANNELS, Flight, Quantity, Vehicle, load_flight, save_flight
from brv_hypo.flight.cleaning import find_spikes
from brv_hypo.flight.record import CHANNEL_DIMENSIONS, LARGEST
from brv_hypo.flight.units import ENDLESS_POWER
from brv_hypo.thresholds import SHORTEST_STEP, SLOWEST
from tests.flight.records import ACCEPTED, UNITS, VEHICLE, flight, motion, write_raw
from tests.texts import texts
from tests.truth import load_truth

PINT: Any = pint.UnitRegistry()

CHOICES = st.fixed_dictionaries({name: st.sampled_from(sorted(ACCEPTED[si])) for name, si in UNITS.items()})
POSITIVE = st.floats(1e-3, 1e4)


@st.composite
def flights(draw: st.DrawFn) -> Flight:
    """Any flight that is valid: its rate, length, motion, vehicle, optional channels and gap.

    Noise in whose few samples one counts as a spike, which loading would replace, is not drawn.
    """
    samples, rate = draw(st.integers(60, 200)), draw(st.floats(20.0, 1000.0))
    channels = motion(samples, rate, frequency=draw(st.floats(0.0, 0.05)) * rate, seed=draw(st.integers(0, 2**31)))
    for name in draw(st.sets(st.sampled_from(OPTIONAL_CHANNELS))):
        channels[name] = 100.0 + channels["time"]
    channels["density"] = 2.0 * channels["dynamic_pressure"] / channels["velocity"] ** 2
    iyy = draw(POSITIVE)
    vehicle = Vehicle(
        mass=draw(POSITIVE),
        ixx=iyy * draw(st.floats(1e-3, 2.0)),
        iyy=iyy,
        reference_length=draw(POSITIVE),
        reference_area=draw(POSITIVE),
        accelerometer_position=draw(st.tuples(*[st.integers(-5000, 5000).map(lambda mm: mm / 1000)] * 3)),
    )
    segments = ((0, 20), (samples - 20, samples)) if draw(st.booleans()) else ((0, samples),)
    flown = np.zeros(samples, dtype=bool)
    for start, stop in segments:
        flown[start:stop] = True
    assume(not any(np.any(find_spikes(np.where(flown, values, np.nan))) for values in channels.values()))
    return Flight(
        **channels, vehicle=vehicle, segments=segments, planet="mars", title=draw(st.text("añ x", max_size=5))
    )


def assert_same(found: Flight, expected: Flight, *, rtol: float) -> None:
    """Every channel, inside segments, and every vehicle value agree."""
    assert found.segments == expected.segments
    for name in ("time", *CHANNELS, *OPTIONAL_CHANNELS):
        a, b = getattr(found, name), getattr(expected, name)
        assert (a is None) == (b is None), name
        for start, stop in expected.segments if b is not None else ():
            np.testing.assert_allclose(a[start:stop], b[start:stop], rtol=rtol, err_msg=name)
    for name in VEHICLE.__dataclass_fields__:
        np.testing.assert_allclose(getattr(found.vehicle, name), getattr(expected.vehicle, name), rtol=rtol)


@pytest.mark.thorough
@given(flights())
def test_saving_and_loading_returns_the_flight(original: Flight) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "flight.h5")
        save_flight(original, path)
        found = load_flight(path)
    assert_same(found, original, rtol=0.0)
    assert (found.planet, found.title) == (original.planet, original.title)


@pytest.mark.thorough
@given(flights(), CHOICES)
def test_any_accepted_unit_gives_the_same_flight(original: Flight, units: dict[str, str]) -> None:
    def in_units(name: str, values: Any) -> Any:
        return np.asarray(values) / ACCEPTED[UNITS[name]][units[name]]

    whole = replace(original, segments=((0, original.samples),))
    recorded = ("time", *CHANNELS, *OPTIONAL_CHANNELS)
    channels = {name: in_units(name, v) for name in recorded if (v := getattr(whole, name)) is not None}
    vehicle = {name: in_units(name, getattr(whole.vehicle, name)) for name in VEHICLE.__dataclass_fields__}
    header = {"format": "brv-flight", "format_version": 1, "planet": "mars"}
    with tempfile.TemporaryDirectory() as folder:
        path = write_raw(Path(folder, "f.h5"), channels, units=units, vehicle=vehicle, attributes=header)
        assert_same(load_flight(path), whole, rtol=1e-12)


def without(*names: str) -> dict[str, Any]:
    return {name: values for name, values in motion().items() if name not in names}


def altered(name: str, index: Any, value: Any) -> dict[str, Any]:
    channels = motion()
    channels[name][index] = value
    return channels


def vehicle_with(**changes: Any) -> dict[str, Any]:
    fields = {name: getattr(VEHICLE, name) for name in VEHICLE.__dataclass_fields__}
    return {name: value for name, value in {**fields, **changes}.items() if value is not None}


ONE_PER_CHANNEL = ["time", *CHANNELS]
VEHICLE_FIELDS = ["mass", "ixx", "iyy", "reference_length", "reference_area"]
MALFORMED = [
    *[(name, "no 'units'", {"units": {name: None}}) for name in ONE_PER_CHANNEL],
    *[(name, "volt", {"units": {name: "volt"}}) for name in ONE_PER_CHANNEL],
    *[(name, "cannot be read", {"units": {name: "furlongs//"}}) for name in ONE_PER_CHANNEL],
    *[(name, "such dataset", {"channels": without(name)}) for name in ("time", *CHANNELS[:-1])],
    *[(name, "shape (3,)", {"channels": {**motion(), name: np.ones(3)}}) for name in ONE_PER_CHANNEL],
    *[(name, "shape (400, 2)", {"channels": {**motion(), name: np.ones((400, 2))}}) for name in ONE_PER_CHANNEL],
    *[(name, "type", {"channels": {**motion(), name: [b"text"] * 400}}) for name in ONE_PER_CHANNEL],
    *[(name, "up to inf", {"channels": altered(name, 7, np.inf)}) for name in CHANNELS],
    *[(name, "NaN at every", {"channels": altered(name, slice(None), np.nan)}) for name in CHANNELS],
    *[(name, "below 0", {"channels": altered(name, 7, -1.0)}) for name in ("velocity", "dynamic_pressure")],
    *[(name, "beyond", {"channels": altered(name, 7, 1e300)}) for name in ONE_PER_CHANNEL],
    ("velocity", "below 0.1", {"channels": altered("velocity", 7, 0.0)}),
    ("velocity", "below 0.1", {"channels": altered("velocity", slice(None), 1e-300)}),
    ("time", "apart", {"channels": {**motion(), "time": 1e-12 * motion()["time"]}}),
    ("vehicle/mass", "less than or equal", {"vehicle": vehicle_with(mass=1e300)}),
    ("vehicle/iyy", "greater than or equal", {"vehicle": vehicle_with(iyy=1e-300, ixx=1e-300)}),
    ("q", "a power that no unit has", {"units": {"q": "rad/s * 10**(9**9)"}}),
    ("time", "finite", {"channels": altered("time", 7, np.nan)}),
    ("time", "increasing", {"channels": altered("time", 7, 9.0)}),
    ("time", "jumps", {"channels": altered("time", -1, 1e9)}),
    ("time", "at least 16", {"channels": {name: values[:15] for name, values in motion().items()}}),
    ("dynamic_pressure", "altitude", {"channels": without("dynamic_pressure")}),
    ("q", "hold no angle", {"units": {"q": "Hz"}}),
    ("p", "hold no angle", {"units": {"p": "1/s"}}),
    ("r", "missing samples", {"channels": altered("r", slice(5, 395), np.nan)}),
    *[(f"vehicle/{name}", "nothing", {"vehicle": vehicle_with(**{name: None})}) for name in VEHICLE_FIELDS],
    *[(f"vehicle/{name}", "greater than", {"vehicle": vehicle_with(**{name: -1.0})}) for name in VEHICLE_FIELDS],
    *[(f"vehicle/{name}", "nan", {"vehicle": vehicle_with(**{name: np.nan})}) for name in VEHICLE_FIELDS],
    *[(f"vehicle/{name}", "a valid number", {"vehicle": vehicle_with(**{name: [1, 2]})}) for name in VEHICLE_FIELDS],
    *[(f"vehicle/{name}", "no 'units'", {"units": {name: None}}) for name in VEHICLE_FIELDS],
    ("vehicle/mass", "mass", {"units": {"mass": "lbf"}}),
    ("vehicle/ixx", "2 iyy", {"vehicle": vehicle_with(ixx=61.0)}),
    ("vehicle/accelerometer_position/2", "nothing", {"vehicle": vehicle_with(accelerometer_position=[1.0, 2.0])}),
    ("format", "brv-flight", {"attributes": {}}),
    ("format_version", "2", {"attributes": {"format": "brv-flight", "format_version": 2}}),
]


@pytest.mark.parametrize(("name", "says", "change"), MALFORMED, ids=[f"{m[0]}-{m[1]}" for m in MALFORMED])
def test_a_malformed_record_is_refused_by_name(tmp_path: Path, name: str, says: str, change: dict[str, Any]) -> None:
    path = write_raw(tmp_path / "bad.h5", **{"channels": motion(), **change})
    with pytest.raises(FlightRecordError) as caught:
        load_flight(path)
    message = str(caught.value)
    assert str(path) in message
    assert f"'{name}'" in message
    for part in (says, "found", "expected", "Likely cause", "Remedy"):
        assert part in message
    assert caught.value.exit_code == 3


def is_compatible(units: str, si: str) -> bool:
    """Whether a unit string is acceptable, by pint and the two rules of our own (g, and angles in rates)."""
    if units.strip() in ACCEPTED[si]:
        return True
    if ENDLESS_POWER.search(units):  # pint would calculate it, for hours
        return False
    try:
        unit = PINT.parse_units(units)
    except Exception:
        return False
    holds_angle = "radian" in str(PINT.get_root_units(unit)[1])
    return bool(unit.is_compatible_with(PINT.parse_units(si))) and (si != "rad/s" or holds_angle)


@pytest.mark.thorough
@given(st.sampled_from(ONE_PER_CHANNEL), texts(max_size=8) | st.sampled_from(dir(PINT)))
@example(name="velocity", text="speed_of_light")
@example(name="p", text="9**9**9")
@example(name="q", text="8^99999999")
def test_any_unit_string_is_read_or_refused_by_name(name: str, text: str) -> None:
    units = text.replace("\0", "")
    with tempfile.TemporaryDirectory() as folder:
        path = write_raw(Path(folder, "f.h5"), motion(32), units={name: units})
        said = refusal_of(path)
    if is_compatible(units, UNITS[name]) and a_flight_can_have(name, units):
        assert said == ""
    else:
        assert f"'{name}'" in said


def a_flight_can_have(name: str, units: str) -> bool:
    """Whether the values mean what a flight can have in such units: 3,000 times the speed of light is none."""
    if units.strip() in ACCEPTED[UNITS[name]]:
        return True
    values = PINT.Quantity(np.abs(motion(32)[name]), units).to(UNITS[name]).magnitude
    if name == "time":
        return bool(np.ptp(values) / (values.size - 1) >= SHORTEST_STEP)
    slowest = SLOWEST if name == "velocity" else 0.0
    return bool(values.max() <= LARGEST[CHANNEL_DIMENSIONS[name]] and values.min() >= slowest)


def refusal_of(path: Path) -> str:
    """What is said of a record of 32 samples that is refused; empty where it is read."""
    try:
        assert load_flight(path).samples == 32
    except FlightRecordError as error:
        return str(error)
    return ""


def test_what_is_not_a_record_is_refused(tmp_path: Path) -> None:
    text = tmp_path / "notes.h5"
    text.write_text("time,p,q,r")
    truncated = write_raw(tmp_path / "cut.h5", motion())
    truncated.write_bytes(truncated.read_bytes()[:3000])
    for path, says in [
        (tmp_path / "absent.h5", "no such file"),
        (tmp_path, "a directory"),
        (text, "not HDF5"),
        (truncated, "cannot be read"),
    ]:
        with pytest.raises(FlightRecordError, match=says):
            load_flight(path)


@given(st.floats(0.0, 0.999))
def test_a_file_cut_short_anywhere_is_refused(kept: float) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = write_raw(Path(folder, "f.h5"), motion(40))
        whole = path.read_bytes()
        path.write_bytes(whole[: int(kept * len(whole))])
        with pytest.raises(FlightRecordError, match=r"f\.h5"):
            load_flight(path)


def test_a_file_without_a_vehicle_is_refused(tmp_path: Path) -> None:
    path = write_raw(tmp_path / "f.h5", motion())
    with h5py.File(path, "a") as file:
        del file["vehicle"]
    with pytest.raises(FlightRecordError, match="'vehicle'"):
        load_flight(path)


def test_an_unknown_dataset_is_ignored_and_said_so(tmp_path: Path) -> None:
    path = write_raw(tmp_path / "f.h5", {**motion(), "Altitude_": np.ones(400)})
    notes = load_flight(path).notes
    assert any("'Altitude_'" in note and "'altitude'" in note for note in notes)


def test_a_misspelt_name_is_recognised(tmp_path: Path) -> None:
    path = write_raw(tmp_path / "f.h5", {**without("velocity"), "Velocity": np.ones(400)})
    with pytest.raises(FlightRecordError, match="it is called 'Velocity' here"):
        load_flight(path)


def test_the_truth_is_kept_apart(tmp_path: Path) -> None:
    path = tmp_path / "f.h5"
    truth = {"mechanism": "sticking", "seed": 3, "alpha": Quantity(np.arange(5.0), "rad"), "lag": {"tau": 0.2}}
    save_flight(flight(), path, truth=truth)
    found = load_truth(path)
    assert found["mechanism"] == "sticking"
    assert found["seed"] == 3
    assert found["lag"] == {"tau": 0.2}
    np.testing.assert_array_equal(found["alpha"], np.arange(5.0))
    plain = tmp_path / "plain.h5"
    save_flight(flight(), plain)
    assert load_truth(plain) == {}
    assert_same(load_flight(path), load_flight(plain), rtol=0.0)
    with h5py.File(path) as file:
        assert file["truth/alpha"].attrs["units"] == "rad"


def test_every_dataset_has_units_and_time_as_its_scale(tmp_path: Path) -> None:
    path = tmp_path / "f.h5"
    save_flight(flight(), path)
    with h5py.File(path) as file:
        assert file.attrs["format"] == "brv-flight"
        assert file.attrs["format_version"] == 1
        for name in CHANNELS:
            assert file[name].attrs["units"] == UNITS[name]
            assert file[name].dims[0][0] == file["time"]
        for name in VEHICLE.__dataclass_fields__:
            assert file["vehicle"][name].attrs["units"] == UNITS[name]


def test_an_existing_file_is_replaced_only_if_forced(tmp_path: Path) -> None:
    path = tmp_path / "f.h5"
    path.write_text("precious")
    with pytest.raises(UsageError, match="exists already"):
        save_flight(flight(), path)
    assert path.read_text() == "precious"
    save_flight(flight(), path, overwrite=True)
    assert load_flight(path).samples == 400


def test_a_failed_write_changes_no_file(tmp_path: Path) -> None:
    path = tmp_path / "f.h5"
    path.write_text("precious")
    with pytest.raises(TypeError):
        save_flight(flight(), path, truth={"unwritable": object()}, overwrite=True)
    with pytest.raises(UsageError, match="cannot be written"):
        save_flight(flight(), tmp_path / "absent" / "f.h5")
    with pytest.raises(FlightRecordError, match="'q'"):
        save_flight(flight(q=np.ones(3)), tmp_path / "bad.h5")
    assert [entry.name for entry in tmp_path.iterdir()] == ["f.h5"]
    assert path.read_text() == "precious"


def test_a_window_is_cut_out(tmp_path: Path) -> None:
    path = write_raw(tmp_path / "f.h5", motion())
    part = load_flight(path, start=11.0, stop=12.0)
    assert (part.time[0], part.time[-1]) == (11.0, 12.0)
    for start, stop in [(50.0, 60.0), (12.0, 11.0), (11.0, 11.05)]:
        with pytest.raises(UsageError, match="window"):
            load_flight(path, start=start, stop=stop)


def test_a_window_inside_a_gap_is_refused(tmp_path: Path) -> None:
    path = write_raw(tmp_path / "f.h5", altered("q", slice(100, 200), np.nan))
    with pytest.raises(UsageError, match="gap"):
        load_flight(path, start=11.2, stop=11.8)
