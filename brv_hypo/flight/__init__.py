"""Flight records: from a file to arrays in SI, uniform in time, with every change noted.

record.py       `Flight`, `Vehicle`, `RecordFault`, and what a valid record holds (pydantic)
tolerances.py   1-sigma tolerances of instruments, vehicle and air, by grade or stated
format.py       format 1 on disk: `load_flight`, `save_flight`; what functions take for a flight
units.py        to SI, by pint
cleaning.py     faults of single channels, masked on reading: stuck, clipped, dead, bursts, spikes
clock.py        uniform time, gaps, steps of the clock, white noise
derived.py      air data that follow from others; means of a record that is sampled too finely
plausibility.py physics that no record breaks; how the inertial unit is mounted in the vehicle
inspection.py   phases of a rocket's flight; what a record holds and how good it is

Foreign records (csv, parquet, mat) come in through `brv_hypo.importing`.
"""

from brv_hypo.flight.format import FlightSource as FlightSource
from brv_hypo.flight.format import Quantity as Quantity
from brv_hypo.flight.format import flights_of as flights_of
from brv_hypo.flight.format import load_flight as load_flight
from brv_hypo.flight.format import one_flight as one_flight
from brv_hypo.flight.format import save_flight as save_flight
from brv_hypo.flight.inspection import find_phases as find_phases
from brv_hypo.flight.inspection import inspect_flight as inspect_flight
from brv_hypo.flight.inspection import white_noise as white_noise
from brv_hypo.flight.record import CHANNELS as CHANNELS
from brv_hypo.flight.record import OPTIONAL_CHANNELS as OPTIONAL_CHANNELS
from brv_hypo.flight.record import Flight as Flight
from brv_hypo.flight.record import Vehicle as Vehicle
from brv_hypo.io.binary import read_tree as read_tree
