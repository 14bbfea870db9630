"""Mechanisms written in a YAML file: products of a few named functions of the motion, and nothing else.

A term (`terms: [{name: along, axis: body_y, turn: {of: time, rate: 5.0}}]`) is a moment of unit coefficient along an
axis, which may turn, times its factors: powers, jumps, ramps, schedules of one quantity each; it may be that of an
earlier motion (`delay`). `along_rates` is the axis of the transverse rates times d / 2V, which damping has, and
`across_rates` a right angle from it. No expression is evaluated as code. `brv-hypo docs mechanism` has a whole file.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.flight.record import Flight
from brv_hypo.io.mappings import YAML_ENDINGS, read_yaml
from brv_hypo.mechanisms.contract import Mechanism, Term, TimeVariation
from brv_hypo.motion.motion import Motion
from brv_hypo.settings import problems_of

Quantity = Literal["time", "alpha", "windward_meridian", "p", "velocity", "dynamic_pressure", "mach", "log_reynolds"]
Axis = Literal["in_plane", "out_of_plane", "body_y", "body_z", "along_rates", "across_rates"]


def values_of(motion: Motion, quantity: Quantity) -> FloatArray:
    """The quantity on the motion's shape."""
    values = np.log10(motion.reynolds) if quantity == "log_reynolds" else getattr(motion, quantity)
    return np.asarray(values, dtype=float)


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)


class Factor(_Part):
    """One function of one quantity x (SI, rad; `log_reynolds` is log10 of the Reynolds number)."""

    of: Quantity = Field(description="quantity x")
    function: Literal["power", "cos", "sin", "step", "ramp", "bump", "schedule"] = "power"
    """Of x."""
    power: int = Field(default=1, ge=-3, le=6, description="of `power`: ((x - at) / scale)^power")
    rate: float = Field(default=1.0, description="of `cos` and `sin`: of rate * x")
    at: float = Field(default=0.0, description="where a step or ramp begins, a bump has its middle, a power is 0")
    scale: float = Field(default=1.0, gt=0.0, description="of `power`")
    width: float = Field(default=0.0, ge=0.0)
    """Of a `step`, half of (1 + tanh((x - at) / width)), 0 for a sharp one; of a `ramp`, after which it stays, 0 where
    it goes on; of a `bump`, a linear B-spline that is 1 at `at` and 0 so far away."""
    places: tuple[float, ...] = Field(default=(), description="of a `schedule`: lines through `values`")
    values: tuple[float, ...] = Field(default=(), description="at `places`")

    @model_validator(mode="after")
    def _schedule_is_whole(self) -> Factor:
        if (self.function == "schedule") != bool(self.places) or len(self.places) != len(self.values):
            got = f"got {self.function} with {len(self.places)} and {len(self.values)}"
            raise ValueError(f"a schedule, and nothing else, has as many 'values' as 'places'; {got}")
        if any(b <= a for a, b in pairwise(self.places)):
            raise ValueError("'places' must increase")
        return self

    def __call__(self, x: FloatArray) -> FloatArray:
        """The factor at the quantity's values, of any shape."""
        since = x - self.at
        match self.function:
            case "power":
                value = (since / self.scale) ** self.power
            case "cos" | "sin":
                value = getattr(np, self.function)(self.rate * x)
            case "step":
                sharp = np.asarray(since >= 0.0, dtype=float)
                value = sharp if self.width == 0.0 else 0.5 + 0.5 * np.tanh(since / self.width)
            case "ramp":
                value = np.clip(since, 0.0, self.width or np.inf)
            case "bump":
                value = np.maximum(1.0 - np.abs(since) / max(self.width, 1e-300), 0.0)
            case "schedule":
                value = np.interp(x, self.places, self.values)
        return np.asarray(value, dtype=float)


class Turn(_Part):
    """A direction that turns by rate * x from its axis, in the sense of the windward meridian's body axes."""

    of: Quantity = Field(description="quantity x")
    rate: float = Field(description="rad per unit of x")


