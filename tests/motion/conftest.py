from __future__ import annotations

import pytest

from tests.motion.truth import CAPSULE, CONE, SLENDER, Truth, fly


@pytest.fixture(scope="session")
def truths() -> dict[str, Truth]:
    """Each scenario flown once."""
    return {scenario.name: fly(scenario) for scenario in (CONE, CAPSULE, SLENDER)}
