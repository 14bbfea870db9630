"""Every constant that decides a verdict, with its source; the studies named set or confirmed them.

The study of independent flights (`python -m tests.independent.study`) judges them together.
"""

from __future__ import annotations

# Posterior probability from which a hypothesis is named, or none adequate; convention of the verdicts that users quote.
WINNING_PROBABILITY = 0.9
# Posterior probability from which a rival stands beside the leader.
STANDING_PROBABILITY = 0.02
# Prior probability that something outside the list moved the vehicle (contract of `compare --json`).
OTHER_PRIOR = 0.2
# Widens the posterior for what the linearised likelihood does not know (second-order errors of motion and instruments).
TEMPERATURE = 1.5
# Fall of 2 ln L that the weakest "something else" is expected to bring: the detection limit's F.
DETECTABLE = 25.0
# Sizes of "something else" tried above the weakest one, each twice the one before: to 64 times.
OTHER_SIZES = 7
# Gain in 2 ln L that "something else" has at most on sound flights, above which it is believed: 8 lets 107 of 108 sound
# flights keep their name (drawn errors of one and of two tolerances; the largest gain was 0.8). The same is asked of
# what stands instead of the leader: without it `none` is named in 29 % of empty flights, with it in 47 % (seed 71000).
OTHER_FLOOR = 8.0
# Share of a shape's rms beyond what a listed mechanism reproduces, from which the shape is something else. The studies
# call an effect reproduced by what holds 90 % of it.
OUTSIDE = 0.1
# Times at which a leader may change for one stretch: it begins and ends. With more, it may follow what turns.
ONE_STRETCH = 2
# Share of the fall of 2 ln L that the leader brings which errors of second order (of motion and instruments, in its own
# columns) may leave: 1.4 % of its contribution's rms. On those flights they leave less than shows, to falls of 22,000.
SECOND_ORDER = 2e-4
# The same for values: of the squares of errors (in tolerances) that the data ask of record and vehicle, and of the
# square of a coefficient, 7 % of itself. Not set by those flights: it only keeps names from being refused.
SECOND_ORDER_VALUES = 5e-3
# How often a record is linearised about the errors that it shows, and the tolerances by which the next estimate of one
# of them may differ before it is done again: 4 left 450 in 2 ln L, 3 left 13, below 1 nothing (industrial instruments).
MOST_LINEARISATIONS = 4
SETTLED_ERRORS = 1.0
# Sigma that the instruments' noise shows at the motion's frequency, over that of neighbouring samples, from which the
# motion is reconstructed with it: correlations of neighbouring samples above 0.2.
COLOURED = 1.5
# Fall of 2 ln L that the leader brings from which the problem is linearised about it.
LINEARISED_AGAIN = 2400.0
# Fall of 2 ln L of what the leader leaves below which another linearisation has changed nothing.
SETTLED = 12.0
# How often the problem is linearised about what explains much of the flight, while that lowers what is left.
LINEARISATIONS = 2
# Standard errors of the noise's own level by which rates may be louder than it.
LEVEL_SIGMAS = 3.0
# Probability of the errors that the data ask of record and vehicle, under their tolerances, below which the record is
# not what its tolerances say, or the flight too far from what is linear in them.
IMPROBABLE_ERRORS = 1e-4
# Fall of 2 ln L of the 95 % one-sided limit of an amplitude (chi-squared of one degree, 90 % two-sided).
LIMIT_FALL = 2.71
# Standard errors by which a coefficient may lie outside its mechanism's bounds.
BOUND_SIGMAS = 3.0
# Numbers of blocks of which one is left out in turn, to see whether the same hypothesis leads.
REPETITIONS = (8, 12)
# Errors of what is told of vehicle and air, of which each is taken a tolerance higher and lower in turn for the same.
REPEATED_ERRORS = ("inertia", "inertia_ratio", "dynamic_pressure_scale")
# Spacings by which all knots are moved, and refined again, for the same: no grid lies farther from another.
KNOT_SHIFTS = (-0.5, 0.5)
# Criterion behind the leader up to which the knots of rivals are moved as well: a factor of 3e-15 in probability.
REPEATED_WITHIN = 100.0
# Stated errors of another reconstruction method by which the accelerometers may contradict it before it has failed.
METHOD_SIGMAS = 3.0
# Legendre degree in time of the drift of C_Nalpha: a speed that falls by a tenth bends it beyond a parabola.
SLOPE_DEGREE = 3
# Share of the speed by which it may depart from such a polynomial before C_Nalpha follows it too: stiffness follows
# Mach number about in proportion, and a change of it of a few parts in ten thousand of the moment is not seen.
WAVERING_SPEED = 5e-5
