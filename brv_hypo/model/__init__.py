"""A model's parts: its terms, how their coefficients vary in time, and the baseline that every model holds."""
