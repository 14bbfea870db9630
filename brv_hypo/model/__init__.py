"""A model's parts: its terms, how their coefficients vary in time, and the baseline that every model holds.

term.py            a term at its nonlinear parameters with a basis in time; the one sum of these
baseline.py        static moment with drift and cubic part, pitch damping; a smooth change of these with Mach number
model.py           a model as a value that adds with +, and its file
aero_table.py      a user's table of the static slope, and increments to it within its uncertainty
common_time.py     the time that several flights of one design share
reconstruction.py  motion and moments of a flight, its record known to its tolerances
"""
