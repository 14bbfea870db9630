"""Motion relative to the wind, and moments, from a flight record.

reconstruct(flight, config, perturbations) -> Reconstruction     pipeline.py
    gyros to attitude, accelerometers to c.g.     inertial.py
    the crossflow: joint, velocity, rates, polar  methods/
    what errors of the record make of it all      perturbation.py, effect_responses.py
    Euler's equations inverted                    moments.py
    the course of the axial force                 axial_force.py
    inputs freed of noise, and what is left of it inputs.py, smoothing.py
write_motion(reconstruction, path)                store.py
try_record(flight) -> flight, RecordTrial         trial.py, consistency.py, corrections.py
Motion: what a mechanism may know                 motion.py, history.py, frames.py
"""

from brv_hypo.motion.config import ReconstructionConfig
from brv_hypo.motion.motion import Motion
from brv_hypo.motion.perturbation import Perturbation
from brv_hypo.motion.pipeline import reconstruct
from brv_hypo.motion.reconstruction import EffectEstimate, MomentEstimate, Reconstruction
from brv_hypo.motion.store import write_motion
from brv_hypo.motion.trial import try_record

__all__ = [
    "EffectEstimate",
    "MomentEstimate",
    "Motion",
    "Perturbation",
    "Reconstruction",
    "ReconstructionConfig",
    "reconstruct",
    "try_record",
    "write_motion",
]
