"""Motion relative to the wind, and moments, from a flight record.

reconstruct(flight, config, perturbations) -> Reconstruction     pipeline.py; Euler's equations inverted
    gyros to attitude, accelerometers to the c.g.                inertial.py
    the crossflow                                                methods/, with the options: joint, open_loop
    what the joint method rests on                               smoother.py
    sensitivity to errors of the record                          responses.py
    the result, and its file                                     reconstruction.py
    measured inputs freed of noise                               inputs.py
try_record(flight) -> flight, RecordTrial                        compatibility.py
Motion: what a mechanism may know; axes and angles               motion.py
on                                                               signals.py, interpolation.py
"""

from brv_hypo.motion.compatibility import try_record as try_record
from brv_hypo.motion.methods import ReconstructionConfig as ReconstructionConfig
from brv_hypo.motion.motion import Motion as Motion
from brv_hypo.motion.pipeline import reconstruct as reconstruct
from brv_hypo.motion.reconstruction import EffectEstimate as EffectEstimate
from brv_hypo.motion.reconstruction import MomentEstimate as MomentEstimate
from brv_hypo.motion.reconstruction import Reconstruction as Reconstruction
from brv_hypo.motion.reconstruction import write_motion as write_motion
from brv_hypo.motion.responses import Perturbation as Perturbation
