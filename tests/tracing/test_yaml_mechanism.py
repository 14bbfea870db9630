from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from brv_hypo.errors import UsageError
from brv_hypo.mechanisms import find
from brv_hypo.mechanisms.conformance import MECHANISM_CHECKS, sample_motion, uniform_time
from brv_hypo.mechanisms.yaml_mechanism import (
    Factor,
    MechanismFile,
    Turn,
    YamlMechanism,
    YamlTerm,
    mechanism_of,
    mechanism_text,
    read_mechanism,
)
from brv_hypo.motion.motion import body_from_plane, recorded

FILE = MechanismFile(
    name="turning_moment",
    title="a body-fixed moment that turns at 5 rad/s",
    claims="a moment of constant size that turns in the body",
    source="a test",
    terms=(
        YamlTerm(name="along", axis="body_y", turn=Turn(of="time", rate=5.0)),
        YamlTerm(name="across", axis="body_z", turn=Turn(of="time", rate=5.0), value=2e-4),
        YamlTerm(
            name="step", axis="in_plane", units="1/rad",
            factors=(Factor(of="alpha"), Factor(of="mach", function="step", at=21.9, width=0.1)),
        ),
    ),
)  # fmt: skip


@pytest.mark.parametrize("check", MECHANISM_CHECKS[3:])
def test_conforms(check) -> None:
    check(mechanism_of(FILE))


def test_survives_its_file(tmp_path) -> None:
    path = tmp_path / "turning.yaml"
    path.write_text(mechanism_text(FILE), encoding="utf-8")
    for again in (find(str(path)), read_mechanism(path)):
        assert isinstance(again, YamlMechanism)
        assert (again.name, again.title, again.definition) == (FILE.name, FILE.title, FILE.terms)


@given(rate=st.floats(-20.0, 20.0), size=st.floats(0.1, 3.0))
def test_a_turning_moment_turns_in_the_body(rate: float, size: float) -> None:
    motion = sample_motion(uniform_time(50))
    term = YamlTerm(name="t", axis="body_y", turn=Turn(of="time", rate=rate)).column(motion)
    body = body_from_plane(size * term.in_plane, size * term.out_of_plane, motion.windward_meridian)
    np.testing.assert_allclose(body, size * np.exp(1j * rate * motion.time), atol=1e-9 * size)


def test_a_bump_and_its_neighbours_add_up_to_one() -> None:
    motion = sample_motion(uniform_time(50))
    hats = [Factor(of="time", function="bump", at=at, width=2.0)(motion.time) for at in (0.0, 2.0, 4.0, 6.0)]
    np.testing.assert_allclose(np.sum(hats, axis=0), 1.0, atol=1e-12)


@pytest.mark.parametrize(
    ("factor", "expected"),
    [
        (Factor(of="time", function="step", at=2.0), [0.0, 0.0, 1.0, 1.0]),
        (Factor(of="time", function="ramp", at=1.0), [0.0, 0.0, 1.0, 2.0]),
        (Factor(of="time", function="ramp", at=1.0, width=1.5), [0.0, 0.0, 1.0, 1.5]),
        (Factor(of="mach", function="schedule", places=(0.0, 2.0), values=(1.0, 3.0)), [1.0, 2.0, 3.0, 3.0]),
    ],
)
def test_jumps_ramps_and_schedules(factor: Factor, expected: list[float]) -> None:
    np.testing.assert_allclose(factor(np.arange(4.0)), expected)


@given(delay=st.floats(0.0, 0.2), size=st.floats(0.1, 3.0))
def test_a_delayed_term_is_at_its_past_place_in_the_body(delay: float, size: float) -> None:
    motion = recorded(sample_motion(uniform_time(80)))
    term = YamlTerm(name="t", axis="in_plane", delay=delay, factors=(Factor(of="alpha"),)).column(motion)
    before = motion.delayed(delay)
    body = body_from_plane(size * term.in_plane, size * term.out_of_plane, motion.windward_meridian)
    expected = body_from_plane(size * before.alpha, np.zeros_like(before.alpha), before.windward_meridian)
    np.testing.assert_allclose(body, expected, atol=1e-12)


@pytest.mark.parametrize("values", [(), (1.0,), (1.0, 2.0, 3.0)])
def test_a_schedule_without_its_values_is_refused(values: tuple[float, ...]) -> None:
    with pytest.raises(ValidationError, match="schedule"):
        Factor(of="mach", function="schedule", places=(0.0, 2.0), values=values)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name: x", "not a mechanism file"),
        ("[", "not YAML"),
        (
            "format: brv-mechanism\nname: x\ntitle: t\nclaims: c\nsource: s\nterms: [{name: a, axis: up}]",
            "terms.0.axis",
        ),
        (
            "format: brv-mechanism\nname: x\ntitle: t\nclaims: c\nsource: s\nterms: [{name: a, axis: body_y, code: 1}]",
            "code",
        ),
    ],
)
def test_says_what_is_wrong(tmp_path, text: str, said: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match=said):
        find(str(path))


def test_a_missing_file_is_named() -> None:
    with pytest.raises(UsageError, match=r"nowhere\.yaml"):
        find("nowhere.yaml")
