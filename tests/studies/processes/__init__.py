"""A trial of processes with estimated amplitudes in every hypothesis, on the searched fits of `compare`.

It shows what the next inference engine has to do, and no more: it takes the columns that today's search found for each
hypothesis and asks for their marginal likelihood beside processes (`evidence.py`), whose shapes stand in `shapes.py`.
`study.py` runs it on independent flights with imperfections that no list of tolerances holds.
"""
