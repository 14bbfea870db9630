"""How many examples a property is tried on: few in every run, a hundred by `--hypothesis-profile=thorough`."""

from __future__ import annotations

from hypothesis import settings

settings.register_profile("quick", settings(), max_examples=25)
settings.register_profile("thorough", settings(), max_examples=100)
settings.load_profile("quick")
