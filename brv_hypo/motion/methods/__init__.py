"""Methods of reconstruction, one file each: NAME.py holds the function NAME, chosen by `--method NAME`.

    def NAME(record: InertialRecord, config: ReconstructionConfig, perturbations: Sequence[Perturbation]) -> WindHistory

A file that stands here is known everywhere: in the settings, on the command line, and to `compare`, which repeats its
answer on the motions of the other methods. `method.py` has the result, and what open-loop methods share.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable
from importlib import import_module
from typing import Any


def method_names() -> tuple[str, ...]:
    """The methods that there are, the default first."""
    others = sorted(module.name for module in pkgutil.iter_modules(__path__) if module.name != "joint")
    return ("joint", *others)


def method_of(name: str) -> Callable[..., Any]:
    """The method of that name; its file is read when it is first asked for."""
    found: Callable[..., Any] = getattr(import_module(f"{__name__}.{name}"), name)
    return found
