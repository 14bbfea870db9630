"""Errors that a user can act on; the exit code of each is part of the command line's contract."""

from __future__ import annotations


class BrvHypoError(Exception):
    """Base of every deliberate refusal: what was got, what was expected, the likely cause and the remedy."""

    exit_code = 70


class UsageError(BrvHypoError):
    """Wrong usage: unknown mechanism, bad configuration, an output that already exists."""

    exit_code = 2


class FlightRecordError(BrvHypoError):
    """The flight record cannot be read or is invalid."""

    exit_code = 3


class MechanismError(UsageError):
    """A plugin broke its contract: it raised, gave no answer, or columns that are not finite or of the wrong shape.

    `mechanism` is the name of what broke it, so that it can be left out; empty where that is not known.
    """

    def __init__(self, message: str, mechanism: str = "") -> None:
        super().__init__(message)
        self.mechanism = mechanism

    def __reduce__(self) -> tuple[type[MechanismError], tuple[str, str]]:
        return type(self), (str(self), self.mechanism)


class UnanswerableError(BrvHypoError):
    """The data are valid but cannot answer the question; the message says what is missing."""

    exit_code = 1
