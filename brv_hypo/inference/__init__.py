"""One marginal likelihood of a hypothesis beside processes of estimated amplitude, and the search that leads there.

build.py       entrance: from reconstructed flights to the problem (problem.py, noise.py, bordered.py)
fit.py         best subset of a hypothesis's columns (search.py, reduced.py), and its errors; refinement.py moves delays
               and knots
rows.py        what was observed and what may explain it beside processes, as whitened rows
marginal.py    all that is linear in these integrated out, at given amplitudes
evidence.py    the evidence of a hypothesis, maximised over amplitudes; all that is stated is read off it
derivatives.py the moment as a function of Mach number and alpha; unmodelled.py shapes that no listed mechanism has
held_out.py    prediction error on held-out blocks
"""

from brv_hypo.inference.evidence import Evidence, maximised
from brv_hypo.inference.rows import ProcessGroup, Rows, rows_of

__all__ = ["Evidence", "ProcessGroup", "Rows", "maximised", "rows_of"]
