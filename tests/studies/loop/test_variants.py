"""Whether findings persist where a record is changed."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.flights import nominal
from tests.studies.loop.variants import Variant, persists, report, times_of, variants


def traced(findings: dict[str, float | None], span: tuple[float, float] = (0.0, 160.0), hints: Any = ()) -> Any:
    """A result with these findings, each beginning at its time."""
    columns = tuple(
        SimpleNamespace(mechanism=name, kind="constant" if at is None else "jump", start=at)
        for name, at in findings.items()
    )
    return SimpleNamespace(
        findings=tuple(findings),
        added=(*findings, *hints),
        flight=SimpleNamespace(start_s=span[0], stop_s=span[1]),
        model=SimpleNamespace(definition=SimpleNamespace(columns=columns, record=())),
    )


@pytest.mark.parametrize(
    ("there", "span", "expected"),
    [
        ({"bodyfixed": 52.0}, (0.0, 160.0), True),
        ({"bodyfixed": 75.0}, (0.0, 160.0), False),
        ({"inplane": 52.0}, (0.0, 160.0), False),
        ({"bodyfixed": 52.0}, (60.0, 160.0), None),
    ],
)
def test_a_finding_persists_under_its_name_at_its_time(
    there: dict[str, float], span: tuple[float, float], expected: bool | None
) -> None:
    assert persists("bodyfixed", traced({"bodyfixed": 50.0}), traced(there, span)) is expected


def test_what_has_no_time_persists_by_its_name() -> None:
    assert persists("trim", traced({"trim": None}), traced({"trim": None, "lag": None}))


def test_a_changed_ratio_of_inertia_may_be_found_instead() -> None:
    base, other = traced({"trim": None}), traced({}, hints=("inertia_ratio",))
    assert persists("trim", base, other, also="inertia_ratio")
    assert not persists("trim", base, other)


def test_a_wind_step_has_a_time() -> None:
    result = traced({})
    result.model.definition.record = (SimpleNamespace(effect="wind_step", options={"time": 3.0}),)
    assert times_of(result, "wind_step") == (3.0,)


def test_the_report_counts_variants_with_the_region() -> None:
    others = [(Variant("a"), traced({"trim": None, "lag": None})), (Variant("b"), traced({}))]
    assert list(report(traced({"trim": None}), others)) == [
        "trim persists in 1 of 2, not in b",
        "a: found there alone: lag",
    ]


def test_seven_variants_change_one_thing_each() -> None:
    flight = nominal().flight
    found = variants()
    assert len(found) == 7
    for variant in found:
        changed = variant.change(flight)
        changes = [
            variant.blocks is not None,
            changed.samples < flight.samples,
            changed.vehicle != flight.vehicle,
            changed.samples == flight.samples and not np.array_equal(changed.dynamic_pressure, flight.dynamic_pressure),
        ]
        assert sum(changes) == 1, variant.name
