"""Errors that a user can act on; the exit code of each is part of the command line's contract.

Each is also the built-in exception that Python code catches for the same: ValueError for a wrong value,
FileNotFoundError, FileExistsError, ImportError.
"""

from __future__ import annotations


class BrvHypoError(Exception):
    """Base of every deliberate refusal: what was got, what was expected, the likely cause and the remedy."""

    exit_code = 70


class UsageError(BrvHypoError, ValueError):
    """Wrong usage: unknown mechanism, bad configuration, an output that already exists."""

    exit_code = 2


class MissingInputError(UsageError, FileNotFoundError):
    """A file of settings, of a model or of a plugin is not there."""


class ExistingOutputError(UsageError, FileExistsError):
    """An output exists already, and is not to be overwritten."""


class MissingPackageError(UsageError, ImportError):
    """An optional package is not installed."""


def missing_package(what: str, package: str, extra: str) -> MissingPackageError:
    """The error where `what` needs a package, which the extra of that name brings."""
    return MissingPackageError(
        f"{what} needs {package}, which is not installed: pip install -e '.[{extra}]' in the checkout of brv-hypo, or "
        f"pip install {package}."
    )


class FlightRecordError(BrvHypoError, ValueError):
    """The flight record cannot be read or is invalid."""

    exit_code = 3


class MissingRecordError(FlightRecordError, FileNotFoundError):
    """The flight record is not there."""


class MechanismError(UsageError):
    """A plugin broke its contract: it raised, gave no answer, or columns that are not finite or of the wrong shape.
    `mechanism` is the name of what broke it, so that it can be left out; empty where that is not known.
    """

    def __init__(self, message: str, mechanism: str = "") -> None:
        super().__init__(message)
        self.mechanism = mechanism

    def __reduce__(self) -> tuple[type[MechanismError], tuple[str, str]]:
        return type(self), (str(self), self.mechanism)


class UnanswerableError(BrvHypoError, ValueError):
    """The data are valid but cannot answer the question; the message says what is missing."""

    exit_code = 1
