"""Configuration of a simulation: the schema of configs/*.yaml (`SimulationConfig`), its files and mappings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypedDict, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from brv_hypo.errors import UsageError
from brv_hypo.flight.record import Vehicle
from brv_hypo.flight.tolerances import DEFAULT_GRADE, Instruments, of_grade, tolerances_of
from brv_hypo.io.files import config_path
from brv_hypo.io.mappings import read_yaml
from brv_hypo.io.text import meant
from brv_hypo.mechanisms.contract import TimeVariation
from brv_hypo.mechanisms.registry import record_effects
from brv_hypo.settings import problems_of
from brv_hypo.thresholds import MINIMUM_SAMPLES

Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Vector = tuple[float, float, float]


class ConfigSection(BaseModel):
    """A part of a configuration: immutable, finite numbers, no unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)


def _of_a_real_body(vehicle: Vehicle) -> Vehicle:
    if vehicle.ixx > 2.0 * vehicle.iyy:
        found = f"ixx {vehicle.ixx:g} with iyy {vehicle.iyy:g} kg m^2"
        raise ValueError(f"{found}, expected ixx <= 2 iyy as in every body: are they exchanged?")
    return vehicle


class AerodynamicsConfig(ConfigSection):
    """Air-relative, per rad, rates times d / 2V (CONVENTIONS); in plane C_m0 + C_malpha alpha + C_malpha3 alpha^3."""

    C_A: float = 0.0  # axial force
    C_Nalpha_force: float = 0.0  # slope of the normal force, > 0: it opposes the crossflow
    C_m0: float = 0.0  # in-plane moment at alpha 0
    C_malpha: float = 0.0  # its slope, < 0 on a stable vehicle
    C_malpha3: float = 0.0  # its cubic part
    C_mq: float = 0.0  # pitch damping
    C_l0: float = 0.0  # rolling moment
    C_lp: float = 0.0  # roll damping


class StartConfig(ConfigSection):
    """The first instant, relative to the air; coning at the natural frequency is a circle, at zero a plane motion."""

    time: float = 0.0  # s
    altitude: float  # above sea level, m
    velocity: Positive  # m/s
    flight_path_angle: float  # negative in descent, rad
    alpha: float  # total angle of attack, rad
    windward_meridian: float = 0.0  # rad
    roll_rate: float = 0.0  # rad/s
    alpha_rate: float = 0.0  # rad/s
    coning_rate: float = 0.0  # how fast the plane of alpha turns about the velocity, rad/s


class EnvironmentConfig(ConfigSection):
    """Earth, a sphere; `gravity` m/s^2 at sea level; `constant_density` kg/m^3 for verification by closed forms."""

    planet: Literal["earth"] = "earth"
    gravity: NotNegative = 9.80665
    constant_density: NotNegative | None = None


class PlantedConfig(ConfigSection):
    """A mechanism to plant, as it would be fitted: terms times coefficients."""

    mechanism: str  # name of an installed mechanism
    options: dict[str, Any] = Field(default_factory=dict)  # its options
    theta: dict[str, float] = Field(default_factory=dict)  # its nonlinear parameters
    terms: dict[str, float] = Field(min_length=1)
    kind: TimeVariation = "jump"  # how the coefficients vary in time, as in Eq. 3.6
    start: float | None = None  # s; None: from the beginning
    stop: float | None = None  # s; None: to the end

    @model_validator(mode="after")
    def _begins_first(self) -> PlantedConfig:
        if self.start is not None and self.stop is not None and self.stop <= self.start:
            raise ValueError(f"{self.mechanism} acts from {self.start:g} to {self.stop:g} s, expected stop after start")
        return self


class SensorConfig(ConfigSection):
    """Noise of an instrument (1 sigma, white). Its errors are record effects: `InstrumentsConfig.errors`."""

    noise: NotNegative = 0.0


Channel = Literal["p", "q", "r", "ax", "ay", "az", "velocity", "dynamic_pressure", "altitude"]


class SpikesConfig(ConfigSection):
    """`count` samples of a channel, at random, are off by +-`size` (SI)."""

    channel: Channel
    count: Annotated[int, Field(ge=1)] = 1
    size: Positive


