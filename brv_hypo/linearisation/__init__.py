"""What a change of the record or of a moment does to rates and specific force, to first order.

weakform.py    moments integrated to rates, so that no differentiation colours the noise
whitening.py   the noise model and its filter; frame.py the frame of all flights; channels.py parts of a record
moment_model.py    the moment of a model, and its slopes
propagated_motion.py  the motion to linearise about, and how noise lets its attitude wander
response.py    what a change of the record does to the residual; nuisance.py those of the nuisance effects
"""
