"""The default flights' results are what they were; `python -m tests.frozen --all` checks all forty."""

from __future__ import annotations

import pytest

from tests.frozen.agreement import disagreements, read_allowances
from tests.frozen.commands import RESULTS, current_content, frozen_content
from tests.frozen.flights import COMMANDS, FLIGHTS, Frozen, Measured
from tests.frozen.libraries import same_libraries

pytestmark = pytest.mark.thorough

DEFAULT = [flight for flight in FLIGHTS.values() if flight.default]


LONG = {
    ("capsule_bodyfixed", "compare"),
    ("cone_magnus", "trace"),
    ("cone_magnus_sister", "predict"),
    *(("table_5", command) for command in ("inspect", "reconstruct")),
}
"""Results that take longer than others of their kind that are checked: these are, with the thorough tests."""
SLOW = {
    ("demo", "compare"),  # which the manual's tests compare with what it shows
    *((name, "compare") for name in ("rocket_lag", "table_5", "cone_magnus", "opportunity_late", "launch12_early")),
    *((name, "reconstruct") for name in ("rocket_lag", "launch12_early")),
    ("rocket_lag", "inspect"),
}
"""Those that take longest, with the slow tests."""


def _marks(flight: Frozen, command: str) -> list[pytest.MarkDecorator]:
    shared = [pytest.mark.shared] if isinstance(flight, Measured) else []
    own = (flight.name, command)
    return [*shared, pytest.mark.slow] if own in SLOW else [*shared, pytest.mark.thorough] if own in LONG else shared


@pytest.mark.parametrize(
    ("name", "command"),
    [
        pytest.param(flight.name, command, marks=_marks(flight, command), id=f"{flight.name}.{command}")
        for flight in DEFAULT
        for command in flight.commands
    ],
)
def test_a_frozen_result_has_not_moved(name: str, command: str) -> None:
    others = not same_libraries()
    if others and command in FLIGHTS[name].rounded:
        pytest.skip("it hangs on rounding, and the libraries are not those that it was written with")
    found = disagreements(
        frozen_content(name, command),
        current_content(name, command),
        f"{name}.{command}",
        allowances=read_allowances() if others else (),
    )
    assert not found, "\n".join(map(str, found[:20]))


def test_every_flight_is_frozen_and_nothing_else_is() -> None:
    wanted = {f"{flight.name}.{command}.json" for flight in FLIGHTS.values() for command in flight.commands}
    assert {file.name for file in RESULTS.glob("*")} == wanted


def test_the_files_are_small() -> None:
    sizes = [file.stat().st_size for file in RESULTS.glob("*.json")]
    assert max(sizes) < 200_000
    assert sum(sizes) < 6_000_000


def test_the_default_flights_are_eight_and_run_every_command() -> None:
    assert len(DEFAULT) == 8
    assert {command for flight in DEFAULT for command in flight.commands} == set(COMMANDS)
    assert sum(isinstance(flight, Measured) for flight in DEFAULT) == 2


def test_there_are_forty_and_what_hangs_on_rounding_is_frozen() -> None:
    assert len(FLIGHTS) == 40
    assert all(set(flight.rounded) <= set(flight.commands) for flight in FLIGHTS.values())