class YamlTerm(_Part):
    """A moment along `axis`, turned if `turn` is set, times its factors."""

    name: str = Field(description="of the coefficient")
    axis: Axis = Field(description="of its moment")
    turn: Turn | None = Field(default=None, description="of the axis; null: none")
    factors: tuple[Factor, ...] = Field(default=(), description="that are multiplied")
    units: str = Field(default="1", description="of its coefficient")
    delay: float = Field(default=0.0, ge=0.0)
    """s: the moment is that of the motion so much earlier, left where it stood in the body; functions of time are of
    the present."""
    value: float | None = Field(default=None, description="the coefficient as it was found")

    @property
    def follows_time(self) -> bool:
        """Whether it is a function of the record's time."""
        return any(each is not None and each.of == "time" for each in (self.turn, *self.factors))

    def column(self, motion: Motion) -> Term:
        """The term's columns: C_N' + i C_Z' = (C_m + i C_n) exp(i phi_w) (Eq. 2.6, erratum E2)."""
        before = motion.delayed(self.delay)

        def of(quantity: Quantity) -> FloatArray:
            return values_of(motion if quantity == "time" else before, quantity)

        of_body = self.axis in ("body_y", "body_z")
        direction = np.exp(1j * (motion.windward_meridian - (0.0 if of_body else before.windward_meridian)))
        if self.axis in ("along_rates", "across_rates"):
            direction = direction * before.plane_rates
        if self.axis in ("out_of_plane", "body_z", "across_rates"):
            direction = 1j * direction
        if self.turn is not None:
            direction = direction * np.exp(1j * self.turn.rate * of(self.turn.of))
        for factor in self.factors:
            direction = direction * factor(of(factor.of))
        return Term(self.name, direction.real, direction.imag, self.units)


class MechanismFile(_Part):
    """The content of a mechanism file."""

    format: Literal["brv-mechanism"] = Field(default="brv-mechanism", description="`brv-mechanism`")
    format_version: Literal[1] = Field(default=1, description="1")
    name: str = Field(pattern=r"^[a-z][a-z0-9_]*$", description="as `compare` takes it")
    title: str = Field(description="in a few words")
    claims: str = Field(description="what it says of the moment")
    source: str = Field(description="where it comes from")
    terms: tuple[YamlTerm, ...] = Field(min_length=1, description="whose sum is the moment")


class YamlMechanism(Mechanism):
    """A mechanism that a file defines: C_N' and C_Z' are sums of its terms; see the module's description."""

    name: str = "by_file"  # type: ignore[misc]
    title: str = "mechanism of a file"  # type: ignore[misc]
    claims: str = "what its file says"  # type: ignore[misc]
    source: str = "a mechanism file"  # type: ignore[misc]
    time_variation: ClassVar[tuple[TimeVariation, ...]] = ("constant",)

    definition: tuple[YamlTerm, ...] = ()

    def terms(self, motion: Motion, theta: Mapping[str, float]) -> tuple[Term, ...]:
        """The terms of the file, in their order."""
        return tuple(term.column(motion) for term in self.definition)

    def of_each_flight(self, flight: Flight) -> bool:
        """Where a term is a function of the record's time."""
        return any(term.follows_time for term in self.definition)


def mechanism_of(content: MechanismFile) -> YamlMechanism:
    """The mechanism that a file's content defines."""
    return YamlMechanism(definition=content.terms, **content.model_dump(include={"name", "title", "claims", "source"}))


def is_mechanism_file(name: str) -> bool:
    """Whether a mechanism's name is the path of a file."""
    return name.endswith(YAML_ENDINGS)


def read_mechanism(path: str | Path) -> YamlMechanism:
    """The mechanism of a YAML file; raises UsageError that says what is wrong and where."""
    try:
        return mechanism_of(MechanismFile.model_validate(read_yaml(path, "a mechanism")))
    except ValidationError as error:
        found = f"{path} is not a mechanism file: {problems_of(error)}."
        raise UsageError(f"{found} `brv-hypo trace --write-mechanism` writes valid ones.") from None


def mechanism_text(content: MechanismFile) -> str:
    """The content as YAML; what is at its default is left out."""
    data = content.model_dump(mode="json", exclude_defaults=True)
    header = {"format": content.format, "format_version": content.format_version}
    return yaml.safe_dump({**header, **data}, sort_keys=False, width=100)
