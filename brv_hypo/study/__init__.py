"""How often is the planted mechanism found? Many simulated flights, each compared, and the statistics of it.

config       what a study flies: the schema of configs/studies/*.yaml, faults of records, each flight's draw
run          entrance: `run_study`, on this machine or on a Dask cluster; each flight an `Outcome`, on disk at once
statistics   `summarise`: confusion, calibration, detection limits, faults
"""

from brv_hypo.study.config import StudyConfig, read_study
from brv_hypo.study.run import Outcome, run_study
from brv_hypo.study.statistics import StudySummary, summarise

__all__ = ["Outcome", "StudyConfig", "StudySummary", "read_study", "run_study", "summarise"]
