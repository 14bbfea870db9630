"""6-DOF flights with planted mechanisms and instrument errors, the truth set apart.

simulate, simulate_batch        simulator.py: a configuration -> `SimulatedFlight` (result.py)
SimulationConfig                config.py: the schema of configs/*.yaml
load_config, config_path        loading.py: files and names; variation.py: flights that differ a little
the equations of motion         dynamics.py, on rotation.py and atmosphere.py; system.py builds them
planted mechanisms              planting.py, their past in history.py
Runge-Kutta                     integration.py
Appendix B                      instruments.py; what record effects add to it: errors.py, wind.py
"""

from brv_hypo.simulation.config import SimulationConfig
from brv_hypo.simulation.loading import config_names, config_path, load_config
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
