"""Which libraries the frozen results were written with: others round otherwise, and some results hang on rounding."""

from __future__ import annotations

import json
from functools import cache
from importlib.metadata import version
from pathlib import Path

import numpy as np  # noqa: F401  # each brings its own BLAS
import scipy.linalg  # noqa: F401
from llvmlite.binding import get_host_cpu_name
from threadpoolctl import threadpool_info

FILE = Path(__file__).parent / "libraries.json"


@cache
def libraries() -> dict[str, str]:
    """Versions of what computes, kernels of the linear algebra, and the processor that numba compiles for."""
    found = {name: version(name) for name in ("numpy", "scipy", "numba", "llvmlite")}
    blas = {
        f"{each['internal_api']} {each.get('version')} {each.get('architecture')}"
        for each in threadpool_info()
        if each["user_api"] == "blas"
    }
    return found | {"blas": ", ".join(sorted(blas)), "processor": get_host_cpu_name()}


def same_libraries() -> bool:
    """Whether results can be the same bit for bit."""
    return FILE.exists() and bool(json.loads(FILE.read_text(encoding="utf-8")) == libraries())


def note_libraries() -> None:
    """Keeps them beside the results that are written."""
    FILE.write_text(json.dumps(libraries(), indent=1, sort_keys=True) + "\n", encoding="utf-8")
