"""Files written whole or not at all.

A file is written beside its place, flushed to the medium, then renamed: whoever looks sees the old one or the new
one. What a killed process left behind is removed by the next that writes into the folder.
"""

from __future__ import annotations

import errno
import os
import secrets
import shutil
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from brv_hypo.errors import UsageError
from brv_hypo.io.reading import kind_of

SUFFIX = ".partial"
NAME_KEPT = 30  # characters of a file's name in that of its temporary, which must not become too long

_REMEDIES = {
    errno.ENOSPC: "The medium is full. Free some room, or choose another place.",
    errno.EDQUOT: "The quota is used up. Free some room, or choose another place.",
    errno.EROFS: "The medium is read-only. Choose another place.",
    errno.EACCES: "There is no permission. Choose another place.",
    errno.EPERM: "There is no permission. Choose another place.",
    errno.EFBIG: "The file would be too large here. Choose another place.",
    errno.ENOTDIR: "A file stands where a folder is needed. Choose another place.",
    errno.EEXIST: "A file stands where a folder is needed. Choose another place.",
    errno.ENOENT: "The directory does not exist. Create it, or choose another place.",
    errno.ENAMETOOLONG: "The name is too long. Choose a shorter one.",
}
# Temporaries that this process has open: removed at once where it must end without unwinding.
_open: set[Path] = set()


def check_target(path: str | Path, *, overwrite: bool) -> None:
    """Raise UsageError where something stands at `path` that must not, or cannot, be replaced by a file."""
    kind = kind_of(path)
    if kind not in (None, "a file"):
        raise UsageError(f"{path} is {kind}, where a file is to be written. Name a regular file.")
    if kind is not None and not overwrite:
        raise UsageError(f"{path} exists already and is left as it is. Choose another name, or give --force.")


def write_whole(path: str | Path, content: str | bytes, *, overwrite: bool = True) -> None:
    """Write the file whole or not at all; a link is followed, and what it leads to replaced.

    Raises UsageError where the target must not be replaced, or cannot be written.
    """
    check_target(path, overwrite=overwrite)
    data = content.encode("utf-8") if isinstance(content, str) else content
    target = Path(os.path.realpath(path))
    with writable(path), _temporary(target) as partial:
        with open(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666), "wb") as stream:
            if target.exists():
                os.fchmod(stream.fileno(), target.stat().st_mode & 0o777)
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(partial, target)
        _sync_folder(target.parent)


def make_folder(path: str | Path) -> Path:
    """The folder at `path`, made with those above it where it is missing. Raises UsageError where it cannot be."""
    folder = Path(path)
    with writable(folder):
        folder.mkdir(parents=True, exist_ok=True)
    return folder


@contextmanager
def whole_folder(path: str | Path) -> Iterator[Path]:
    """A new folder to fill, at `path` when the block ends well and nowhere when it does not.

    Raises UsageError where something stands at `path`, or it cannot be written.
    """
    if kind_of(path) is not None:
        raise UsageError(f"{path} exists already and is left as it is. Choose another name or directory.")
    target = Path(os.path.realpath(path))
    with writable(path), _temporary(target) as partial:
        partial.mkdir()
        yield partial
        os.rename(partial, target)
        _sync_folder(target.parent)


@contextmanager
def writable(path: str | Path) -> Iterator[None]:
    """Turn what the system says against writing to `path` inside into a UsageError with the remedy."""
    try:
        yield
    except OSError as error:
        remedy = _REMEDIES.get(error.errno or 0, "Choose another place.")
        raise UsageError(f"{path} cannot be written: {error.strerror or error}. {remedy}") from None


def _sync_folder(folder: Path) -> None:
    """Make a rename in `folder` last through a failure of power, where the system can."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _temporary_beside(target: Path) -> Path:
    """A name for a temporary of this process beside `target`; removes those that dead processes left there."""
    _remove_stale(target.parent)
    name = f".{target.name[:NAME_KEPT]}.{_host()}.{os.getpid()}.{secrets.token_hex(3)}{SUFFIX}"
    return target.with_name(name)


def remove_open_temporaries() -> None:
    """Remove what this process is writing: for an end that unwinds nothing."""
    for partial in list(_open):
        _remove(partial)


@contextmanager
def _temporary(target: Path) -> Iterator[Path]:
    partial = _temporary_beside(target)
    _open.add(partial)
    try:
        yield partial
    finally:
        _remove(partial)
        _open.discard(partial)


def _remove(partial: Path) -> None:
    if partial.is_dir() and not partial.is_symlink():
        shutil.rmtree(partial, ignore_errors=True)
        return
    with suppress(OSError):
        partial.unlink(missing_ok=True)


def _remove_stale(folder: Path) -> None:
    """Remove temporaries of processes of this host that are no more."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            parts = entry.name.split(".")
            if not (entry.name.startswith(".") and entry.name.endswith(SUFFIX) and len(parts) > 5):
                continue
            host, process = parts[-4], parts[-3]
            if host == _host() and process.isdigit() and not _is_alive(int(process)):
                _remove(Path(entry.path))


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # it lives, and is another user's
        return True
    return True


def _host() -> str:
    """The host's name, without dots: process numbers mean nothing on another."""
    return socket.gethostname().replace(".", "-")
