"""Mechanisms as plugins: contract.py is what an author needs; template/ is what `brv-hypo mechanisms new` fills in."""

from brv_hypo.mechanisms.contract import Component as Component
from brv_hypo.mechanisms.contract import Delays as Delays
from brv_hypo.mechanisms.contract import Derived as Derived
from brv_hypo.mechanisms.contract import Mechanism as Mechanism
from brv_hypo.mechanisms.contract import MomentProcess as MomentProcess
from brv_hypo.mechanisms.contract import Parameter as Parameter
from brv_hypo.mechanisms.contract import RecordEffect as RecordEffect
from brv_hypo.mechanisms.contract import RecordProcess as RecordProcess
from brv_hypo.mechanisms.contract import Term as Term
from brv_hypo.mechanisms.contract import hookimpl as hookimpl
from brv_hypo.mechanisms.registry import find as find
from brv_hypo.mechanisms.registry import find_installed as find_installed
from brv_hypo.mechanisms.registry import installed as installed
from brv_hypo.mechanisms.registry import left_out as left_out
from brv_hypo.mechanisms.registry import mechanisms as mechanisms
from brv_hypo.mechanisms.registry import parse_hypothesis as parse_hypothesis
from brv_hypo.mechanisms.registry import plugin_files as plugin_files
from brv_hypo.mechanisms.registry import record_effects as record_effects
from brv_hypo.mechanisms.registry import use_plugin_files as use_plugin_files
from brv_hypo.motion.motion import Motion as Motion
