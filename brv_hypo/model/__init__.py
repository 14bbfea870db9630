"""A model's parts: its terms, how their coefficients vary in time, and the baseline that every model holds.

term.py            a term at its nonlinear parameters with a basis in time; candidates; the one sum, a model's moment
baseline.py        static moment with drift and cubic part, pitch damping
slope_schedule.py  a smooth change of slope and cubic part with Mach number: a Gaussian process, by its leading terms
aero_table.py      a user's table of the static slope, and increments to it within its uncertainty
common_time.py     the time that several flights of one design share
reconstruction.py  motion and moments of a flight, its record known to its tolerances
"""
