"""What a shell completes beside commands, options and files: names of topics, mechanisms, configurations and grades.

Everything is imported when it is asked for: a shell waits for it, and typer reads this module at every start.
"""

from __future__ import annotations

import re
from collections.abc import Iterable


def topics(incomplete: str) -> list[str]:
    """Topics of the manual that begin so."""
    from brv_hypo.docs import topics as known

    return _beginning(incomplete, known())


def configurations(incomplete: str) -> list[str]:
    """Simulations that come along; a shell completes files where none begins so."""
    from brv_hypo.simulation.loading import config_names

    return _beginning(incomplete, config_names())


def studies(incomplete: str) -> list[str]:
    """Studies that come along."""
    from brv_hypo.simulation.loading import config_names

    return _beginning(incomplete, config_names("studies"))


def grades(incomplete: str) -> list[str]:
    """Grades of instruments."""
    from brv_hypo.flight.instruments import GRADES

    return _beginning(incomplete, GRADES)


def installed(incomplete: str) -> list[str]:
    """Mechanisms and record effects."""
    from brv_hypo.mechanisms.registry import installed as known

    return _beginning(incomplete, sorted(known()))


def hypotheses(incomplete: str) -> list[str]:
    """A list of mechanisms, the last of which is not whole yet; commas and pluses stand between them."""
    from brv_hypo.mechanisms.registry import mechanisms

    before = re.sub(r"[^,+]*$", "", incomplete)
    names = sorted(mechanism.name for mechanism in mechanisms())
    return [before + name for name in _beginning(incomplete[len(before) :], names)]


def _beginning(incomplete: str, names: Iterable[str]) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]
