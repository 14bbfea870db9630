"""A folder with little room: a small file system, where this process may mount one."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

AMPLE_BYTES = 256 << 20


@contextmanager
def small(folder: Path, room: int) -> Iterator[bool]:
    """Give the new folder `room` bytes while the block runs; yields False, and does nothing, where that cannot be."""
    folder.mkdir()
    mounted = _run("mount", "-t", "tmpfs", "-o", f"size={room}", "tmpfs", str(folder))
    try:
        yield mounted
    finally:
        if mounted:
            _run("umount", "-l", str(folder))


def freed(folder: Path) -> None:
    """Somebody made room on the small disk."""
    _run("mount", "-o", f"remount,size={AMPLE_BYTES}", str(folder))


def _run(*command: str) -> bool:
    if shutil.which(command[0]) is None:
        return False
    return subprocess.run(command, capture_output=True, check=False).returncode == 0
