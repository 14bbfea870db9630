"""What the agreement with a frozen result notices, and what it lets pass."""

from __future__ import annotations

import copy
import json
from typing import Any

import pytest

from tests.frozen.__main__ import by_key, results
from tests.frozen.agreement import (
    Allowance,
    Difference,
    Explanation,
    close,
    disagreements,
    explained,
    identical,
    read_allowances,
    read_explanations,
    same_words,
)
from tests.frozen.commands import RESULTS
from tests.frozen.content import as_text, content_of
from tests.frozen.renames import Rename, renamed

RESULT: dict[str, Any] = {
    "flights": [{"path": "flight.h5", "samples": 301}],
    "ranking": [
        {
            "mechanism": "sticking",
            "f_ratio": 812.5,
            "terms": [{"name": "jump in C_N0", "value": 1.0e-9, "std_error": 2.0e-4}],
        }
    ],
    "histories": {"alpha": [1e-3 * k for k in range(301)]},
    "verdict": {"winner": "sticking", "probability": {"sticking": 0.93, "other": 0.07}, "reason": "It leads by 4.2."},
    "seconds": {"total": 3.1},
}


def changed(path: str, value: Any) -> list[Difference]:
    """What is noticed where the leaf at `path` becomes `value`."""
    moved = copy.deepcopy(RESULT)
    *sections, last = path.split("/")
    place: Any = moved
    for part in sections:
        place = place[int(part) if isinstance(place, list) else part]
    place[int(last) if isinstance(place, list) else last] = value
    return disagreements(content_of(RESULT), content_of(moved), "demo.compare", explanations=())


def test_a_moved_probability_is_noticed() -> None:
    (found,) = changed("verdict/probability/sticking", 0.91)
    assert str(found) == "demo.compare:values/verdict/probability/sticking: 0.93 -> 0.91 (2.2e-02 relative)"


def test_a_changed_key_is_noticed() -> None:
    found = changed("verdict/probability", {"stuck": 0.93, "other": 0.07})
    assert {(each.path.rpartition("/")[2], each.found) for each in found} == {("sticking", "(absent)"), ("stuck", 0.93)}


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("verdict/winner", None),
        ("verdict/winner", "lag"),
        ("flights/0/samples", 300),
        ("ranking/0/terms", []),
        ("ranking/0/terms/0/value", None),
        ("ranking/0/f_ratio", 812.501),
        ("ranking/0/terms/0/value", 1.5e-9),
        ("histories/alpha/300", 0.30001),
        ("histories/alpha", [1e-3 * k for k in range(300)]),
        ("verdict/reason", "It leads by 4.7."),
        ("verdict/reason", "It is ahead by 4.2."),
    ],
)
def test_what_is_noticed(path: str, value: Any) -> None:
    assert changed(path, value)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("seconds/total", 9.9),
        ("flights/0/path", "other.h5"),
        ("ranking/0/f_ratio", 812.5 * (1.0 + 5e-7)),
        ("ranking/0/terms/0/value", 1.1e-9),
        ("histories/alpha/0", 1e-8),
        ("verdict/reason", "It leads by 4.3."),
    ],
)
def test_what_another_build_of_the_libraries_may_change(path: str, value: Any) -> None:
    assert not changed(path, value)


def test_the_three_classes() -> None:
    frozen, moved = {"a": [1.0, 2.0], "n": 3}, {"a": [1.0 + 3e-10, 2.0], "n": 3}
    assert not identical(frozen, moved)
    assert [each.path for each in identical(frozen, moved, exact=True)] == ["a/0"]
    assert not close(frozen, moved)
    assert close(frozen, {"a": [1.0 + 3e-9, 2.0], "n": 3})
    assert not explained(frozen, {"a": [7.0, 8.0, 9.0], "n": None, "new": 1})
    assert [each.path for each in explained(frozen, {"a": [7.0, 8.0]})] == ["n"]


def test_an_explained_path_need_only_exist() -> None:
    frozen, moved = content_of(RESULT), content_of(RESULT | {"verdict": {"winner": "lag", "reason": "Else."}})
    known = [Explanation("*:values/verdict/winner", "another prior"), Explanation("*:messages/*", "reworded")]
    differing = disagreements(frozen, moved, "demo.compare", explanations=known)
    assert [each.path for each in differing] == ["demo.compare:values/verdict/probability"]
    gone = Explanation("*:values/verdict/*", "no probabilities any more")
    assert disagreements(frozen, moved, "demo.compare", explanations=[*known, gone]) == differing


def test_an_explanation_may_require_closeness() -> None:
    frozen, moved = {"values": {"x": 1.0}, "messages": {}}, {"values": {"x": 1.0 + 1e-10}, "messages": {}}
    known = [Explanation("a.b:values/x", "another order of sums", "close")]
    assert not disagreements(frozen, moved, "a.b", required="exact", explanations=known)
    moved["values"]["x"] = 1.0 + 1e-8
    assert disagreements(frozen, moved, "a.b", required="exact", explanations=known)


