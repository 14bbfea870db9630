"""Flight records: from a file to arrays in SI, uniform in time, with every change noted.

- `load_flight`, `save_flight`, `load_truth` (store.py): format 1 in and out, on hdf5.py and units.py
- `Flight`, `Vehicle` (record.py): what the rest of the library sees
- `one_flight`, `flights_of` (sources.py): what functions take for a flight
- schema.py: what a valid record holds (pydantic)
- assemble.py: from record to flight through spikes.py, resample.py (gaps too) and derive.py
- faults.py: faults of single channels, masked on reading, by stuck.py, bursts.py and clock.py; `RecordTrial`
- averaging.py: means of a record that is sampled far more finely than its motion needs
- noise.py: the one estimate of white noise
- `inspect_flight`, `white_noise`, `despiked` (quality.py, spikes.py): what a record holds and how good it is
- `import_record`, `bring_in` (foreign.py): csv, parquet and mat (tables.py) through a map (record_map.py); clocks.py,
  pad.py, ascent.py and decimate.py do what a raw log needs; foreign_vehicle.py reads masses and tolerances
- `guess_map` (guess.py): a commented map, by names (guess_names.py) and by physics (guess_physics.py)
- `find_phases` (phases.py): pad, burn, coast and parachute of a rocket's flight
- `write_tree`, `Tree`, `Dataset` (hdf5.py): any other HDF5 output, with units, whole or not at all
"""

from brv_hypo.flight.faults import RecordFault, RecordTrial
from brv_hypo.flight.foreign import Imported, bring_in, import_record
from brv_hypo.flight.hdf5 import Dataset, Tree, read_tree, write_tree
from brv_hypo.flight.phases import Phase, find_phases
from brv_hypo.flight.quality import Inspection, Noise, inspect_flight, white_noise
from brv_hypo.flight.record import CHANNELS, OPTIONAL_CHANNELS, Flight, Vehicle
from brv_hypo.flight.sources import FlightSource, flights_of, one_flight
from brv_hypo.flight.spikes import despiked
from brv_hypo.flight.store import Quantity, load_flight, load_truth, save_flight

__all__ = [
    "CHANNELS",
    "OPTIONAL_CHANNELS",
    "Dataset",
    "Flight",
    "FlightSource",
    "Imported",
    "Inspection",
    "Noise",
    "Phase",
    "Quantity",
    "RecordFault",
    "RecordTrial",
    "Tree",
    "Vehicle",
    "bring_in",
    "despiked",
    "find_phases",
    "flights_of",
    "import_record",
    "inspect_flight",
    "load_flight",
    "load_truth",
    "one_flight",
    "read_tree",
    "save_flight",
    "white_noise",
    "write_tree",
]
