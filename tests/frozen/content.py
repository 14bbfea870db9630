"""The content of a frozen result: what `--json` writes, numbers apart from messages, without what no two runs share.

    {"values": {...}, "messages": {path: text}}

`values` is the command's JSON without seconds, versions, paths and texts; numbers have all their digits. Long arrays
are thinned. `messages` are the texts that a person reads, by their place: another wording moves no number's line.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

LONGEST = 50
"""Values of an array that are kept; the first and the last are among them."""
LEFT_OUT = frozenset({"seconds", "version", "path", "found_on", "digests", "own_record", "planted"})
"""What no two runs share, digests of rounded histories among it; and processes again, spline by spline."""
TEXTS = frozenset(
    {"caveats", "description", "message", "notes", "reason", "static_stability", "unexplained", "warnings"}
)
"""Keys whose strings are messages."""
FEWEST_WORDS = 6
"""From so many words on a string is a message, whatever its key."""


def content_of(result: Any) -> dict[str, Any]:
    """The frozen content of a command's JSON."""
    messages: dict[str, str] = {}
    values = _values(result, "", messages, within_text=False)
    return {"values": values, "messages": messages}


def as_text(content: dict[str, Any]) -> str:
    """The file of a content: sorted keys, a line for each value, an array of numbers on one line."""
    return "".join(_lines(content, "")) + "\n"


def thinned(array: list[Any]) -> list[int]:
    """Which of an array's elements are kept."""
    n = len(array)
    return list(range(n)) if n <= LONGEST else [round(k * (n - 1) / (LONGEST - 1)) for k in range(LONGEST)]


def _values(item: Any, path: str, messages: dict[str, str], *, within_text: bool) -> Any:
    if isinstance(item, dict):
        kept = {}
        for key, value in item.items():
            if key not in LEFT_OUT:
                text = within_text or key in TEXTS
                kept[key] = _values(value, f"{path}/{key}".lstrip("/"), messages, within_text=text)
        return kept
    if isinstance(item, list):
        if len(item) > LONGEST and not any(isinstance(each, dict | str) for each in item):
            some = [_values(item[k], f"{path}/{k}", messages, within_text=False) for k in thinned(item)]
            return {"length": len(item), "some": some}
        return [_values(each, f"{path}/{k}", messages, within_text=within_text) for k, each in enumerate(item)]
    if isinstance(item, str) and item and (within_text or len(item.split()) >= FEWEST_WORDS):
        messages[path] = item
        return "(message)"
    return item


def _lines(item: Any, indent: str) -> Iterator[str]:
    inner = indent + " "
    if isinstance(item, dict) and item:
        yield "{\n"
        for k, key in enumerate(sorted(item)):
            yield f"{',' + chr(10) if k else ''}{inner}{json.dumps(key, ensure_ascii=False)}: "
            yield from _lines(item[key], inner)
        yield f"\n{indent}}}"
    elif isinstance(item, list) and any(isinstance(each, dict | list) for each in item):
        yield "[\n"
        for k, each in enumerate(item):
            yield f"{',' + chr(10) if k else ''}{inner}"
            yield from _lines(each, inner)
        yield f"\n{indent}]"
    else:
        yield json.dumps(item, ensure_ascii=False, allow_nan=False)
