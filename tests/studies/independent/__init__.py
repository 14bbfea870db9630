"""Independent validation: flights, and what could be known from them, without the program's models.

- air.py, vehicles.py: standard atmosphere, slow wind, four vehicles and their start
- dynamics.py: six degrees of freedom with a history for delays
- mechanisms.py: what is planted, in the program's list (LISTED) and outside it (UNLISTED)
- instruments.py: errors of every row of the record's table, and what the sensors write down
- flights.py: `make_flight`, `draw_flight`, and a command that writes files
- oracle.py: `judge`, the detection limit and 2 ln L of truth over its rivals
- study.py: a command that counts how often `compare` is right
- effects.py, loop_study.py: every effect that `trace` tries, planted, and how often it is right
- descriptions.py: what is reported of effects that no plugin has, and what that does on a sister flight
- reporting.py: how studies by hand print what they find
- sisters.py, two_flights.py: what a model predicts of another vehicle, what two flights show that one cannot

Written from the conventions and the record's format alone.
"""
