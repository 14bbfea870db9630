"""Motion relative to the wind, and moments, from a flight record.

    reconstruct(flight, config)  -> Reconstruction          pipeline.py
        inertial.py       gyros to attitude, accelerometers to the c.g., noise levels
        methods/          the crossflow: joint, velocity, rates, polar
        moments.py        Euler's equations inverted
    write_motion(reconstruction, path)                      store.py
    Motion                what a mechanism may know         motion.py, history.py, frames.py
"""

from brv_hypo.motion.config import ReconstructionConfig
from brv_hypo.motion.motion import Motion
from brv_hypo.motion.pipeline import reconstruct
from brv_hypo.motion.reconstruction import MomentEstimate, Reconstruction

__all__ = ["MomentEstimate", "Motion", "Reconstruction", "ReconstructionConfig", "reconstruct"]
