"""6-DOF flights with planted mechanisms and instrument errors, the truth set apart.

simulate                        simulator.py: a configuration -> `SimulatedFlight`; Runge-Kutta, and the past
SimulationConfig, load_config   config.py: the schema of configs/*.yaml, its files
the equations of motion         vehicle.py: attitude, air, planted mechanisms
Appendix B                      instruments.py: record effects and noise
"""

from brv_hypo.io.files import config_names as config_names
from brv_hypo.io.files import config_path as config_path
from brv_hypo.simulation.config import SimulationConfig as SimulationConfig
from brv_hypo.simulation.config import load_config as load_config
from brv_hypo.simulation.simulator import SimulatedFlight as SimulatedFlight
from brv_hypo.simulation.simulator import Truth as Truth
from brv_hypo.simulation.simulator import simulate as simulate
