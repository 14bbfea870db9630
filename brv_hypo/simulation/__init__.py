"""6-DOF flights with planted mechanisms and instrument errors, the truth set apart.

simulate, simulate_batch        simulator.py: a configuration -> `SimulatedFlight`
SimulationConfig, load_config   config.py: the schema of configs/*.yaml, its files, flights that differ a little
the equations of motion         vehicle.py: attitude, air, planted mechanisms
Runge-Kutta, and the past       integration.py
Appendix B                      instruments.py: record effects and noise
"""

from brv_hypo.simulation.config import SimulationConfig, config_names, config_path, load_config
from brv_hypo.simulation.simulator import SimulatedFlight, Truth, simulate, simulate_batch

__all__ = [
    "SimulatedFlight",
    "SimulationConfig",
    "Truth",
    "config_names",
    "config_path",
    "load_config",
    "simulate",
    "simulate_batch",
]
