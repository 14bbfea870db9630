"""In any shell a command ends with a code of the contract: encodings, closed streams, no home, odd terminals."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

VARIABLES = [
    *(f"PYTHONIOENCODING={name}" for name in ("latin-1", "ascii", "cp1252", "cp437", "utf-16", "ascii:strict")),
    *(f"LC_ALL={name}" for name in ("C", "POSIX", "C.UTF-8", "de_DE.ISO-8859-1", "tr_TR.UTF-8", "nonsense")),
    *("LC_ALL=C PYTHONUTF8=0 PYTHONCOERCECLOCALE=0", "LANG=", "LANGUAGE=xx", "TZ=nonsense", "LINES=0"),
    *(f"TERM={name}" for name in ("dumb", "", "unknown", "xterm-256color")),
    *(f"COLUMNS={width}" for width in ("0", "1", "7", "20", "10000", "many", "-5")),
    *("NO_COLOR=1", "FORCE_COLOR=1", "CLICOLOR_FORCE=1", "CI=1", "TTY_COMPATIBLE=1", "JUPYTER_COLUMNS=3"),
    *("PYTHONOPTIMIZE=2", "PYTHONWARNINGS=error", "PYTHONDEVMODE=1", "PYTHONUNBUFFERED=1", "PYTHONHASHSEED=0"),
    *("HOME=", "HOME=/nowhere", "-u HOME", "-u HOME -u USER -u LOGNAME", "-u PATH", "XDG_CACHE_HOME=/proc"),
    *("TMPDIR=/nowhere", "NUMBA_CACHE_DIR=/proc/x", "NUMBA_DISABLE_JIT=1", "NUMBA_NUM_THREADS=1", "OMP_NUM_THREADS=0"),
    *("MPLBACKEND=nonsense", "MPLCONFIGDIR=/proc/x", "HDF5_USE_FILE_LOCKING=TRUE", "_BRV_HYPO_COMPLETE=nonsense"),
]
STREAMS = [
    *("{} >&-", "{} 2>&-", "{} <&-", "{} >&- 2>&-", "{} <&- >&- 2>&-", "{} </dev/null", "{} 2>/dev/full", "nohup {}"),
    *("{} | head -1", "{} | true", "{} 2>&1 | head -c 1", "{} & wait $!", "umask 777; {}", "ulimit -n 32; {}"),
    *("mkdir gone; cd gone; rmdir ../gone; {}", "chmod 555 .; {}"),
]
LINES = [*(f"env {variables} {{}}" for variables in VARIABLES), *STREAMS]
THOROUGH = {"env PYTHONIOENCODING=ascii {}"}  # the slow tests have all others: each takes 5 s


def _when(line: str) -> pytest.MarkDecorator:
    return pytest.mark.thorough if line in THOROUGH else pytest.mark.slow


@pytest.mark.parametrize("line", [pytest.param(line, marks=_when(line), id=line) for line in LINES])
def test_no_shell_is_a_fault_of_the_program(flight_file, tmp_path, line):
    paths = os.pathsep.join(path for path in sys.path if path)
    for arguments in (f"inspect {flight_file}", f"reconstruct {flight_file} --stop 1.5 --json -", "docs verdict"):
        command = line.format(f"{sys.executable} -m brv_hypo {arguments}")
        environment = {**os.environ, "PYTHONPATH": paths}
        done = subprocess.run(
            ["bash", "-o", "pipefail", "-c", command], cwd=tmp_path, env=environment, capture_output=True
        )
        assert done.returncode in (0, 1, 2, 141), done.stderr
        assert b"Traceback" not in done.stderr
        assert b"fault of the program" not in done.stderr
