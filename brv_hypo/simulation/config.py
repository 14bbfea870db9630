"""What a simulated flight is: the schema of `configs/*.yaml`. SI and radians throughout."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import BaseModel, ConfigDict, Field, model_validator

from brv_hypo.errors import UsageError
from brv_hypo.flight.instruments import DEFAULT_GRADE, Instruments, of_grade, tolerances_of
from brv_hypo.flight.record import Vehicle
from brv_hypo.flight.schema import MINIMUM_SAMPLES
from brv_hypo.mechanisms.contract import TimeVariation

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


class SlopeVariation(Section):
    """C_Nalpha += change (x - at), or, as a step, += change where x >= at; x: Mach, Reynolds number, time.

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

    C_A axial force; C_Nalpha_force > 0 slope of the normal force, which opposes the crossflow; C_N0, C_Nalpha
    (< 0 on a stable vehicle), C_Nalpha3 the in-plane moment C_mw = C_N0 + C_Nalpha alpha + C_Nalpha3 alpha^3;
    C_mq pitch damping; C_l0, C_lp rolling moment and roll damping.
    """

    C_A: float = 0.0
    C_Nalpha_force: float = 0.0
    C_N0: float = 0.0
    C_Nalpha: float = 0.0
    C_Nalpha3: float = 0.0
    C_mq: float = 0.0
    C_l0: float = 0.0
    C_lp: float = 0.0
    slope_variations: tuple[SlopeVariation, ...] = ()


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
