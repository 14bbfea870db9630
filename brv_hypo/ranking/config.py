"""What a comparison may be told; every default fits a flight that nobody has seen yet."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from brv_hypo.errors import UsageError
from brv_hypo.motion.reconstruction import Method


class CompareConfig(BaseModel):
    """Settings of `compare`.

    `mechanisms`: hypotheses, a plus joining several; None compares all that are installed. `options`: options
    by mechanism name. `knots` s: where coefficients may change; None spreads `knot_count` of them evenly.
    `max_terms`: columns that a hypothesis may add; the search is exact up to `exact_terms` of them, then
    goes on from the best refined model. `offset_degree`, `slope_degree`: Legendre degree of the
    slow drift of C_N0 and C_Nalpha; None lets BIC choose. `refine`: delays and knots become continuous.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    mechanisms: tuple[str, ...] | None = None
    options: dict[str, dict[str, Any]] = Field(default_factory=dict)
    method: Method = "joint"
    knots: tuple[float, ...] | None = None
    knot_count: int = Field(default=11, ge=0, le=40)
    max_terms: int = Field(default=6, ge=1, le=20)
    offset_degree: int | None = Field(default=None, ge=0, le=6)
    slope_degree: int | None = Field(default=None, ge=0, le=8)
    exact_terms: int = Field(default=4, ge=1, le=20)
    refine: bool = True
    held_out_blocks: int = Field(default=8, ge=2, le=50)
    maximum_likelihood: bool = True


def read_compare_config(path: str | Path | None, **overrides: Any) -> CompareConfig:
    """The configuration of a YAML file with `overrides` set over it; raises UsageError where it is wrong."""
    content: Any = {}
    if path is not None:
        try:
            content = yaml.safe_load(Path(path).read_text(encoding="utf-8")) or {}
        except OSError as error:
            raise UsageError(
                f"cannot read the configuration {path}: {error.strerror}; check the path"
            ) from None
        except yaml.YAMLError as error:
            raise UsageError(f"the configuration {path} is not YAML: {error}") from None
    if not isinstance(content, dict):
        raise UsageError(
            f"the configuration {path} holds a {type(content).__name__}, expected a mapping of settings"
        )
    try:
        return CompareConfig.model_validate({**content, **overrides})
    except ValidationError as error:
        lines = "; ".join(
            f"{'.'.join(map(str, e['loc']))}: {e['msg']} (got {e['input']!r})" for e in error.errors()
        )
        known = ", ".join(CompareConfig.model_fields)
        raise UsageError(f"bad configuration {path or ''}: {lines}. Known settings: {known}.") from None
