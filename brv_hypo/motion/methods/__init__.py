"""Methods of reconstruction: functions that stand in the METHODS of a file here, chosen by `--method NAME`.

    def NAME(record: InertialRecord, config: ReconstructionConfig, perturbations: Sequence[Perturbation]) -> WindHistory

A file that stands here is known everywhere: in the settings, on the command line, and to `compare`, which repeats its
answer on the motions of the other methods.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable
from importlib import import_module
from typing import Any


def _methods() -> dict[str, Callable[..., Any]]:
    modules = [import_module(f"{__name__}.{module.name}") for module in pkgutil.iter_modules(__path__)]
    return {method.__name__: method for module in modules for method in module.METHODS}


def method_names() -> tuple[str, ...]:
    """The methods that there are, the default first."""
    return ("joint", *sorted(_methods().keys() - {"joint"}))


def method_of(name: str) -> Callable[..., Any]:
    """The method of that name."""
    return _methods()[name]
