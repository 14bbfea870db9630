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
    """A valid record: 6 s at 100 Hz of the conformance kit's motion."""
    from brv_hypo.flight import save_flight

    path = tmp_path_factory.mktemp("record") / "flight.h5"
    save_flight(sample_flight(), path)
    return path


SHORT_FLIGHT = """
base: research_cone
title: short
duration: 3.0
sample_rate: 100.0
mechanisms:
  - {mechanism: sticking, theta: {delay: 0.12}, terms: {eps: 0.6}, start: 1.0, stop: 2.5}
"""


@pytest.fixture(scope="session")
def short_config(tmp_path_factory):
    """A simulation of 3 s with flow sticking planted from 1 to 2.5 s."""
    path = tmp_path_factory.mktemp("config") / "short.yaml"
    path.write_text(SHORT_FLIGHT)
    return path


@pytest.fixture(scope="session")
def simulated_file(brv_hypo, short_config, tmp_path_factory):
    """A flight of the short configuration."""
    path = tmp_path_factory.mktemp("simulated") / "flight.h5"
    done = brv_hypo("simulate", short_config, "-o", path, "--seed", 4)
    assert done.returncode == 0, done.stderr
    return path
