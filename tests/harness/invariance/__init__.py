"""What no verdict may depend on: units, last digits, axes, origin of time, handedness, order, threads, scale, copies.

chain.py    short flights, their comparisons, and how far apart two comparisons are
changes.py  the same flight in other units, axes and times
laws.py     what holds of the two comparisons, and how exactly
"""
