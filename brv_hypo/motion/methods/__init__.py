"""Methods of reconstruction, functions in the METHODS of a file here, chosen by `--method NAME`; options.

    def NAME(record: InertialRecord, config: ReconstructionConfig, perturbations: Sequence[Perturbation]) -> WindHistory

A file here is known everywhere: in the settings, on the command line, and to `compare`, which repeats its
answer on the motions of the other methods.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable
from importlib import import_module
from typing import Annotated, Any, TypedDict

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from brv_hypo.io.text import meant
from brv_hypo.motion.signals import ColouredNoise


def methods() -> dict[str, Callable[..., Any]]:
    """The methods that there are, by name, the default first."""
    modules = [import_module(f"{__name__}.{module.name}") for module in pkgutil.iter_modules(__path__)]
    found = {method.__name__: method for module in modules for method in module.METHODS}
    return {"joint": found.pop("joint"), **dict(sorted(found.items()))}


def _known(name: str) -> str:
    known = tuple(methods())
    if name not in known:
        raise ValueError(f"no such method ({meant(name, known, 'known are ' + ', '.join(known))})")
    return name


Method = Annotated[str, AfterValidator(_known)]


class ReconstructionConfig(BaseModel):
    """Options of `reconstruct`; the defaults suit an unknown flight."""

    model_config = ConfigDict(frozen=True, extra="forbid")  # attribute docstrings would be read at each import

    method: Method = Field(
        default="joint",
        description='The report\'s "joint" (method 3 with Section 3.2.3), "velocity" (1) or "rates" (2).',
    )
    gyro_sigma: float | None = Field(default=None, gt=0.0, description="white noise, rad/s; from the record if None")
    gyro_walk: ColouredNoise | None = Field(
        default=None, description="noise, rad/s, that the attitude is integrated with; white, of `gyro_sigma`, if None"
    )
    accel_sigma: float | None = Field(default=None, gt=0.0, description="white noise, m/s^2; from the record if None")


ReconstructionSettings = TypedDict("ReconstructionSettings", {  # noqa: UP013
    "method": str, "gyro_sigma": float | None, "gyro_walk": ColouredNoise | None, "accel_sigma": float | None,
}, total=False)  # fmt: skip
"""The fields of `ReconstructionConfig` as keywords."""
