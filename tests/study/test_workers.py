"""Worker processes and the process that they work for."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from brv_hypo.study.run import spread
from tests.harness.kill.victim import orphans_of

# Workers take seconds to begin: a parent that dies before has given them nothing to do.
KILLED_EARLY = """
import os, signal, sys, threading, time
sys.path[:0] = {paths!r}
from brv_hypo.study.run import spread

threading.Timer({after}, os.kill, (os.getpid(), signal.SIGKILL)).start()
list(spread(time.sleep, [0.5] * 100, jobs=2))
"""


@pytest.mark.thorough
@pytest.mark.parametrize("after", [0.2, pytest.param(0.6, marks=pytest.mark.slow)])
def test_workers_end_with_a_parent_that_is_killed_before_it_gave_them_anything_to_do(after: float):
    code = KILLED_EARLY.format(paths=sys.path, after=after)
    process = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.DEVNULL, start_new_session=True)
    assert process.wait(60.0) == -signal.SIGKILL
    assert orphans_of(process.pid) == []


@pytest.mark.thorough
def test_workers_ignore_interrupts_from_the_keyboard():
    assert set(spread(signal.getsignal, [signal.SIGINT] * 4, jobs=2)) == {signal.SIG_IGN}
