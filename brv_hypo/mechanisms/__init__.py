"""Mechanisms as plugins.

hookspecs.py       the plugin border, and the manual for plugin authors
contract.py        what a mechanism and a record effect are
registry.py        finds what is installed, by name, and the nuisances of every hypothesis
checked.py         calls of plugins, whose answers are checked
yaml_mechanism.py  mechanisms that a YAML file defines
conformance.py       named checks that every plugin must pass
template/          a plugin package to start from, with $placeholders, which `brv-hypo mechanisms new` fills in
"""

from brv_hypo.mechanisms.contract import (
    Component,
    Derived,
    Mechanism,
    MomentProcess,
    Parameter,
    RecordEffect,
    RecordProcess,
    Term,
)
from brv_hypo.mechanisms.hookspecs import hookimpl
from brv_hypo.mechanisms.registry import (
    find,
    find_installed,
    installed,
    left_out,
    mechanisms,
    parse_hypothesis,
    plugin_files,
    record_effects,
    use_plugin_files,
)

__all__ = [
    "Component",
    "Derived",
    "Mechanism",
    "MomentProcess",
    "Parameter",
    "RecordEffect",
    "RecordProcess",
    "Term",
    "find",
    "find_installed",
    "hookimpl",
    "installed",
    "left_out",
    "mechanisms",
    "parse_hypothesis",
    "plugin_files",
    "record_effects",
    "use_plugin_files",
]
