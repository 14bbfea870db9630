"""Regular files only: a pipe never ends, a device has no size, and a budget needs both."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from brv_hypo.errors import BrvHypoError, UsageError

_KINDS = {
    stat.S_IFDIR: "a directory",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


def kind_of(path: str | Path) -> str | None:
    """What stands at `path`, such as "a pipe"; "a file" for a regular one, None where nothing does."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):  # ValueError: a name with a null character
        return None
    return "a file" if stat.S_ISREG(mode) else _KINDS.get(stat.S_IFMT(mode), "no regular file")


def check_regular(path: str | Path, expected: str, error: type[BrvHypoError] = UsageError) -> None:
    """Raise `error` unless a regular file stands at `path`; `expected` says what it should hold."""
    kind = kind_of(path)
    if kind == "a file":
        return
    if kind is None:
        raise error(
            f"{path}: cannot be read: found no such file, expected {expected}. Likely cause: a misspelt path, or a "
            "relative path from another directory. Remedy: give the path of an existing file."
        )
    raise error(
        f"{path}: cannot be read: found {kind}, expected a regular file with {expected}. "
        "Remedy: give the path of a file; write what comes through a pipe to one first."
    )


def read_text(path: str | Path, expected: str, most_bytes: int) -> str:
    """The text of a regular UTF-8 file of at most `most_bytes`; `expected` says what it should hold.

    Raises UsageError where it is not one, is larger, or cannot be read.
    """
    check_regular(path, expected)
    try:
        with open(path, "rb") as stream:
            content = stream.read(most_bytes + 1)
    except OSError as failure:
        raise UsageError(
            f"{path}: cannot be read ({failure.strerror}). Check its permissions, and that its medium is there."
        ) from None
    if len(content) > most_bytes:
        raise UsageError(
            f"{path}: found more than {most_bytes // 1024} kB, expected {expected}. Likely cause: data where a "
            "description was meant. Remedy: give the right file."
        )
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as failure:
        raise UsageError(
            f"{path}: cannot be read: byte {failure.start} is not UTF-8 text, expected {expected}. "
            "Likely cause: a binary file, or another encoding. Remedy: save it as UTF-8."
        ) from None
