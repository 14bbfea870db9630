"""Regular files only, read within budgets and written whole or not at all.

A pipe never ends, a device has no size, and a budget needs both. A file is written in a temporary folder beside its
place, flushed to the medium, then moved: a reader gets the old one or the new one. What a killed process left
behind is removed by the next that writes into the folder.
"""

from __future__ import annotations

import errno
import os
import re
import shutil
import socket
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from brv_hypo import errors
from brv_hypo.errors import BrvHypoError, ExistingOutputError, FlightRecordError, UsageError
from brv_hypo.io.text import meant

_KINDS = {"-": "a file", "d": "a directory", "p": "a pipe", "c": "a device", "b": "a device", "s": "a socket"}
"""By the letter that `ls -l` has for it."""
SUFFIX = ".partial"
_REMEDIES = {
    errno.ENOSPC: "The medium is full. Free some room, or choose another place.",
    errno.EDQUOT: "The quota is used up. Free some room, or choose another place.",
    errno.EROFS: "The medium is read-only. Choose another place.",
    errno.EFBIG: "The file would be too large here. Choose another place.",
    errno.ENOENT: "The directory does not exist. Create it, or choose another place.",
    errno.ENAMETOOLONG: "The name is too long. Choose a shorter one.",
    **dict.fromkeys((errno.EACCES, errno.EPERM), "There is no permission. Choose another place."),
    **dict.fromkeys((errno.ENOTDIR, errno.EEXIST), "A file stands where a folder is needed. Choose another place."),
}
# Temporaries that this process has open: removed at once where it must end without unwinding.
_open: set[Path] = set()
# An installed wheel carries the configurations inside the package, a checkout beside it.
_HOMES = tuple(folder / "configs" for folder in Path(__file__).resolve().parents[1:3])


def kind_of(path: str | Path) -> str | None:
    """What is at `path`, such as "a pipe"; "a file" for a regular one, None where nothing does."""
    try:
        return _KINDS.get(stat.filemode(os.stat(path).st_mode)[0], "no regular file")
    except (OSError, ValueError):  # ValueError: a name with a null character
        return None


def check_regular(path: str | Path, expected: str, error: type[BrvHypoError] = UsageError) -> None:
    """Raise `error` unless a regular file is at `path`; `expected` says what it should hold."""
    kind = kind_of(path)
    if kind == "a file":
        return
    if kind is None:
        missing = errors.MissingRecordError if issubclass(error, FlightRecordError) else errors.MissingInputError
        raise missing(
            f"{path}: cannot be read: found no such file, expected {expected}. Likely cause: a misspelt path, or a "
            "relative path from another directory. Remedy: give the path of an existing file."
        )
    raise error(
        f"{path}: cannot be read: found {kind}, expected a regular file with {expected}. "
        "Remedy: give the path of a file; write what comes through a pipe to one first."
    )


def read_text(path: str | Path, expected: str, most_bytes: int) -> str:
    """The text of a UTF-8 file of at most `most_bytes`, with what is `expected` in it; UsageError where it is none."""
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


def check_target(path: str | Path, *, overwrite: bool) -> None:
    """Raise UsageError where something is at `path` that must not, or cannot, be replaced by a file."""
    kind = kind_of(path)
    if kind not in (None, "a file"):
        raise UsageError(f"{path} is {kind}, where a file is to be written. Name a regular file.")
    if kind is not None and not overwrite:
        raise ExistingOutputError(
            f"{path} exists already and is left as it is. Choose another name, or give --force (overwrite=True)."
        )


def check_hdf5(path: str | Path) -> None:
    """Raise UsageError where the name of a file that is to hold HDF5 says otherwise."""
    if Path(path).suffix.lower() not in (".h5", ".hdf5"):
        raise UsageError(f"{path} would hold HDF5, whose names end in .h5 or .hdf5. Give {Path(path).stem}.h5, say.")


def check_place(path: str | Path, folder: Path) -> None:
    """Raise UsageError with the remedy where nothing can be written for `path` in this folder."""
    with writable(path), tempfile.TemporaryFile(dir=folder):
        pass


