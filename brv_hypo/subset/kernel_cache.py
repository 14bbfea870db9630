"""Whether the compiled kernel of an earlier process is on disk, told without importing numba."""

from __future__ import annotations

import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

# First bytes of an index of numba's, in which it names its version.
HEAD = 64


@cache
def kernel_on_disk(folder: Path | None = None) -> bool:
    """Whether an index of this Python and numba, no older than the kernel's source, lies in `folder`.

    A kernel that was compiled on another processor passes: then it is compiled anew, once, a few nodes too early.
    Indices that numba keeps elsewhere, by its own settings, are not looked for. Looked for once in a process, which may
    search hundreds of times.
    """
    source = Path(__file__).with_name("kernel.py")
    python = f"py{sys.version_info.major}{sys.version_info.minor}"
    try:
        compiler = version("numba").encode()
        indices = (folder or source.parent / "__pycache__").glob(f"kernel.search-*.{python}.nbi")
        return any(_serves(index, source, compiler) for index in indices)
    except (PackageNotFoundError, OSError):
        return False


def _serves(index: Path, source: Path, compiler: bytes) -> bool:
    with index.open("rb") as stream:
        return compiler in stream.read(HEAD) and index.stat().st_mtime >= source.stat().st_mtime
