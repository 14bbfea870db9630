"""Motion relative to the wind, and moments, from a flight record: `reconstruct` (pipeline.py), the crossflow by one of
methods/; whether a record contradicts itself: `try_record`; what a mechanism may know of a motion: `Motion`.
"""

from brv_hypo.motion.compatibility import try_record as try_record
from brv_hypo.motion.methods import ReconstructionConfig as ReconstructionConfig
from brv_hypo.motion.motion import Motion as Motion
from brv_hypo.motion.pipeline import reconstruct as reconstruct
from brv_hypo.motion.reconstruction import Reconstruction as Reconstruction
from brv_hypo.motion.reconstruction import write_motion as write_motion
from brv_hypo.motion.responses import Perturbation as Perturbation
