"""What a change of the record or of a moment does to rates and specific force, to first order.

frame.py       moments integrated to rates, so that no differentiation colours the noise
channels.py    rates and force, parts of a record, their noise and its filter
moment_model.py    the moment of a model, and its slopes
response.py    the motion to linearise about, what a change of the record does; nuisance.py: nuisance effects
"""
