"""What a check is, and what comes of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

Item = TypeVar("Item")


class Nonconformity(AssertionError):  # noqa: N818 - the field's word for a failed conformance check
    """A plugin breaks the contract: what was found, what is expected."""


@dataclass(frozen=True)
class Outcome:
    """What came of one check; `detail` says what was found where it failed."""

    check: str
    passed: bool
    detail: str = ""


@dataclass(frozen=True)
class Check(Generic[Item]):
    """One named requirement; calling it raises Nonconformity where the item breaks it."""

    name: str
    requirement: str
    test: Callable[[Item], None]

    def __call__(self, item: Item) -> None:
        """Run the check."""
        self.test(item)

    def __str__(self) -> str:
        return self.name

    def outcome(self, item: Item) -> Outcome:
        """Run the check; whatever it raises is a failure, an error in the plugin's own code included."""
        try:
            with np.errstate(all="ignore"):  # what is not finite is a finding, not a warning
                self.test(item)
        except Nonconformity as broken:
            return Outcome(self.name, False, str(broken))
        except Exception as error:  # any error of foreign code is a finding, and the other checks go on
            return Outcome(self.name, False, f"it raised {type(error).__name__}: {error}")
        return Outcome(self.name, True)


def named(test: Callable[[Item], None]) -> Check[Item]:
    """The check that a function is: its name, and its docstring's first line as the requirement."""
    requirement = (test.__doc__ or "").strip().splitlines()[0].rstrip(".")
    return Check(test.__name__, requirement, test)


def expect(condition: bool, found: str) -> None:
    """Raise Nonconformity with `found` unless `condition` holds."""
    if not condition:
        raise Nonconformity(found)
