"""How many examples a property is tried on: few unless told otherwise, a hundred by `--hypothesis-profile=thorough`.

Plugins that are files are those of one test: commands that are run in this process would leave theirs to the next.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import settings

from brv_hypo.mechanisms import plugin_files, use_plugin_files

settings.register_profile("quick", settings(), max_examples=25)
settings.register_profile("thorough", settings(), max_examples=100)
settings.load_profile("quick")


@pytest.fixture(autouse=True)
def own_plugin_files() -> Iterator[None]:
    yield
    if plugin_files():
        use_plugin_files(())