def test_other_libraries_may_round_otherwise() -> None:
    frozen, moved = ({"values": {"limits": [0.2, 0.1], "n": 3}, "messages": {}}, {"limits": [0.2, 0.104], "n": 3})
    known = [Allowance("a.compare:values/limits/*", 0.05, "flat"), Allowance("a.compare:*", 1e-4, "rest")]
    found = {"values": moved, "messages": {}}
    assert not disagreements(frozen, found, "a.compare", explanations=(), allowances=known)
    assert disagreements(frozen, found, "a.compare", explanations=(), allowances=known[1:])
    assert disagreements(frozen, found, "a.compare", explanations=())
    moved["n"] = 4
    assert disagreements(frozen, found, "a.compare", explanations=(), allowances=known)


def test_an_f_ratio_is_the_square_of_an_estimate() -> None:
    """A value of 1e-4 standard errors that moves by 1e-6 of one moves its F-ratio by 2 %."""
    frozen = {"value": 1e-4, "std_error": 1.0, "f_ratio": 1e-8}
    assert not identical(frozen, {"value": 1.009e-4, "std_error": 1.0, "f_ratio": 1.009e-4**2})
    assert identical(frozen, {"value": 1.02e-4, "std_error": 1.0, "f_ratio": 1.02e-4**2})


def test_tiny_probabilities_need_not_agree() -> None:
    assert not identical({"probability": {"lag": 5e-183}}, {"probability": {"lag": 6e-183}})
    assert identical({"probability": {"lag": 5e-183}}, {"probability": {"lag": 6e-183}}, exact=True)
    assert identical({"p_value": 1e-3}, {"p_value": 1.001e-3})


def test_every_allowance_has_a_reason() -> None:
    assert all(each.reason and 0.0 < each.share < 1.0 for each in read_allowances())


def test_every_explanation_has_a_path_of_the_frozen_results() -> None:
    found = [each.path for each in read_explanations()]
    names = {file.stem for file in RESULTS.glob("*.json")}
    for path in found:
        covered = [name for name in names if Explanation(path.partition(":")[0], "").covers(name)]
        assert covered, f"no frozen result has {path}"


def test_numbers_in_messages_may_differ_by_their_last_digit() -> None:
    assert same_words("from 5.01 to 6 s, 1.2e-05", "from 5.02 to 6 s, 1.3e-05")
    assert not same_words("from 5.01 to 6 s", "from 5.03 to 6 s")
    assert not same_words("lag: 2 knots", "lags: 2 knots")


def test_content_parts_messages_from_values_and_thins_arrays() -> None:
    content = content_of(RESULT)
    assert content["messages"] == {"verdict/reason": "It leads by 4.2."}
    assert "seconds" not in content["values"]
    assert content["values"]["flights"] == [{"samples": 301}]
    alpha = content["values"]["histories"]["alpha"]
    assert (alpha["length"], len(alpha["some"]), alpha["some"][-1]) == (301, 50, 1e-3 * 300)
    assert json.loads(as_text(content)) == content


def test_renames_are_made_all_at_once_and_nothing_else_moves() -> None:
    renames = [
        Rename("C_N0", "C_m0", "values"),
        Rename("f_ratio", "F", "keys"),
        Rename("verdict", "ruling", "keys"),
        Rename("sticking", "lag", "values"),
        Rename("lag", "sticking", "values"),
        Rename("leads", "is ahead", "messages", where="demo.*"),
    ]
    content = renamed(content_of(RESULT), renames, "demo.compare")
    (row,) = content["values"]["ranking"]
    assert (row["F"], row["mechanism"], row["terms"][0]["name"]) == (812.5, "lag", "jump in C_m0")
    assert content["messages"] == {"ruling/reason": "It is ahead by 4.2."}
    assert content["values"]["histories"] == content_of(RESULT)["values"]["histories"]
    back = [Rename(each.new, each.old, each.of) for each in renames if each.new != "sticking"]
    assert renamed(content, [*back, Rename("sticking", "lag", "values")], "demo.compare") == content_of(RESULT)


def test_two_keys_cannot_be_renamed_to_one() -> None:
    with pytest.raises(ValueError, match="one name"):
        renamed({"values": {"a": 1, "b": 2}, "messages": {}}, [Rename("a", "b", "keys")], "x.y")


def test_the_summary_is_by_key() -> None:
    found = [Difference(f"{name}.compare:values/ranking/{k}/cp", 1.0, 1.5) for name in "ab" for k in range(3)]
    assert by_key(found) == ["compare:values/ranking/*/cp: 6 in 2 results, largest 5.0e-01 relative"]


def test_a_result_is_chosen_by_flight_or_command() -> None:
    assert results(["demo.compare"], every=False) == [("demo", "compare")]
    assert [command for _, command in results(["demo"], every=False)] == ["inspect", "reconstruct", "compare"]
    with pytest.raises(KeyError):
        results(["demi"], every=False)
