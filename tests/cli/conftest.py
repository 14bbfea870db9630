"""The command line as a user runs it: in this process, or as one with its own output streams and exit code."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from dataclasses import dataclass

import pytest
from typer.testing import CliRunner

from brv_hypo.cli.main import app
from brv_hypo.mechanisms.conformance import sample_flight

TERMINAL = {"COLUMNS": "100"}


@dataclass(frozen=True)
class Done:
    """A finished command, with the names of `subprocess.CompletedProcess`."""

    returncode: int
    stdout: str
    stderr: str


@pytest.fixture(scope="session")
def brv_hypo():
    """Run `brv-hypo` with arguments in this process, without the second that the imports of a new one take."""

    def run(*arguments, cwd=".", **variables):
        with contextlib.chdir(cwd):
            done = CliRunner().invoke(
                app, [*map(str, arguments)], prog_name="brv-hypo", env={**TERMINAL, **variables}, catch_exceptions=False
            )
        return Done(done.exit_code, done.stdout, done.stderr)

    return run


@pytest.fixture(scope="session")
def brv_hypo_process():
    """Run `brv-hypo` with arguments as a process of its own; gives the finished process."""

    def run(*arguments, cwd=None, **variables):
        paths = os.pathsep.join(path for path in sys.path if path)
        return subprocess.run(
            [sys.executable, "-m", "brv_hypo", *map(str, arguments)],
            cwd=cwd,
            env={**os.environ, "PYTHONPATH": paths, **TERMINAL, **variables},
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
step: 0.01
mechanisms:
  - {mechanism: sticking, theta: {delay: 0.12}, terms: {eps: 0.6}, start: 1.0, stop: 2.5}
"""


@pytest.fixture(scope="session")
def short_config(tmp_path_factory):
    """A simulation of 3 s with flow sticking planted from 1 to 2.5 s."""
    path = tmp_path_factory.mktemp("config") / "short.yaml"
    path.write_text(SHORT_FLIGHT)
    return path


BRIEF_FLIGHT = """
base: research_cone
title: brief
duration: 0.5
sample_rate: 100.0
step: 0.01
mechanisms: [{mechanism: sticking, theta: {delay: 0.12}, terms: {eps: 0.6}, start: 0.2}]
"""


@pytest.fixture(scope="session")
def brief_config(tmp_path_factory):
    """A simulation of half a second, for what does not depend on the flight."""
    path = tmp_path_factory.mktemp("config") / "brief.yaml"
    path.write_text(BRIEF_FLIGHT)
    return path


@pytest.fixture(scope="session")
def simulated_file(brv_hypo, short_config, tmp_path_factory):
    """A flight of the short configuration."""
    path = tmp_path_factory.mktemp("simulated") / "flight.h5"
    done = brv_hypo("simulate", short_config, "-o", path, "--seed", 4)
    assert done.returncode == 0, done.stderr
    return path


CONE = "base: research_cone\nduration: 3.0\nsample_rate: 100.0\nstep: 0.01"


@pytest.fixture(scope="session")
def planted(brv_hypo, tmp_path_factory):
    """A simulation with a body-fixed moment chosen by name: the finished command, and its flight."""
    folder = tmp_path_factory.mktemp("planted")
    (folder / "cone.yaml").write_text(CONE)
    done = brv_hypo("simulate", "cone.yaml", "--plant", "bodyfixed", "-o", "f.h5", "--json", "-", cwd=folder)
    assert done.returncode == 0, done.stderr
    return done, folder / "f.h5"


@pytest.fixture(scope="session")
def planted_file(planted):
    return planted[1]


@pytest.fixture(scope="session")
def nominal_file(brv_hypo, tmp_path_factory):
    """The same with nothing planted: a comparison of it takes a second, as nothing outside its list is looked for."""
    folder = tmp_path_factory.mktemp("nominal")
    (folder / "cone.yaml").write_text(CONE)
    done = brv_hypo("simulate", "cone.yaml", "-o", "f.h5", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / "f.h5"
