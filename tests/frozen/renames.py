"""The table of renames, applied to the frozen files by script, so that a diff shows that nothing else has moved."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Literal

import yaml

from tests.frozen.commands import RESULTS
from tests.frozen.content import as_text

TABLE = Path(__file__).parent / "renames.yaml"


@dataclass(frozen=True)
class Rename:
    """`old` is `new` from now on, `of` keys, values or messages, at the paths that match `where`."""

    old: str
    new: str
    of: Literal["keys", "values", "messages"]
    where: str = "*"

    def applies(self, kind: str, path: str) -> bool:
        return self.of == kind and fnmatchcase(path, self.where)


def pending() -> tuple[Rename, ...]:
    """What the frozen files do not yet say."""
    return _read("pending")


def _read(*parts: str) -> tuple[Rename, ...]:
    found = tuple(Rename(**each) for part in parts for each in _table()[part])
    for each in found:
        if each.of not in ("keys", "values", "messages"):
            raise ValueError(f"{TABLE.name}: a rename of '{each.of}', expected keys, values or messages")
    return found


def apply_pending() -> int:
    """Renames what is pending in every frozen file; how many files changed. The table then has it as applied."""
    changed = _apply(pending(), sorted(RESULTS.glob("*.json")))
    table = _table()
    table["applied"] += table["pending"]
    rows = [yaml.safe_dump(each, default_flow_style=True, width=1000, allow_unicode=True) for each in table["applied"]]
    head = TABLE.read_text(encoding="utf-8").partition("pending:")[0]
    applied = "".join(f"\n  - {row.strip()}" for row in rows) or " []"
    TABLE.write_text(f"{head}pending: []\napplied:{applied}\n", encoding="utf-8")
    return changed


def apply_all(files: Sequence[Path]) -> int:
    """The whole table, for results that code from before the renames has written; how many files changed."""
    return _apply(_read("applied", "pending"), files)


def _apply(renames: Sequence[Rename], files: Sequence[Path]) -> int:
    changed = 0
    for file in files:
        before = file.read_text(encoding="utf-8")
        text = as_text(renamed(json.loads(before), renames, file.stem))
        if text != before:
            file.write_text(text, encoding="utf-8")
            changed += 1
    return changed


def renamed(content: dict[str, Any], renames: Sequence[Rename], name: str) -> dict[str, Any]:
    """A result's content with the renames, all made at once: two names may be exchanged. `name` is NAME.COMMAND."""
    values = _renamed(content["values"], renames, f"{name}:values")
    messages = {
        _place(key, renames, name): _text(text, renames, f"{name}:messages/{key}")
        for key, text in content["messages"].items()
    }
    return {"values": values, "messages": messages}


def _renamed(item: Any, renames: Sequence[Rename], path: str) -> Any:
    if isinstance(item, dict):
        found = {
            _key(key, renames, f"{path}/{key}"): _renamed(value, renames, f"{path}/{key}")
            for key, value in item.items()
        }
        if len(found) < len(item):
            raise ValueError(f"{path}: two keys would have one name")
        return found
    if isinstance(item, list):
        return [_renamed(each, renames, f"{path}/{k}") for k, each in enumerate(item)]
    if isinstance(item, str):
        return _words(item, [each for each in renames if each.applies("values", path)])
    return item


def _key(key: str, renames: Sequence[Rename], path: str) -> str:
    return next((each.new for each in renames if each.old == key and each.applies("keys", path)), key)


def _place(place: str, renames: Sequence[Rename], name: str) -> str:
    """The path of a message, whose keys are renamed as those of the values are."""
    parts, path = [], f"{name}:values"
    for part in place.split("/"):
        path += f"/{part}"
        parts.append(_key(part, renames, path))
    return "/".join(parts)


def _text(text: str, renames: Sequence[Rename], path: str) -> str:
    value_path = path.replace(":messages/", ":values/")
    return _words(
        text,
        [each for each in renames if each.applies("values", value_path)],
        [each for each in renames if each.applies("messages", path)],
    )


def _words(text: str, whole: Sequence[Rename], parts: Sequence[Rename] = ()) -> str:
    """`whole` replaces whole words, `parts` anything; the longest first."""
    new = {each.old: each.new for each in (*whole, *parts)}
    if not new:
        return text
    patterns = [(each.old, rf"(?<![\w']){re.escape(each.old)}(?![\w'])") for each in whole]
    patterns += [(each.old, re.escape(each.old)) for each in parts]
    ordered = "|".join(pattern for _, pattern in sorted(patterns, key=lambda pair: -len(pair[0])))
    return re.sub(ordered, lambda found: new[found[0]], text)


def _table() -> dict[str, list[dict[str, str]]]:
    table = yaml.safe_load(TABLE.read_text(encoding="utf-8"))
    return {"pending": table["pending"] or [], "applied": table["applied"] or []}
