"""Configuration of a simulation: the schema of configs/*.yaml, its files and mappings, and flights that differ.

`SimulationConfig` holds all that is flown, in SI and rad. `load_config` reads one from a file, a name or a mapping, and
refuses with what to write instead. `varied` makes one configuration per flight from dotted paths; `per_flight` reads
one number of each.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from brv_hypo.arrays import FloatArray
from brv_hypo.errors import UsageError
from brv_hypo.flight.record import Vehicle
from brv_hypo.flight.tolerances import DEFAULT_GRADE, Instruments, of_grade, tolerances_of
from brv_hypo.io.mappings import read_yaml
from brv_hypo.io.reading import kind_of
from brv_hypo.io.text import meant, nearest, one_line
from brv_hypo.mechanisms.contract import TimeVariation, current_name
from brv_hypo.mechanisms.registry import record_effects
from brv_hypo.thresholds import MINIMUM_SAMPLES

# ---- What a simulated flight is: the schema of `configs/*.yaml`. SI and radians throughout ----


Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Vector = tuple[float, float, float]


class Section(BaseModel):
    """A part of a configuration: immutable, finite numbers, no unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class VehicleConfig(Section):
    """The vehicle as it was built; `ixy`, `ixz` kg m^2 are products of inertia (of x y dm, x z dm): imbalance."""

    mass: Positive
    ixx: Positive
    iyy: Positive
    reference_length: Positive
    reference_area: Positive
    accelerometer_position: Vector = (0.0, 0.0, 0.0)
    ixy: float = 0.0
    ixz: float = 0.0

    @model_validator(mode="after")
    def _inertia_of_a_real_body(self) -> VehicleConfig:
        if self.ixx > 2.0 * self.iyy:
            raise ValueError(
                f"ixx {self.ixx:g} with iyy {self.iyy:g} kg m^2, expected ixx <= 2 iyy as in every body: "
                "are they exchanged?"
            )
        return self

    def declared(self) -> Vehicle:
        """What a record without errors says of the vehicle: it knows nothing of products of inertia."""
        return Vehicle(**self.model_dump(exclude={"ixy", "ixz"}))


def _with_current_names(data: Any) -> Any:
    """A mapping from names of terms with the names of today; a name that is there twice is refused."""
    if not isinstance(data, Mapping):
        return data
    names = [current_name(name) if isinstance(name, str) else name for name in data]
    twice = sorted({name for name in names if names.count(name) > 1}, key=str)
    if twice:
        raise ValueError(f"{twice[0]} is given twice, once by its earlier name: keep one")
    return dict(zip(names, data.values(), strict=True))


class SlopeVariation(Section):
    """C_malpha += change (x - at), or, as a step, += change where x >= at; x: Mach, Reynolds number, time.

    A step of `width` > 0 is smooth, (1 + tanh((x - at) / width)) / 2. Prefer it for mach and reynolds: the
    integration lands on steps in time, not on steps in the motion.
    """

    variable: Literal["mach", "reynolds", "time"]
    kind: Literal["linear", "step"]
    change: float
    at: float
    width: NotNegative = 0.0


