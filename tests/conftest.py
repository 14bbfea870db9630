"""How many examples a property is tried on: few in the quick run, a hundred where thorough tests run. None is timed.

Linear algebra takes one thread: problems are small, and more would only cost. Plugins that are files are those of one
test: commands that are run in this process would pass theirs on to the next.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator

import pytest
from hypothesis import settings
from threadpoolctl import threadpool_limits

from brv_hypo.mechanisms import plugin_files, use_plugin_files

settings.register_profile("quick", settings(), max_examples=15, deadline=None)
settings.register_profile("thorough", settings(), max_examples=100, deadline=None)


def pytest_configure(config: pytest.Config) -> None:
    """`--hypothesis-profile` comes after this and replaces it."""
    threadpool_limits(limits=1)
    settings.load_profile("quick" if "not thorough" in config.option.markexpr else "thorough")


def pytest_collection_finish() -> None:
    """What was imported stays until the end: to look through it for cycles again and again took seconds."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def own_plugin_files() -> Iterator[None]:
    yield
    if plugin_files():
        use_plugin_files(())
