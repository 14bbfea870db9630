"""One marginal likelihood of a hypothesis beside processes of estimated amplitude.

rows.py      what was observed and what may explain it, as whitened rows
evidence.py  the evidence of a hypothesis, maximised over amplitudes; coefficients, processes and errors are read off it
"""

from brv_hypo.inference.evidence import Evidence, maximised
from brv_hypo.inference.rows import Group, Rows, rows_of

__all__ = ["Evidence", "Group", "Rows", "maximised", "rows_of"]
