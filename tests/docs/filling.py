"""A guessed map with the lines that the manual says are to be filled in."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml


def filled_in(path: Path, lines: dict[str, Any]) -> None:
    """Put the lines in the place of what the file has for the same keys."""

    def into(whole: Any, part: Any) -> Any:
        if not isinstance(part, dict) or not isinstance(whole, dict):
            return part
        return {**whole, **{key: into(whole.get(key), value) for key, value in part.items()}}

    path.write_text(yaml.safe_dump(into(yaml.safe_load(path.read_text()), lines), sort_keys=False))
