"""From motion to the columns of one least-squares problem.

timebasis.py  how a coefficient changes in time: constant, jump, ramp
baseline.py   the terms that are always fitted along
columns.py    the candidates of a mechanism
weakform.py   moments integrated to rates, so that no differentiation colours the noise
whitening.py  the noise model and its filter
frame.py      the frame of all flights: entrance
"""