def write_whole(path: str | Path, content: str | bytes, *, overwrite: bool = True) -> None:
    """Write the file whole or not at all; a link is followed. Raises UsageError where it must not or cannot be."""
    check_target(path, overwrite=overwrite)
    target = Path(os.path.realpath(path))
    with writable(path), _temporary(target) as partial:
        with partial.open("xb") as stream:
            if target.exists():
                os.fchmod(stream.fileno(), target.stat().st_mode & 0o777)
            stream.write(content.encode("utf-8") if isinstance(content, str) else content)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(partial, target)


def make_folder(path: str | Path) -> Path:
    """The folder at `path`, made with those above it where it is missing. Raises UsageError where it cannot be."""
    folder = Path(path)
    with writable(folder):
        folder.mkdir(parents=True, exist_ok=True)
    return folder


@contextmanager
def whole_folder(path: str | Path) -> Iterator[Path]:
    """A new folder to fill, at `path` when the block ends well, else nowhere; UsageError where something is there."""
    target = Path(os.path.realpath(path))
    with writable(path), _temporary(target) as partial:
        if kind_of(path) is not None:  # checked here, so that what a dead process left beside it is removed first
            raise ExistingOutputError(f"{path} exists already and is left as it is. Choose another name or directory.")
        partial.mkdir()
        yield partial
        os.rename(partial, target)


@contextmanager
def writable(path: str | Path) -> Iterator[None]:
    """Turn what the system says against writing to `path` inside into a UsageError with the remedy."""
    try:
        yield
    except BrvHypoError:
        raise
    except OSError as error:
        remedy = _REMEDIES.get(error.errno or 0, "Choose another place.")
        raise UsageError(f"{path} cannot be written: {error.strerror or error}. {remedy}") from None


@contextmanager
def _temporary(target: Path) -> Iterator[Path]:
    """A path to write at, in a folder beside `target` named by host and process; those of dead ones are removed."""
    host = socket.gethostname().replace(".", "-")  # process numbers mean nothing on another
    left = re.compile(rf"\..+\.{re.escape(host)}\.(\d+)\.\w+{re.escape(SUFFIX)}")
    with suppress(OSError):
        for entry in target.parent.iterdir():
            if (found := left.fullmatch(entry.name)) and not _is_alive(int(found[1])):
                shutil.rmtree(entry, ignore_errors=True)
    prefix = f".{target.name[:30]}.{host}.{os.getpid()}."  # of the name a part, lest it become too long
    folder = Path(tempfile.mkdtemp(SUFFIX, prefix, target.parent))
    _open.add(folder)
    try:
        yield folder / "whole"
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        _open.discard(folder)


def remove_open_temporaries() -> None:
    """Remove what this process is writing: for an end that unwinds nothing."""
    for folder in list(_open):
        shutil.rmtree(folder, ignore_errors=True)


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except PermissionError:  # it lives, and is another user's
        return True
    except (ProcessLookupError, OverflowError):
        return False
    return True


def config_names(folder: str = "") -> tuple[str, ...]:
    """Names of the configurations that come with the program; `folder` holds those of another kind."""
    return tuple(sorted({file.stem for home in _HOMES for file in (home / folder).glob("*.yaml")}))


def config_path(name: str | Path, folder: str = "") -> Path:
    """The file of a configuration, by path or by one of `config_names`; raises UsageError with the nearest names."""
    if kind_of(name) not in (None, "a directory"):  # what is no file either is refused where it is read
        return Path(name)
    for home in _HOMES:
        for candidate in (home / folder / Path(name), home / folder / f"{name}.yaml"):
            if kind_of(candidate) == "a file":
                return candidate
    known = config_names(folder)
    hint = meant(Path(name).stem, known, f"those that come along: {', '.join(known)}.", 0.4, most=2)
    raise UsageError(f"no configuration file '{name}', and none of that name comes with the program; {hint}")
