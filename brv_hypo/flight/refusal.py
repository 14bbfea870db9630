"""One wording for every refused dataset: what was found, what was expected, the likely cause, the remedy."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from brv_hypo.errors import FlightRecordError


def refusal(dataset: str, found: str, expected: str, cause: str, remedy: str) -> FlightRecordError:
    """The error to raise for `dataset`; the caller that knows the file puts its path in front."""
    return FlightRecordError(
        f"dataset '{dataset}': found {found}, expected {expected}. Likely cause: {cause}. Remedy: {remedy}."
    )


@contextmanager
def naming(path: str | Path) -> Iterator[None]:
    """Put the file in front of whatever is refused inside."""
    try:
        yield
    except FlightRecordError as error:
        raise FlightRecordError(f"{path or 'flight'}: {error}") from error