class AerodynamicsConfig(Section):
    """Air-relative aerodynamics of CONVENTIONS; coefficients per rad, rates made dimensionless by d / 2V.

    C_A axial force; C_Nalpha_force > 0 slope of the normal force, which opposes the crossflow; C_m0, C_malpha
    (< 0 on a stable vehicle), C_malpha3 the in-plane moment C_mw = C_m0 + C_malpha alpha + C_malpha3 alpha^3;
    C_mq pitch damping; C_l0, C_lp rolling moment and roll damping.
    """

    C_A: float = 0.0
    C_Nalpha_force: float = 0.0
    C_m0: float = 0.0
    C_malpha: float = 0.0
    C_malpha3: float = 0.0
    C_mq: float = 0.0
    C_l0: float = 0.0
    C_lp: float = 0.0
    slope_variations: tuple[SlopeVariation, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _earlier_names(cls, data: Any) -> Any:
        return _with_current_names(data)


class StartConfig(Section):
    """The first instant. Velocity (m/s), alpha and meridian (rad) are relative to the air.

    `flight_path_angle` rad is negative in descent. The transverse rates are given either as `q`, `r` (rad/s),
    or by `alpha_rate` and `coning_rate` (rad/s): how fast the plane of alpha turns about the velocity. A
    coning rate of the natural frequency is a circle, zero a plane oscillation.
    """

    time: float = 0.0
    altitude: float
    velocity: Positive
    flight_path_angle: float
    alpha: float
    windward_meridian: float = 0.0
    roll_rate: float = 0.0
    alpha_rate: float = 0.0
    coning_rate: float = 0.0
    q: float | None = None
    r: float | None = None

    @model_validator(mode="after")
    def _one_choice_of_rates(self) -> StartConfig:
        if (self.q is None) != (self.r is None):
            raise ValueError("q and r belong together: give both, or neither and coning_rate")
        if self.q is not None and (self.coning_rate or self.alpha_rate):
            raise ValueError("give either q and r, or coning_rate and alpha_rate, not both")
        return self


class WindStep(Section):
    """From `time` (s) on the air moves with `velocity` (m/s): along the track, to its right, down."""

    time: float
    velocity: Vector


class EnvironmentConfig(Section):
    """Earth. `gravity` m/s^2 at sea level falls with altitude; `planet_shape` flat keeps its direction.

    `constant_density` kg/m^3 replaces the standard atmosphere's density (verification against closed forms).
    """

    planet: Literal["earth"] = "earth"
    planet_shape: Literal["spherical", "flat"] = "spherical"
    gravity: NotNegative = 9.80665
    constant_density: NotNegative | None = None
    wind_step: WindStep | None = None


class PlantedConfig(Section):
    """A mechanism to plant, as it would be fitted: terms times coefficients, from `start` to `stop` (s).

    `terms` maps the mechanism's term names to coefficients; `theta` holds its nonlinear parameters; `kind` is
    as in Eq. 3.6.
    """

    mechanism: str
    options: dict[str, Any] = Field(default_factory=dict)
    theta: dict[str, float] = Field(default_factory=dict)
    terms: dict[str, float] = Field(min_length=1)
    kind: TimeVariation = "jump"
    start: float | None = None
    stop: float | None = None

    @field_validator("terms", mode="before")
    @classmethod
    def _earlier_names(cls, data: Any) -> Any:
        return _with_current_names(data)


class SensorConfig(Section):
    """Noise of an instrument (1 sigma, white). Its errors are record effects: `InstrumentsConfig.errors`."""

    noise: NotNegative = 0.0


class GaugeConfig(SensorConfig):
    """One scalar channel, with what no record effect says of it alone: bias, and delay (s)."""

    bias: float = 0.0
    delay: float = 0.0


class ScaledGaugeConfig(GaugeConfig):
    """One scalar channel whose scale error is no record effect either."""

    scale: float = 0.0


Channel = Literal["p", "q", "r", "ax", "ay", "az", "velocity", "dynamic_pressure", "altitude"]
ALL_CHANNELS: tuple[Channel, ...] = get_args(Channel)


class SpikesConfig(Section):
    """`count` samples of a channel, at random, are off by +-`size` (SI)."""

    channel: Channel
    count: Annotated[int, Field(ge=1)] = 1
    size: Positive


class GapConfig(Section):
    """`count` stretches of `duration` s without samples: one at `start` s, or all at random."""

    channels: tuple[Channel, ...] = ALL_CHANNELS
    duration: Positive
    start: float | None = None
    count: Annotated[int, Field(ge=1)] = 1

    @model_validator(mode="after")
    def _one_start_one_gap(self) -> GapConfig:
        if self.start is not None and self.count > 1:
            raise ValueError("a gap with a start is one gap: leave out count, or start for gaps at random")
        return self


class TolerancesConfig(Section):
    """What a flight record says of its instruments: `grade`, and `tolerances` by the keys of its format.

    A plain number is in the units of a file of tolerances: `gyro_bias` in deg/s, all else SI; text may name units.
    """

    grade: str = DEFAULT_GRADE
    tolerances: dict[str, float | str | tuple[float | str, ...]] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _known(self) -> Self:
        try:
            self.declared()
        except UsageError as error:
            raise ValueError(str(error)) from None
        return self

    def declared(self) -> Instruments:
        """The tolerances themselves."""
        return tolerances_of(self.tolerances, of_grade(self.grade), "tolerances")


class InstrumentsConfig(TolerancesConfig):
    """Appendix B (errata E10, E11). `averaged` samples are means over the sample interval before them.

    `errors`, SI, by record effect and component, are planted in the order given. `draw` plants errors and asymmetries
    of the vehicle besides, drawn with the seed from so many times the tolerances that the record states; 0: none.
    """

    gyro: SensorConfig = SensorConfig()
    accelerometer: SensorConfig = SensorConfig()
    velocity: ScaledGaugeConfig = ScaledGaugeConfig()
    dynamic_pressure: GaugeConfig = GaugeConfig()
    altitude: ScaledGaugeConfig = ScaledGaugeConfig()
    roll_rate_mag: ScaledGaugeConfig | None = None
    errors: dict[str, dict[str, float]] = Field(default_factory=dict)
    draw: NotNegative = 0.0
    averaged: bool = False
    spikes: tuple[SpikesConfig, ...] = ()
    gaps: tuple[GapConfig, ...] = ()


class SimulationConfig(Section):
    """A simulated flight. `step` s of integration; `sample_rate` Hz, a whole number of steps per sample.

    `mechanisms` are planted always; `plantable` holds named sets to choose from (`planting`). `asymmetries` are
    planted too, but are the vehicle's within its tolerances, and not what the flight is about.
    """

    title: str = ""
    duration: Positive
    step: Positive
    sample_rate: Positive
    vehicle: VehicleConfig
    aerodynamics: AerodynamicsConfig
    start: StartConfig
    environment: EnvironmentConfig = EnvironmentConfig()
    instruments: InstrumentsConfig = InstrumentsConfig()
    mechanisms: tuple[PlantedConfig, ...] = ()
    asymmetries: tuple[PlantedConfig, ...] = ()
    plantable: dict[str, tuple[PlantedConfig, ...]] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _whole_steps_per_sample(self) -> SimulationConfig:
        ratio = 1.0 / (self.sample_rate * self.step)
        if ratio < 0.5 or abs(ratio - round(ratio)) > 1e-6 * ratio:
            raise ValueError(
                f"step {self.step:g} s at sample_rate {self.sample_rate:g} Hz makes {ratio:.6g} steps "
                f"per sample, expected a whole number: try "
                f"step {1.0 / (self.sample_rate * max(1, round(ratio))):.6g}"
            )
        return self

    @model_validator(mode="after")
    def _enough_samples(self) -> SimulationConfig:
        if self.samples < MINIMUM_SAMPLES:
            raise ValueError(
                f"duration {self.duration:g} s at {self.sample_rate:g} Hz makes {self.samples} samples, "
                f"expected at least {MINIMUM_SAMPLES}: give a longer duration"
            )
        return self

    @property
    def steps_per_sample(self) -> int:
        """Integration steps from one sample to the next."""
        return round(1.0 / (self.sample_rate * self.step))

    @property
    def samples(self) -> int:
        """Samples in the record, both ends counted."""
        return int(self.duration * self.sample_rate + 1e-6) + 1

    def planting(self, names: Sequence[str]) -> SimulationConfig:
        """This configuration with the named sets of `plantable` added to `mechanisms`; else KeyError."""
        chosen = tuple(item for name in names for item in self.plantable[name])
        return self.model_copy(update={"mechanisms": (*self.mechanisms, *chosen)})


# ---- Configurations from files and mappings, with refusals that say what to write instead ----


_PACKAGE = Path(__file__).resolve().parents[1]
# An installed wheel carries the configurations inside the package, a checkout beside it.
_HOMES = (_PACKAGE / "configs", _PACKAGE.parent / "configs")

ConfigSource = SimulationConfig | Mapping[str, Any] | str | Path


def config_names(folder: str = "") -> tuple[str, ...]:
    """Names of the configurations that come with the program; `folder` holds those of another kind."""
    return tuple(sorted({file.stem for home in _HOMES for file in (home / folder).glob("*.yaml")}))


def config_path(name: str | Path, folder: str = "") -> Path:
    """The file of a configuration: an existing path, or a name of `config_names` with or without `.yaml`.

    Raises UsageError with the nearest names.
    """
    if kind_of(name) not in (None, "a directory"):  # what is no file either is refused where it is read
        return Path(name)
    for home in _HOMES:
        for candidate in (home / folder / Path(name), home / folder / f"{name}.yaml"):
            if kind_of(candidate) == "a file":
                return candidate
    known = config_names(folder)
    hint = meant(Path(name).stem, known, f"those that come along: {', '.join(known)}.", 0.4, most=2)
    raise UsageError(f"no configuration file '{name}', and none of that name comes with the program; {hint}")


def load_config(source: ConfigSource, *, plant: Sequence[str] = ()) -> SimulationConfig:
    """The configuration of a file, a name, a mapping or a `SimulationConfig`, with `plant` sets planted.

    Raises UsageError that names each wrong key, what it holds and what is expected.
    """
    config = source if isinstance(source, SimulationConfig) else _validated(source)
    unknown = [name for name in plant if name not in config.plantable]
    if unknown:
        raise UsageError(
            f"'{unknown[0]}' is not plantable in '{config.title}'; its `plantable` block holds "
            f"{', '.join(config.plantable) or 'nothing'}. Choose one of these, or add it to `mechanisms`."
        )
    return config.planting(plant) if plant else config


def validated(data: Mapping[str, Any], origin: str) -> SimulationConfig:
    """The configuration of a mapping; `origin` names it in the refusal."""
    try:
        return SimulationConfig.model_validate(data)
    except ValidationError as error:
        problems = "; ".join(_problem(detail) for detail in error.errors())
        raise UsageError(f"{origin}: {problems}. All values are SI, angles in rad.") from None


def _validated(source: Mapping[str, Any] | str | Path) -> SimulationConfig:
    if isinstance(source, Mapping):
        return validated(_on_base(source), "simulation configuration")
    path = config_path(source)
    return validated(_on_base(_read(path)), str(path))


def _read(path: Path) -> Mapping[str, Any]:
    return read_yaml(path, "a simulation with `vehicle`, `start` ...")


def _on_base(data: Mapping[str, Any]) -> Mapping[str, Any]:
    """`base: NAME` takes over another file's top-level keys, where the mapping has none of its own."""
    if "base" not in data:
        return data
    own = {key: value for key, value in data.items() if key != "base"}
    base = _read(config_path(str(data["base"])))
    if "base" in base:
        raise UsageError(f"the base configuration '{data['base']}' has a base itself; one level is allowed")
    return {**base, **own}


def _problem(detail: Any) -> str:
    place = ".".join(str(part) for part in detail["loc"]) or "the whole"
    if detail["type"] == "missing":
        return f"'{place}' is missing"
    if detail["type"] == "extra_forbidden":
        return f"'{place}' is not a known key{_nearest_key(detail['loc'])}"
    message = detail["msg"].removeprefix("Value error, ")
    return f"'{place}': {message}" + (
        "" if isinstance(detail["input"], dict) else f", got {one_line(repr(detail['input']))}"
    )


def _nearest_key(location: Sequence[str | int]) -> str:
    leaf = str(location[-1])
    near = nearest(leaf, _keys(SimulationConfig))
    if near and near[0] != leaf:
        return f" (is '{near[0]}' meant?)"
    return _nearest_effect(location) if location[0] == "instruments" else ""


def _nearest_effect(location: Sequence[str | int]) -> str:
    """Where an instrument's error is written beside its noise: the record effect that it is."""
    effects = [effect.name for effect in record_effects()]
    near = nearest("_".join(map(str, location[1:])), effects, 0.7)
    hint = f"is the record effect '{near[0]}' meant? " if near else ""
    return f" ({hint}errors are written under `instruments.errors`, by effect and component)"


def _keys(model: type[BaseModel]) -> list[str]:
    """Every key of the schema, at any depth."""
    names: list[str] = []
    for name, field in model.model_fields.items():
        names.append(name)
        inner = (field.annotation, *getattr(field.annotation, "__args__", ()))
        names += [
            key
            for kind in inner
            if isinstance(kind, type) and issubclass(kind, BaseModel)
            for key in _keys(kind)
        ]
    return names


# ---- Flights that differ in a few numbers: dotted paths into the configuration, one value per flight ----


# These shape the arrays of a batch, so all its flights share them.
_COMMON = ("duration", "step", "sample_rate", "start.time")
_ERRORS = "instruments.errors."


def varied(
    config: SimulationConfig, flights: int, variations: Mapping[str, ArrayLike] | None
) -> tuple[SimulationConfig, ...]:
    """One configuration per flight; `variations` maps dotted paths to a value or to (flights,) values.

    Paths read like 'start.alpha', 'mechanisms.0.terms.eps', 'vehicle.accelerometer_position.1',
    'instruments.errors.EFFECT.COMPONENT'.
    Raises UsageError for an unknown path, a wrong number of values, or a value out of range.
    """
    if not variations:
        return (config,) * flights
    columns = {path: _column(path, values, flights) for path, values in variations.items()}
    base = config.model_dump()
    found = []
    for flight in range(flights):
        data = copy.deepcopy(base)
        for path, column in columns.items():
            _put(data, path, float(column[flight]))
        found.append(validated(data, f"flight {flight} of the batch"))
    return tuple(found)


def per_flight(configs: Sequence[SimulationConfig], *path: str | int, missing: float = np.nan) -> FloatArray:
    """The number at `path` of each configuration, (flights,); `missing` where the way there holds None."""
    return np.array([_at(config, path, missing) for config in configs], dtype=float)


def numbers(config: SimulationConfig) -> dict[str, float]:
    """Every number of a configuration by its dotted path; `plantable` sets left out."""
    found: dict[str, float] = {}
    _collect(config.model_dump(exclude={"plantable"}), "", found)
    return found


def _at(node: Any, path: Sequence[str | int], missing: float) -> float:
    for part in path:
        inside: Any = part
        node = node[inside] if isinstance(node, Mapping | tuple) else getattr(node, inside)
        if node is None:
            return missing
    return float(node)


def _collect(node: Any, path: str, found: dict[str, float]) -> None:
    if isinstance(node, Mapping):
        for key, value in node.items():
            _collect(value, f"{path}.{key}" if path else str(key), found)
    elif isinstance(node, tuple | list):
        for index, value in enumerate(node):
            _collect(value, f"{path}.{index}", found)
    elif isinstance(node, int | float) and not isinstance(node, bool):
        found[path] = float(node)


def _column(path: str, values: ArrayLike, flights: int) -> FloatArray:
    if path in _COMMON:
        raise UsageError(
            f"'{path}' cannot vary within a batch: its flights share one time grid. Simulate it apart."
        )
    column = np.asarray(values, dtype=float)
    if column.shape not in ((), (flights,)):
        raise UsageError(
            f"variation '{path}' has shape {column.shape}, expected one value or ({flights},), one per seed"
        )
    return np.broadcast_to(column, (flights,))


def _put(data: dict[str, Any], path: str, value: float) -> None:
    """Set a leaf of nested mappings and tuples; tuples become lists on the way."""
    if path.startswith(_ERRORS):  # any effect and component: those that are absent are zero
        effect, _, component = path.removeprefix(_ERRORS).partition(".")
        data["instruments"]["errors"].setdefault(effect, {})[component] = value
        return
    node: Any = data
    *parents, leaf = current_name(path).split(".")
    try:
        for part in parents:
            child = node[int(part)] if isinstance(node, list) else node[part]
            if isinstance(child, tuple):
                child = list(child)
                node[int(part) if isinstance(node, list) else part] = child
            node = child
        key: Any = int(leaf) if isinstance(node, list) else leaf
        if isinstance(node[key], str | Mapping | tuple | list):
            raise TypeError
        node[key] = value
    except (KeyError, IndexError, ValueError, TypeError):
        raise UsageError(
            f"variation '{path}' does not lead to a number of the configuration; paths read like "
            "'start.alpha' or 'mechanisms.0.terms.eps', and the mechanism must be in `mechanisms` or planted"
        ) from None
