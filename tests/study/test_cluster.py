"""A study on a Dask cluster: a real scheduler on this machine, two workers, of which one is killed."""

from __future__ import annotations

import os
import signal
import sys
import time

import pytest

from brv_hypo.errors import UnanswerableError, UsageError
from brv_hypo.study import read_study, run, run_study
from brv_hypo.study.run import spread
from tests.study.outcomes import stored
from tests.study.test_run import SMALL, VEHICLE


@pytest.fixture(scope="module")
def cluster():
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as found:
        yield found


def worker_of(seconds):
    """A call that says which process it was made in."""

    def call(item):
        time.sleep(seconds)
        return os.getpid(), item

    return call


@pytest.mark.thorough
def test_both_places_give_every_item_once(cluster):
    items = list(range(8))
    for address in (None, cluster.scheduler_address):
        found = list(spread(worker_of(0.01), items, cluster=address))
        assert sorted(item for _, item in found) == items


@pytest.mark.thorough
def test_what_a_killed_worker_was_at_is_done_by_another(cluster):
    found, killed = [], None
    for pid, item in spread(worker_of(0.2), list(range(12)), cluster=cluster.scheduler_address):
        found.append(item)
        if killed is None:
            killed = pid
            os.kill(pid, signal.SIGKILL)
    assert sorted(found) == list(range(12))


@pytest.mark.thorough
def test_an_item_that_ends_every_worker_is_given_up_with_its_reason(cluster):
    def deadly(item):
        os.kill(os.getpid(), signal.SIGKILL)

    with pytest.raises(UnanswerableError, match="goes on where it was"):
        list(spread(deadly, [1], cluster=cluster.scheduler_address))


@pytest.mark.thorough
def test_a_fault_in_a_call_reaches_the_caller(cluster):
    with pytest.raises(ZeroDivisionError):
        list(spread(lambda item: 1 // item, [0], cluster=cluster.scheduler_address))


@pytest.mark.thorough
def test_an_address_where_nothing_answers_is_refused(monkeypatch):
    monkeypatch.setattr(run, "CONNECT_SECONDS", 0.5)
    with pytest.raises(UsageError, match=r"no Dask scheduler answers at 'tcp://127\.0\.0\.1:1'"):
        list(spread(abs, [1], cluster="tcp://127.0.0.1:1"))


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UsageError, match=r"'.\[cluster\]'"):
        list(spread(abs, [1], cluster="tcp://127.0.0.1:1"))


@pytest.mark.slow
def test_a_study_outlives_a_worker_and_is_the_same_as_on_this_machine(cluster, tmp_path):
    (tmp_path / "cone.yaml").write_text(VEHICLE)
    (tmp_path / "small.yaml").write_text(SMALL.format(vehicle=tmp_path / "cone.yaml"))
    study = read_study(tmp_path / "small.yaml", flights=2)
    killed = []

    def progress(fraction, text):
        if not killed:
            victim = next(iter(cluster.workers.values()))
            killed.append(victim.pid)
            os.kill(victim.pid, signal.SIGKILL)

    there = run_study(study, tmp_path / "there", cluster=cluster.scheduler_address, progress=progress)
    here = run_study(study, tmp_path / "here", jobs=1)
    assert killed
    assert [o.draw for o in there] == [o.draw for o in here]
    for one, other in zip(there, here, strict=True):
        assert one.information == pytest.approx(other.information, rel=1e-9)
    assert len(stored(tmp_path / "there")) == 4
