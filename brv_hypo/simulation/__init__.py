"""6-DOF flights with planted mechanisms and instrument errors, the truth set apart."""

from brv_hypo.io.files import config_names as config_names
from brv_hypo.io.files import config_path as config_path
from brv_hypo.simulation.config import SimulationConfig as SimulationConfig
from brv_hypo.simulation.config import load_config as load_config
from brv_hypo.simulation.simulator import SimulatedFlight as SimulatedFlight
from brv_hypo.simulation.simulator import Truth as Truth
from brv_hypo.simulation.simulator import simulate as simulate