class GapConfig(ConfigSection):
    """`count` gaps of `duration` s without samples: one at `start` s, or all at random."""

    channels: tuple[Channel, ...] = get_args(Channel)
    duration: Positive
    start: float | None = None
    count: Annotated[int, Field(ge=1)] = 1

    @model_validator(mode="after")
    def _one_start_one_gap(self) -> GapConfig:
        if self.start is not None and self.count > 1:
            raise ValueError("a gap with a start is one gap: leave out count, or start for gaps at random")
        return self


class TolerancesConfig(ConfigSection):
    """What a flight record says of its instruments: `grade`, and `tolerances` by the keys of its format. A plain number
    is in the units of a file of tolerances: `gyro_bias` in deg/s, all else SI; text may name units.
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
    """Appendix B (errata E10, E11)."""

    gyro: SensorConfig = SensorConfig()  # all three, rad/s
    accelerometer: SensorConfig = SensorConfig()  # all three, m/s^2
    velocity: SensorConfig = SensorConfig()  # m/s
    dynamic_pressure: SensorConfig = SensorConfig()  # Pa
    altitude: SensorConfig = SensorConfig()  # m
    errors: dict[str, dict[str, float]] = Field(default_factory=dict)  # by record effect and component, SI, in order
    draw: NotNegative = 0.0  # of so many times the tolerances, errors and asymmetries of the vehicle are drawn besides
    spikes: tuple[SpikesConfig, ...] = ()  # samples that are off
    gaps: tuple[GapConfig, ...] = ()  # samples that are missing

    @property
    def silent(self) -> bool:
        """Whether no instrument has noise, which no record of a flight is without."""
        gauges = (self.gyro, self.accelerometer, self.velocity, self.dynamic_pressure, self.altitude)
        return not any(gauge.noise for gauge in gauges)


class SimulationConfig(ConfigSection):
    """A simulated flight."""

    title: str = Field(default="", description="For the reader.")
    duration: Positive = Field(description="s.")
    step: Positive = Field(description="Of the integration, s.")
    sample_rate: Positive = Field(description="Hz; a whole number of steps per sample.")
    vehicle: Annotated[Vehicle, AfterValidator(_of_a_real_body)] = Field(description="As it was built.")
    aerodynamics: AerodynamicsConfig = Field(description="Its coefficients.")
    start: StartConfig = Field(description="The first instant.")
    environment: EnvironmentConfig = Field(default=EnvironmentConfig(), description="Gravity and air.")
    instruments: InstrumentsConfig = Field(
        default=InstrumentsConfig(),
        description='What the record is made with; `{"draw": 1}` draws errors at the stated tolerances (`--draw 1`).',
    )
    mechanisms: tuple[PlantedConfig, ...] = Field(default=(), description="Planted always.")
    asymmetries: tuple[PlantedConfig, ...] = Field(default=(), description="The vehicle's, within its tolerances.")
    plantable: dict[str, tuple[PlantedConfig, ...]] = Field(default={}, description="Named sets to choose from.")

    @model_validator(mode="after")
    def _whole_steps_per_sample(self) -> SimulationConfig:
        ratio = 1.0 / (self.sample_rate * self.step)
        if ratio < 0.5 or abs(ratio - round(ratio)) > 1e-6 * ratio:
            near = 1.0 / (self.sample_rate * max(1, round(ratio)))
            made = f"step {self.step:g} s at sample_rate {self.sample_rate:g} Hz makes {ratio:.6g} steps per sample"
            raise ValueError(f"{made}, expected a whole number: try step {near:.6g}")
        return self

    @model_validator(mode="after")
    def _enough_samples(self) -> SimulationConfig:
        if self.samples < MINIMUM_SAMPLES:
            made = f"duration {self.duration:g} s at {self.sample_rate:g} Hz makes {self.samples} samples"
            raise ValueError(f"{made}, expected at least {MINIMUM_SAMPLES}: give a longer duration")
        return self

    @property
    def steps_per_sample(self) -> int:
        """Integration steps from one sample to the next."""
        return round(1.0 / (self.sample_rate * self.step))

    @property
    def samples(self) -> int:
        """Samples in the record, both ends counted."""
        return int(self.duration * self.sample_rate + 1e-6) + 1


Part = Mapping[str, Any]


SimulationSettings = TypedDict("SimulationSettings", {  # noqa: UP013
    "title": str, "duration": float, "step": float, "sample_rate": float, "vehicle": Vehicle | Part,
    "aerodynamics": AerodynamicsConfig | Part, "start": StartConfig | Part, "environment": EnvironmentConfig | Part,
    "instruments": InstrumentsConfig | Part, "mechanisms": Sequence[PlantedConfig | Part],
    "asymmetries": Sequence[PlantedConfig | Part], "plantable": Mapping[str, Sequence[PlantedConfig | Part]],
}, total=False)  # fmt: skip
"""The fields of `SimulationConfig` as keywords; parts are models or mappings."""


ConfigSource = SimulationConfig | Mapping[str, Any] | str | Path


def load_config(
    source: ConfigSource, *, plant: str | Sequence[str] = (), keywords: Mapping[str, Any] = {}
) -> SimulationConfig:
    """The configuration of a file, a name, a mapping or a `SimulationConfig`, with `plant` sets planted. `keywords`
    take the place of its keys, mappings key by key. Raises UsageError for each wrong key.
    """
    plant = plant.split(",") if isinstance(plant, str) else plant
    if isinstance(source, SimulationConfig) and keywords:
        source = source.model_dump(exclude_unset=True)
    config = source if isinstance(source, SimulationConfig) else _read(source, keywords)
    for name in plant:
        if name not in config.plantable:
            holds = f"its `plantable` block holds {', '.join(config.plantable) or 'nothing'}"
            holds += "; leave --plant out to plant nothing" if name == "none" else ""
            raise UsageError(f"'{name}' is not plantable in '{config.title}'; {holds}. Choose one, or add it there.")
    chosen = tuple(entry for name in plant for entry in config.plantable[name])
    return config.model_copy(update={"mechanisms": (*config.mechanisms, *chosen)}) if plant else config


def _read(source: Mapping[str, Any] | str | Path, keywords: Mapping[str, Any]) -> SimulationConfig:
    """`base: NAME` takes over another file's keys, where the mapping or file has none of its own."""
    expected, origin = "a simulation with `vehicle`, `start` ...", "simulation configuration"
    if not isinstance(source, Mapping):
        path = config_path(source)
        source, origin = read_yaml(path, expected), str(path)
    if "base" in source:
        base = read_yaml(config_path(str(source["base"])), expected)
        if "base" in base:
            raise UsageError(f"the base configuration '{source['base']}' has a base itself; one level is allowed")
        source = _over(base, {key: value for key, value in source.items() if key != "base"})
    try:
        return SimulationConfig.model_validate(_over(source, keywords))
    except ValidationError as error:
        raise UsageError(f"{origin}: {problems_of(error, _hint)}. All values are SI, angles in rad.") from None


