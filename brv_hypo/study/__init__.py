"""How often is the planted mechanism found? Many simulated flights, each compared, and the statistics of it.

config.py        what a study flies: the schema of configs/studies/*.yaml
draws.py         the flights of a study, each drawn from its own seed
trial.py         one flight: simulated, compared, noted as an `Outcome` (outcome.py)
effect.py        how much of the moment a planted mechanism is
parameters.py    planted values and their estimates
store.py         outcomes on disk, from which an interrupted study goes on
run.py           entrance: `run_study`
workers.py       in parallel: on this machine, or on a Dask cluster
planted_faults.py    faults of the record; faulty.py what they do to verdicts; record_faults.py a count of its own
confusion.py, calibration.py, detection.py, coverage.py, shares.py    the statistics
summary.py       `summarise` gathers them
"""

from brv_hypo.study.config import StudyConfig, read_study
from brv_hypo.study.outcome import Outcome
from brv_hypo.study.run import run_study
from brv_hypo.study.summary import StudySummary, summarise

__all__ = ["Outcome", "StudyConfig", "StudySummary", "read_study", "run_study", "summarise"]
