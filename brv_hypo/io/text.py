"""Text that is fit to print, and the one wording of a refusal.

Text of foreign origin must not write on a terminal as we do: control codes and marks that reverse the order of
what follows are left out (`printable`, `one_line`). A refused dataset is always reported in the same four parts:
what was found, what was expected, the likely cause, the remedy (`refusal`); `naming` puts the file in front.
"""

from __future__ import annotations

import difflib
import unicodedata
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from brv_hypo.errors import FlightRecordError

LONGEST_LINE = 300  # characters kept of a title or of another text that belongs on one line

_KEPT = "\n\t"
# Marks that reverse the order of what follows, and separators that begin a new line.
_REORDERING = frozenset("\u061c\u200e\u200f\u2028\u2029\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")


def printable(text: str) -> str:
    """The text without control codes, marks that reorder it, and code points that no encoding has."""
    if text.isascii() and text.isprintable():
        return text
    return "".join(c for c in text if c in _KEPT or not _is_control(c))


def one_line(text: str) -> str:
    """The text on one line: printable, without line breaks, and not endless."""
    line = printable(text).replace("\n", " ").replace("\t", " ")
    return line if len(line) <= LONGEST_LINE else line[:LONGEST_LINE] + "..."


def counted(count: int, thing: str) -> str:
    """So many of a thing: "1 sample", "2 samples"."""
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"


def hypothesis(name: str) -> str:
    """What a person reads for a hypothesis: `none` is the baseline only."""
    return "baseline only" if name == "none" else name


def nearest(name: str, known: Iterable[str], cutoff: float = 0.6, most: int = 1) -> list[str]:
    """The known names that an unknown one is like, the most alike first."""
    return difflib.get_close_matches(name, list(known), n=most, cutoff=cutoff)


def meant(name: str, known: Iterable[str], otherwise: str, cutoff: float = 0.6, most: int = 1) -> str:
    """A question after the known names, `most` at most, that an unknown one is like, or `otherwise`; for a refusal."""
    near = nearest(name, known, cutoff, most)
    if not near:
        return otherwise
    return f"is '{near[0]}' meant?" if most == 1 else f"did you mean {' or '.join(near)}?"


def _is_control(character: str) -> bool:
    return unicodedata.category(character) in ("Cc", "Cs") or character in _REORDERING


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
