"""Flight records: from a file to arrays in SI, uniform in time, with every change noted.

record.py       `Flight`, `Vehicle`, `RecordFault`, and what a valid record holds (pydantic)
tolerances.py   1-sigma tolerances of instruments, vehicle and air, by grade or stated
format.py       format 1 on disk: `load_flight`, `save_flight`, `load_truth`; what functions take for a flight
units.py        to SI, by pint
noise.py        the one estimate of white noise
cleaning.py     faults of single channels, masked on reading: stuck, clipped, dead, bursts, spikes
clock.py        uniform time, gaps, steps of the clock
derived.py      air data that follow from others; means of a record that is sampled too finely
inspection.py   phases of a rocket's flight; what a record holds and how good it is

Foreign records (csv, parquet, mat) come in through `brv_hypo.importing`.
"""

from brv_hypo.flight.format import FlightSource, Quantity, flights_of, load_flight, load_truth, one_flight, save_flight
from brv_hypo.flight.inspection import Inspection, Noise, Phase, find_phases, inspect_flight, white_noise
from brv_hypo.flight.record import CHANNELS, OPTIONAL_CHANNELS, Flight, RecordFault, RecordTrial, Vehicle
from brv_hypo.io.binary import Dataset, Tree, read_tree, write_tree

__all__ = [
    "CHANNELS",
    "OPTIONAL_CHANNELS",
    "Dataset",
    "Flight",
    "FlightSource",
    "Inspection",
    "Noise",
    "Phase",
    "Quantity",
    "RecordFault",
    "RecordTrial",
    "Tree",
    "Vehicle",
    "find_phases",
    "flights_of",
    "inspect_flight",
    "load_flight",
    "load_truth",
    "one_flight",
    "read_tree",
    "save_flight",
    "white_noise",
    "write_tree",
]
