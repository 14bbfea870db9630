"""6-DOF flights with planted mechanisms and instrument errors, the truth set apart.

simulate                        simulator.py: a configuration -> `SimulatedFlight`
SimulationConfig, load_config   config.py: the schema of configs/*.yaml, its files
the equations of motion         vehicle.py: attitude, air, planted mechanisms
Runge-Kutta, and the past       integration.py
Appendix B                      instruments.py: record effects and noise
"""

from brv_hypo.simulation.config import SimulationConfig, config_names, config_path, load_config
from brv_hypo.simulation.simulator import SimulatedFlight, Truth, simulate

__all__ = ["SimulatedFlight", "SimulationConfig", "Truth", "config_names", "config_path", "load_config", "simulate"]
