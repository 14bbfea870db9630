"""A model as a value: its terms, how their coefficients vary in time, and the baseline that every model holds.

time_variation.py  how a coefficient changes in time: constant, jump, ramp
columns.py         the candidates of a mechanism
baseline.py        the terms that are always fitted along
slope_schedule.py  a smooth change of its slope and bend with Mach number, known by a prior
aero_table.py      a user's table of the static slope, and increments to it within its uncertainty
reconstruction.py  motion and moments of a flight, its record known to its tolerances
"""
