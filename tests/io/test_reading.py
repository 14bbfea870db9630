"""Hostile text files end in one readable refusal: pipes, bombs, loops, endless numbers."""

from __future__ import annotations

import os

import pytest
from hypothesis import given

from brv_hypo.errors import FlightRecordError, UsageError
from brv_hypo.importing.formats import Layout, read_columns
from brv_hypo.io import mappings
from brv_hypo.io.files import read_text
from brv_hypo.io.mappings import read_json, read_yaml
from brv_hypo.io.text import one_line, printable
from tests.texts import texts

LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 9)}]\n" for before, name in zip("abcdefgh", "bcdefghi", strict=True)
)
MERGES = "a: &a {x: 1}\n" + "".join(
    f"{name}: &{name} {{<<: [*{before}, *{before}, *{before}, *{before}]}}\n"
    for before, name in zip("abcdefghijkl", "bcdefghijklm", strict=True)
)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (LAUGHS, "stand for more than"),
        (MERGES, "stand for more than"),
        ("a: &a [*a]", "an alias of what it stands in"),
        ("a: 1\nb: 2\na: 3", "line 3, column 1: 'a' is there twice"),
        ("a: " + "[" * 60 + "]" * 60, "levels of nesting"),
        ("a: " + "[" * 20_000, "levels of nesting"),
        (f"a: {'9' * 6000}", "a value that cannot be read"),
        (f"a: {'9' * 600}", "a whole number of 600 digits"),
        ("a: !!int ''", "a value that cannot be read"),
        ("a: !!bool maybe", "a value that cannot be read"),
        ("a: !!timestamp soon", "a value that cannot be read"),
        ("a: !!python/object/apply:os.system [ls]", "not YAML"),
        ("{[1]: 2}", "not YAML"),
        ("1: 2", "expected names"),
        ("a: \x00", "not YAML"),
        ("--- a\n--- b", "not YAML"),
        ("just text", "expected a mapping"),
        ("a: " + "x" * mappings.YAML_BYTES, "more than 512 kB"),
    ],
)
def test_hostile_yaml_is_refused_with_its_place(tmp_path, text, says):
    path = tmp_path / "hostile.yaml"
    path.write_text(text)
    with pytest.raises(UsageError, match=says) as refused:
        read_yaml(path, "settings")
    assert str(path) in str(refused.value)
    assert len(str(refused.value)) < 1000


def test_dates_stay_text_and_aliases_work(tmp_path):
    path = tmp_path / "plain.yaml"
    path.write_text("day: 2001-99-99\nnow: 2001-01-01\none: &x {a: 1.5}\ntwo: {<<: *x, b: 0x10}\n")
    assert read_yaml(path, "settings") == {
        "day": "2001-99-99",
        "now": "2001-01-01",
        "one": {"a": 1.5},
        "two": {"a": 1.5, "b": 16},
    }


@pytest.mark.parametrize(
    ("text", "says"),
    [("[" * 100_000, "not JSON"), ("9" * 6000, "not JSON"), ("[1]", "expected a mapping"), ("{", "not JSON")],
)
def test_hostile_json_is_refused(tmp_path, text, says):
    path = tmp_path / "hostile.json"
    path.write_text(text)
    with pytest.raises(UsageError, match=says):
        read_json(path, "a model")


@pytest.mark.parametrize("kind", ["a pipe", "a directory", "a device", "no such file"])
def test_only_regular_files_are_opened(tmp_path, kind):
    path = tmp_path / "special"
    if kind == "a pipe":
        os.mkfifo(path)
    elif kind == "a directory":
        path.mkdir()
    elif kind == "a device":
        path.symlink_to("/dev/zero")
    with pytest.raises(UsageError, match=kind):
        read_text(path, "text", 10)


@given(texts())
def test_printable_text_has_no_control_code_and_is_itself_printable(text):
    plain = printable(text)
    assert plain == printable(plain)
    assert not any((ord(c) < 32 and c not in "\n\t") or 127 <= ord(c) < 160 for c in plain)
    plain.encode("utf-8")
    assert "\n" not in one_line(text)
    assert printable("Größe α\n") == "Größe α\n"


@pytest.mark.parametrize("hidden", ["\x1b[2J", "\x9b2J", "\r", "\x07", "\u202e", "\ud800", "\x00"])
def test_control_codes_of_a_terminal_are_removed(hidden):
    assert printable(f"a{hidden}b") in ("ab", "a[2Jb", "a2Jb")


@pytest.mark.parametrize(
    ("content", "error", "says"),
    [
        (b"t,p\n1,\x1b[2J\n", FlightRecordError, r"'\[2J'"),
        (b"t,p\n" + b"1" * (2 << 20), FlightRecordError, "a line of more than"),
        (b't,p\n1,"' + b"1" * 300_000, FlightRecordError, "cannot be read"),
        (b"\x1b[2J\n", UsageError, r"It has \[2J"),
    ],
)
def test_a_hostile_table_is_refused(tmp_path, content, error, says):
    path = tmp_path / "data.csv"
    path.write_bytes(content)
    with pytest.raises(error, match=says):
        read_columns(path, ("t", "p"))


def test_a_delimiter_that_cannot_be_one_is_a_usage_error(tmp_path):
    path = tmp_path / "data.csv"
    path.write_text("t,p\n1,2\n")
    with pytest.raises(UsageError, match="delimiter"):
        read_columns(path, ("t", "p"), Layout.model_construct(delimiter="too long"))
