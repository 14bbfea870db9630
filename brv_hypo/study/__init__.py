"""How often is the planted mechanism found? Many simulated flights, each compared, and the statistics of it."""

from brv_hypo.study.config import StudyConfig, read_study
from brv_hypo.study.run import Outcome, run_study
from brv_hypo.study.statistics import StudySummary, summarise

__all__ = ["Outcome", "StudyConfig", "StudySummary", "read_study", "run_study", "summarise"]
