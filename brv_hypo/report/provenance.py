"""Where a page came from: version, settings, records by digest, and the command that makes it again."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import yaml
from pydantic import BaseModel

from brv_hypo.version import version

_CHUNK = 1 << 20


@dataclass(frozen=True)
class Provenance:
    """The command, the settings that differ from the defaults, and each record with its SHA-256."""

    command: str = ""
    settings: str = ""
    records: tuple[tuple[str, str], ...] = ()

    @property
    def rows(self) -> tuple[tuple[str, str], ...]:
        """Name and value of each thing to tell."""
        found = [("version", f"brv-hypo {version()}")]
        found += [(f"record {path}", f"SHA-256 {digest}") for path, digest in self.records]
        if self.settings:
            found.append(("settings", self.settings))
        if self.command:
            found.append(("made by", self.command))
        return tuple(found)


def provenance(command: str, settings: BaseModel | None, records: Iterable[str | Path]) -> Provenance:
    """The provenance of a result; a record that is no file any more has no digest."""
    paths = [Path(path) for path in records if str(path)]
    return Provenance(
        command=command,
        settings=_told(settings),
        records=tuple((str(path), digest(path)) for path in dict.fromkeys(paths) if path.is_file()),
    )


def digest(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal digits."""
    found = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            found.update(chunk)
    return found.hexdigest()


def _told(settings: BaseModel | None) -> str:
    """The settings that differ from the defaults, on one line."""
    if settings is None:
        return ""
    changed = settings.model_dump(mode="json", exclude_defaults=True)
    return yaml.safe_dump(changed, default_flow_style=True, width=10**6).strip() if changed else "defaults"
