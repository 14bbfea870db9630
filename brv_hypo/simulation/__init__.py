"""6-DOF flights with planted mechanisms and instrument errors, the truth set apart.

simulate, simulate_batch        simulator.py: a configuration -> `SimulatedFlight` (result.py)
SimulationConfig, load_config   config.py: the schema of configs/*.yaml, its files, flights that differ a little
the equations of motion         vehicle.py, on rotation.py and air.py
planted mechanisms              planted.py
Runge-Kutta, and the past       integration.py
Appendix B                      instruments.py: record effects and noise
"""

from brv_hypo.simulation.config import SimulationConfig, config_names, config_path, load_config
from brv_hypo.simulation.result import SimulatedFlight, Truth
from brv_hypo.simulation.simulator import simulate, simulate_batch

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
