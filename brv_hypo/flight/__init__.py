"""Flight records: from a file to arrays in SI, uniform in time, with every change noted.

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
