"""Flight records: from a file to arrays in SI, uniform in time, with every change noted.

load_flight / save_flight / load_truth      store.py: format 1 in and out, on hdf5.py and units.py
Flight, Vehicle                             record.py: what the rest of the library sees
Record                                      schema.py: what a valid record holds (pydantic)
assemble.py                                 the chain from Record to Flight:
    spikes.py -> resample.py -> derive.py       despike, make uniform, bridge or cut gaps, derive channels
write_tree, Tree, Dataset                   hdf5.py: any other HDF5 output, written atomically
"""

from brv_hypo.flight.hdf5 import Dataset, Tree, read_tree, write_tree
from brv_hypo.flight.record import CHANNELS, OPTIONAL_CHANNELS, Flight, Vehicle
from brv_hypo.flight.spikes import despiked
from brv_hypo.flight.store import Quantity, load_flight, load_truth, save_flight

__all__ = [
    "CHANNELS",
    "OPTIONAL_CHANNELS",
    "Dataset",
    "Flight",
    "Quantity",
    "Tree",
    "Vehicle",
    "despiked",
    "load_flight",
    "load_truth",
    "read_tree",
    "save_flight",
    "write_tree",
]
