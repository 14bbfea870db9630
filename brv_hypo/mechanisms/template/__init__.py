"""A plugin package to start from; `write_plugin` fills it in. Files end in .tmpl and hold $placeholders.

pyproject.toml.tmpl  the entry point by which the plugin is found
module.py.tmpl       the mechanism; effect.py.tmpl the record effect
test_module.py.tmpl, test_effect.py.tmpl    conformance, one test of the physics, planted and recovered
README.md.tmpl       how to install, check and compare it
"""

from brv_hypo.mechanisms.template.writer import write_plugin

__all__ = ["write_plugin"]
