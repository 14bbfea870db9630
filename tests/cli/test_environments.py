"""In any shell a command ends with a code of the contract: encodings, closed streams, no home, odd terminals."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys

import pytest

COMMAND = f"{shlex.quote(sys.executable)} -m brv_hypo"
VARIABLES = [
    *(f"PYTHONIOENCODING={name}" for name in ("latin-1", "ascii", "cp1252", "cp437", "utf-16", "ascii:strict")),
    *(f"LC_ALL={name}" for name in ("C", "POSIX", "C.UTF-8", "de_DE.ISO-8859-1", "tr_TR.UTF-8", "nonsense")),
    *("LC_ALL=C PYTHONUTF8=0 PYTHONCOERCECLOCALE=0", "LANG=", "LANGUAGE=xx", "TZ=nonsense"),
    *(f"TERM={name}" for name in ("dumb", "", "unknown", "xterm-256color")),
    *(f"COLUMNS={width}" for width in ("0", "1", "7", "20", "10000", "many", "-5")),
    *("NO_COLOR=1", "FORCE_COLOR=1", "CLICOLOR_FORCE=1", "CI=1", "LINES=0", "TTY_COMPATIBLE=1", "JUPYTER_COLUMNS=3"),
    *("PYTHONOPTIMIZE=2", "PYTHONWARNINGS=error", "PYTHONDEVMODE=1", "PYTHONUNBUFFERED=1", "PYTHONHASHSEED=0"),
    *("HOME=", "HOME=/nowhere", "-u HOME", "-u HOME -u USER -u LOGNAME", "-u PATH", "XDG_CACHE_HOME=/proc"),
    *("TMPDIR=/nowhere", "NUMBA_CACHE_DIR=/proc/x", "NUMBA_DISABLE_JIT=1", "NUMBA_NUM_THREADS=1", "OMP_NUM_THREADS=0"),
    *("MPLBACKEND=nonsense", "MPLCONFIGDIR=/proc/x", "HDF5_USE_FILE_LOCKING=TRUE", "_BRV_HYPO_COMPLETE=nonsense"),
]
STREAMS = [
    *("{} >&-", "{} 2>&-", "{} <&-", "{} >&- 2>&-", "{} <&- >&- 2>&-", "{} </dev/null", "{} 2>/dev/full", "nohup {}"),
    *("{} | head -1", "{} | true", "{} 2>&1 | head -c 1", "({}) &  wait $!", "umask 777; {}", "ulimit -n 32; {}"),
    "mkdir gone; cd gone; rmdir ../gone; {}",
]


def shell(line, tmp_path, *, before=""):
    """The exit code and standard error of a line of the shell."""
    paths = os.pathsep.join(path for path in sys.path if path)
    script = f"set -o pipefail; {before}{line}"
    return subprocess.run(
        ["bash", "-c", script], cwd=tmp_path, env={**os.environ, "PYTHONPATH": paths}, capture_output=True, check=False
    )


def allowed(done):
    """Done; or refused, or the reader of the pipe gone, in one line."""
    assert done.returncode in (0, 1, 2, 141), done.stderr
    assert b"Traceback" not in done.stderr
    assert b"fault of the program" not in done.stderr


@pytest.mark.thorough
@pytest.mark.parametrize("variables", VARIABLES)
@pytest.mark.parametrize("arguments", ["inspect {}", "reconstruct {} -o motion.h5", "docs start"])
def test_any_variables_are_fit_for_a_command(flight_file, tmp_path, variables, arguments):
    words = arguments.format(shlex.quote(str(flight_file)))
    allowed(shell(f"env {variables} {COMMAND} {words}", tmp_path))


@pytest.mark.thorough
@pytest.mark.parametrize("line", STREAMS)
@pytest.mark.parametrize("arguments", ["inspect {}", "reconstruct {} --json -", "docs verdict"])
def test_any_streams_are_fit_for_a_command(flight_file, tmp_path, line, arguments):
    words = arguments.format(shlex.quote(str(flight_file)))
    allowed(shell(line.format(f"{COMMAND} {words}"), tmp_path))
