"""`run_study`: every flight of a study, in parallel, each outcome kept at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path

from brv_hypo.mechanisms import plugin_files, use_plugin_files
from brv_hypo.study.config import StudyConfig
from brv_hypo.study.draws import Draw, check_names, draws
from brv_hypo.study.outcome import Outcome
from brv_hypo.study.store import Store
from brv_hypo.study.trial import fly
from brv_hypo.study.workers import on_cluster, on_this_machine

Progress = Callable[[int, int, Outcome], None]


def run_study(
    study: StudyConfig,
    folder: str | Path,
    *,
    jobs: int = 1,
    cluster: str | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
    note: Callable[[str], None] | None = None,
) -> tuple[Outcome, ...]:
    """Fly what `folder` does not hold yet; the outcomes of the whole study, in its order.

    `jobs` processes at once (-1: one for each processor), or the workers of the Dask scheduler at `cluster`.
    `progress` is called with flights done, flights in all and the latest outcome. A flight that fails is an
    outcome with its reason. Raises UsageError for a vehicle or planted set that does not exist, and where
    `folder` holds another study and `overwrite` is not set, or no scheduler answers. `note` is told what was
    dropped of the folder.
    """
    check_names(study)
    store = Store(Path(folder), study, overwrite=overwrite)
    wanted = draws(study)
    missing = [draw for draw in wanted if draw.key not in store.known()]
    if note is not None:
        for line in store.notes:
            note(line)
    with closing(store):
        spread = on_this_machine(jobs) if cluster is None else on_cluster(cluster)
        flown = spread(partial(_fly, study, plugin_files()), missing)
        for done, outcome in enumerate(flown, start=len(wanted) - len(missing) + 1):
            store.add(outcome)
            if progress is not None:
                progress(done, len(wanted), outcome)
    known = store.known()
    return tuple(known[draw.key] for draw in wanted)


def _fly(study: StudyConfig, plugins: Sequence[str], draw: Draw) -> Outcome:
    """One flight in whatever process this is, which has to know the plugins that are files."""
    if tuple(plugins) != plugin_files():
        use_plugin_files(plugins)
    return fly(study, draw)
