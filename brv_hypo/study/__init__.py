"""How often is the planted mechanism found? Many simulated flights, each compared, and the statistics of it.

config       what a study flies: the schema of configs/studies/*.yaml
planted_faults  faults of the record, injected in sound ones
draws        the flights of a study, each drawn from its own seed
trial        one flight: simulated, compared, noted as an `Outcome`
store        outcomes on disk, from which an interrupted study goes on
run          entrance: `run_study`; on this machine, or on a Dask cluster
statistics   `summarise`: confusion, calibration, detection limits, coverage, faults
"""

from brv_hypo.study.config import StudyConfig, read_study
from brv_hypo.study.run import run_study
from brv_hypo.study.statistics import StudySummary, summarise
from brv_hypo.study.trial import Outcome

__all__ = ["Outcome", "StudyConfig", "StudySummary", "read_study", "run_study", "summarise"]
