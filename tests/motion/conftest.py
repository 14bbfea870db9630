from __future__ import annotations

import pytest

from tests.motion.truth import SCENARIOS, Truth, fly


class Truths(dict[str, Truth]):
    """By the scenario's name; each is flown when it is first requested."""

    def __missing__(self, name: str) -> Truth:
        return fly(next(scenario for scenario in SCENARIOS if scenario.name == name))


@pytest.fixture(scope="session")
def truths() -> dict[str, Truth]:
    return Truths()