def _over(base: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """`own` over `base`, key by key in sections too, so that what is not named anew stays; an empty section empties."""
    merged = dict(base)
    for key, value in own.items():
        below = base.get(key)
        if value and isinstance(below, Mapping) and isinstance(value, Mapping):
            value = _over(below, value)
        merged[key] = value
    return merged


def _hint(location: Sequence[str | int]) -> str:
    """The known key that is most like an unknown one; of an error beside an instrument's noise its record effect."""
    schema = SimulationConfig.model_json_schema()
    known = {key for part in (schema, *schema["$defs"].values()) for key in part.get("properties", ())}
    parts = {name: str(part.get("$ref")).rpartition("/")[2] for name, part in schema["properties"].items()}
    holds = [name for name, to in parts.items() if location[-1] in schema["$defs"].get(to, {}).get("properties", ())]
    if len(location) == 1 and holds:
        return f"it is a key of {' and of '.join(f'`{name}`' for name in holds)}"
    near = "" if location[-1] in known else meant(str(location[-1]), known, "")
    if near or location[0] != "instruments":
        return near
    effect = meant("_".join(map(str, location[1:])), [effect.name for effect in record_effects()], "", 0.7)
    return f"{effect} Errors are written under `instruments.errors`, by effect and component".strip()


def numbers(config: SimulationConfig) -> dict[str, float]:
    """Every number of a configuration by its dotted path; `plantable` sets left out."""
    found: dict[str, float] = {}

    def collect(node: Any, path: str) -> None:
        if isinstance(node, dict | list | tuple):
            for key, value in node.items() if isinstance(node, dict) else enumerate(node):
                collect(value, f"{path}.{key}" if path else str(key))
        elif isinstance(node, int | float) and not isinstance(node, bool):
            found[path] = float(node)

    collect(config.model_dump(exclude={"plantable"}), "")
    return found
