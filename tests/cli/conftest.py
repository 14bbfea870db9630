"""The command line as a user runs it: a process with its own output streams and exit code."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from brv_hypo.mechanisms.conformance import sample_flight


@pytest.fixture(scope="session")
def brv_hypo():
    """Run `brv-hypo` with arguments; gives the finished process."""

    def run(*arguments, cwd=None, **variables):
        paths = os.pathsep.join(path for path in sys.path if path)
        return subprocess.run(
            [sys.executable, "-m", "brv_hypo", *map(str, arguments)],
            cwd=cwd,
            env={**os.environ, "PYTHONPATH": paths, "COLUMNS": "100", **variables},
            capture_output=True,
            text=True,
            check=False,
        )

    return run


@pytest.fixture(scope="session")
def flight_file(tmp_path_factory):
    """A valid record: 3 s at 100 Hz of the conformance kit's motion."""
    from brv_hypo.flight import save_flight

    path = tmp_path_factory.mktemp("record") / "flight.h5"
    save_flight(sample_flight(), path)
    return path
