"""One least-squares problem: rows for rates, for specific force, for priors; ranking and residual loop both use it.

build.py       entrance: from reconstructed flights to the problem
weakform.py    moments integrated to rates, so that no differentiation colours the noise
whitening.py   the noise model and its filter
frame.py       the frame of all flights
channels.py    rates and specific force, on parts of a record
propagated_motion.py  the motion to linearise about, and how noise lets its attitude wander
response.py    what a change of the record does to the residual
nuisance.py    the nuisance effects that are fitted in every hypothesis
problem.py     data, noise and what is projected out; noise.py estimates the noise; linear.py, uncertainty.py: solutions
reduced.py     nuisances and baseline projected out once, for search and refinement
fit.py         best subset of a hypothesis's columns (search.py); refinement.py moves delays and knots
unmodelled.py    shapes of a moment that no listed mechanism has, and one that turns in the body
moment_model.py, free_moment.py  the moment of a model, or a smooth one
held_out.py    prediction error on held-out blocks
"""
