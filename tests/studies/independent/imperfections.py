"""What every real flight and no list of tolerances has: one kind at a time, at an ordinary size, or all of them.

`Imperfections` says how large each kind is; nothing is the default of all. `ordinary(kind, ...)` draws one kind at the
size that flights are reported to have: a unit inertial sensor's random walk, 2 m/s of turbulence, 10 % of density
about the standard atmosphere, 1.5 % between the transverse inertias, 0.3 mm of centre of mass that moves, and so on.

Each is in one of three places: the air and the vehicle (`winds`, `density`, `inertia`, `centre`), the moment
(`moment`), the record (`recorded`). `onset` is of the planted mechanism itself: a width instead of a step.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.signal import butter, lfilter

from brv_hypo.flight.record import Flight
from tests.studies.independent.air import atmosphere
from tests.studies.independent.mechanisms import Running
from tests.studies.independent.vehicles import Craft

_DEGREE = math.pi / 180.0
SCALE_HEIGHT = 7000.0  # m
LINES = 24  # of a random history in time or height
KINDS = (
    "wind_shear",
    "turbulence",
    "density_profile",
    "density_layer",
    "inertia_asymmetry",
    "cg_drift",
    "tip_change",
    "slosh",
    "inertia_loss",
    "three_lobes",
    "two_lobes",
    "static_alpha_squared",
    "static_mach",
    "damping_mach",
    "damping_alpha",
    "side_moment",
    "random_flow",
    "gyro_walk",
    "gyro_g",
    "accel_drift",
    "rectification",
    "noise_by_pressure",
    "held_air_data",
    "bandwidth",
    "air_data_lag",
    "gradual_onset",
)


@dataclass(frozen=True)
class Lines:
    """A random history: sinusoids (amplitude, angular frequency, phase), in time or along height."""

    amplitude: np.ndarray
    frequency: np.ndarray
    phase: np.ndarray

    def at(self, place: float) -> tuple[np.ndarray, np.ndarray]:
        """Its value and derivative at a place; both of the amplitudes' leading shape."""
        angle = self.frequency * place + self.phase
        return (self.amplitude * np.cos(angle)).sum(-1), (-self.amplitude * self.frequency * np.sin(angle)).sum(-1)


def lines(rng: np.random.Generator, size: float, low: float, high: float, shape: tuple[int, ...] = ()) -> Lines:
    """A history of rms `size` with its power between two angular frequencies, falling as the square."""
    frequency = np.exp(rng.uniform(np.log(low), np.log(high), (*shape, LINES)))
    weight = 1.0 / frequency
    weight *= math.sqrt(2.0) / np.sqrt((weight**2).sum(-1, keepdims=True))
    return Lines(size * weight, frequency, rng.uniform(0.0, 2.0 * math.pi, (*shape, LINES)))


@dataclass(frozen=True)
class Imperfections:
    """How large each is; SI. Times are those of the record, from 0 to `duration`."""

    duration: float
    shear: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Wind per metre of height, 1/s, in earth axes."""
    gusts: Lines | None = None
    """Turbulence (3,) m/s along the time of flight."""
    density_course: Lines | None = None
    """Relative density about the standard atmosphere, by height (m)."""
    layer: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Relative density, height and half thickness (m) of a layer."""
    inertia_asymmetry: float = 0.0
    """Relative difference of the transverse moments of inertia."""
    inertia_loss: float = 0.0
    """Relative change of all moments of inertia over the record, as mass is lost."""
    cg_drift: tuple[float, float] = (0.0, 0.0)
    """Lateral path of the centre of mass over the record, m."""
    slosh: tuple[float, float, float] = (0.0, 1.0, 0.0)
    """Lateral amplitude (m), angular frequency (rad/s) and direction (rad) of a moving mass's centre."""
    tip: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Change of the static slope, 1/rad, of the moment along a body axis, and when (s): the nose tip ablates."""
    tip_angle: float = 0.0
    lobes: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Slopes (1/rad) of moments with two and three lobes about the body, and their direction (rad)."""
    alpha_squared: float = 0.0
    """In-plane moment per alpha^2."""
    static_mach: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Change of the static slope within a hat of Mach number: size, centre, half width."""
    damping_mach: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Change of the pitch damping within a hat of Mach number: size, centre, half width."""
    damping_alpha: tuple[float, float] = (0.0, 1.0)
    """Change of the pitch damping, size (1 - (alpha / a)^2), and a (rad)."""
    side: float = 0.0
    """Side moment per alpha and spin parameter."""
    flow: Lines | None = None
    """Random body-fixed moment (2,) between `flow_span`."""
    flow_span: tuple[float, float] = (0.0, 0.0)
    gyro_walk: float = 0.0
    """rad/s per root second."""
    gyro_g: float = 0.0
    """rad/s per m/s^2."""
    accel_drift: float = 0.0
    """m/s^2 per root second."""
    rectification: tuple[float, float] = (0.0, 0.0)
    """Step of the accelerometers (m/s^2), and when (s): vibration rectification."""
    noise_by_pressure: float = 0.0
    """Further noise over the stated one, at the largest dynamic pressure."""
    held: float = 0.0
    """Air data are written at this rate (Hz), held and rounded between; 0: at every sample."""
    bandwidth: float = 0.0
    """Hz, second-order low-pass of gyros and accelerometers; 0: none."""
    air_lag: float = 0.0
    """s by which air data are late."""
    onset: float = 0.0
    """s over which the planted mechanism begins."""
    kinds: tuple[str, ...] = field(default=())

    # ---- The air and the vehicle ----

    def winds(self, time: float, climb: float) -> tuple[np.ndarray, np.ndarray]:
        """Wind (3,) m/s and its rate beside the slow one; `climb` m/s along the nominal path."""
        shear = np.array(self.shear) * climb
        value, rate = shear * time, shear
        if self.gusts is not None:
            gust, turning = self.gusts.at(time)
            value, rate = value + gust, rate + turning
        return value, rate

    def density(self, altitude: float) -> float:
        """The air's density over the standard atmosphere's."""
        factor = 1.0
        if self.density_course is not None:
            factor += float(self.density_course.at(altitude)[0])
        size, height, half = self.layer
        return factor + size * math.exp(-(((altitude - height) / half) ** 2))

    def inertia(self, tensor: np.ndarray) -> np.ndarray:
        """The tensor (3, 3) with unequal transverse moments."""
        changed = tensor.copy()
        changed[1, 1] *= 1.0 + 0.5 * self.inertia_asymmetry
        changed[2, 2] *= 1.0 - 0.5 * self.inertia_asymmetry
        return changed

    def torque_share(self, time: float) -> float:
        """What inertia that is lost makes of the same torque."""
        return 1.0 / (1.0 + self.inertia_loss * (time / self.duration - 0.5))

    def centre(self, time: float) -> tuple[float, float]:
        """Lateral place (y, z) of the centre of mass beside its constant offset, m."""
        share = time / self.duration
        size, frequency, angle = self.slosh
        swing = size * math.sin(frequency * time)
        return (self.cg_drift[0] * share + swing * math.cos(angle), self.cg_drift[1] * share + swing * math.sin(angle))

    # ---- The moment ----

    def static(self, angle: float, mach: float) -> float:
        """In the plane of alpha, of alpha and Mach number."""
        return _hat(self.static_mach, mach) * angle + self.alpha_squared * angle**2

    def moment(self, now: Running) -> complex:
        """C_N' + i C_Z' of all that no mechanism of the list is."""
        here = complex(now.alpha)
        ablated = 0.5 * (1.0 + math.tanh((now.time - self.tip[2]) / (0.02 * self.duration)))
        found = self.tip[0] * ablated * here + self.static(now.alpha, now.mach)
        found += self.tip[1] * ablated * cmath.exp(1j * (now.meridian - self.tip_angle))
        two, three, angle = self.lobes
        found += two * here * cmath.exp(1j * (2.0 * now.meridian + angle))
        found += three * here * cmath.exp(1j * (3.0 * now.meridian + angle))
        size, zero = self.damping_alpha
        damping = _hat(self.damping_mach, now.mach) + size * (1.0 - (now.alpha / zero) ** 2)
        found += damping * now.turning * now.reduced
        found += 1j * self.side * now.spin * now.alpha
        first, last = self.flow_span
        if self.flow is not None and first < now.time < last:
            window = math.sin(math.pi * (now.time - first) / (last - first))
            pitch, yaw = self.flow.at(now.time)[0]
            found += window * complex(pitch, yaw) * cmath.exp(1j * now.meridian)
        return found

    # ---- The record ----

    def recorded(self, flight: Flight, rng: np.random.Generator, noise: tuple[float, float]) -> Flight:
        """The record as imperfect instruments write it; `noise` is that of gyros and accelerometers."""
        step, count = flight.step, flight.time.size
        rates = np.stack([flight.p, flight.q, flight.r], axis=1)
        force = np.stack([flight.ax, flight.ay, flight.az], axis=1)
        push = flight.dynamic_pressure / np.max(flight.dynamic_pressure)
        walks = np.cumsum(rng.standard_normal((2, count, 3)), axis=1) * math.sqrt(step)
        rates = rates + self.gyro_walk * walks[0] + self.gyro_g * force[:, [1, 2, 0]]
        force = force + self.accel_drift * walks[1]
        size, begin = self.rectification
        force = force + size * (flight.time >= begin)[:, None] * np.array([1.0, 0.7, -0.5])
        further_noise = self.noise_by_pressure * push[:, None]
        rates = rates + noise[0] * further_noise * rng.standard_normal((count, 3))
        force = force + noise[1] * further_noise * rng.standard_normal((count, 3))
        if self.bandwidth:
            b, a = butter(2, min(2.0 * step * self.bandwidth, 0.95))
            first = lfilter(b, a, np.ones(count))[:, None]
            rates, force = (_filtered(b, a, values, first) for values in (rates, force))
        air = {
            name: np.asarray(getattr(flight, name))
            for name in ("velocity", "dynamic_pressure", "altitude", "density", "mach", "reynolds")
        }
        if self.air_lag:
            air = {name: np.interp(flight.time - self.air_lag, flight.time, values) for name, values in air.items()}
        if self.held:
            every = max(round(1.0 / (step * self.held)), 1)
            kept = np.arange(count) // every * every
            air = {name: _rounded(values[kept]) for name, values in air.items()}
        channels = dict(zip(("p", "q", "r", "ax", "ay", "az"), [*rates.T, *force.T], strict=True))
        return replace(flight, **channels, **air)


def _hat(shape: tuple[float, float, float], mach: float) -> float:
    size, centre, half = shape
    return size * max(1.0 - abs(mach - centre) / half, 0.0)


def _filtered(b: np.ndarray, a: np.ndarray, values: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Through the filter at rest at the first sample."""
    return np.asarray(lfilter(b, a, values - values[0], axis=0) + values[0])


def _rounded(values: np.ndarray) -> np.ndarray:
    """To four digits of the largest value, as telemetry words of fourteen bits are."""
    unit = float(np.max(np.abs(values))) * 2.0**-14
    return np.asarray(np.round(values / unit) * unit)


def none(craft: Craft) -> Imperfections:
    """A flight that has none."""
    return Imperfections(craft.duration)


def ordinary(craft: Craft, kinds: tuple[str, ...], rng: np.random.Generator, size: float = 1.0) -> Imperfections:
    """These kinds at `size` times an ordinary size; the same draws are made whichever are wanted."""
    span, slope = craft.duration, abs(craft.static_slope)
    density, temperature = atmosphere(craft.altitude)
    sound = 20.0468 * math.sqrt(temperature)
    mach, trim = craft.speed / sound, slope * craft.alpha
    pressure = 0.5 * density * craft.speed**2 * craft.vehicle.reference_area * craft.vehicle.reference_length
    frequency = math.sqrt(pressure * slope / craft.vehicle.iyy)
    drop = max(craft.speed * abs(craft.flight_path) * span, 500.0)
    angle, other, sign = rng.uniform(-np.pi, np.pi), rng.uniform(-np.pi, np.pi), float(rng.choice([-1.0, 1.0]))
    begin = rng.uniform(0.3, 0.6) * span
    cosine, sine = math.cos(angle), math.sin(angle)
    fall = abs(drop) / span  # m/s
    gusts = lines(rng, 2.0 * size, 2.0 * np.pi / span, 3.0 * frequency, (3,))
    profile = lines(rng, 0.03 * size, 2.0 * np.pi / (4.0 * SCALE_HEIGHT), 2.0 * np.pi / 2000.0)
    flow = lines(rng, 0.03 * size * trim, 0.3 * frequency, 3.0 * frequency, (2,))
    made = {
        "wind_shear": {"shear": (10.0 * size * cosine / drop, 10.0 * size * sine / drop, 0.0)},
        "turbulence": {"gusts": gusts},
        "density_profile": {"density_course": profile},
        "density_layer": {"layer": (0.03 * size * sign, craft.altitude - fall * begin, 0.1 * drop)},
        "inertia_asymmetry": {"inertia_asymmetry": 0.015 * size * sign},
        "cg_drift": {"cg_drift": (3e-4 * size * cosine, 3e-4 * size * sine)},
        "tip_change": {"tip": (0.01 * size * sign * slope, 0.01 * size * trim, begin), "tip_angle": other},
        "slosh": {"slosh": (1e-4 * size, 0.7 * frequency, other)},
        "inertia_loss": {"inertia_loss": -0.01 * size},
        "three_lobes": {"lobes": (0.0, 0.02 * size * slope, other)},
        "two_lobes": {"lobes": (0.01 * size * slope, 0.0, other)},
        "static_alpha_squared": {"alpha_squared": 0.05 * size * sign * slope / craft.alpha},
        "static_mach": {"static_mach": (0.03 * size * sign * slope, mach, 0.03 * mach)},
        "damping_mach": {"damping_mach": (0.5 * size * abs(craft.damping), mach, 0.03 * mach)},
        "damping_alpha": {"damping_alpha": (0.3 * size * abs(craft.damping), craft.alpha)},
        "side_moment": {"side": 0.5 * size * sign * slope},
        "random_flow": {"flow": flow, "flow_span": (begin, min(begin + 0.3 * span, span))},
        "gyro_walk": {"gyro_walk": 0.01 * _DEGREE * size},
        "gyro_g": {"gyro_g": 0.01 * _DEGREE * size / 9.80665},
        "accel_drift": {"accel_drift": 0.005 * size},
        "rectification": {"rectification": (0.2 * size * sign, begin)},
        "noise_by_pressure": {"noise_by_pressure": 1.0 * size},
        "held_air_data": {"held": 10.0},
        "bandwidth": {"bandwidth": 60.0},
        "air_data_lag": {"air_lag": 0.05 * size},
        "gradual_onset": {"onset": 0.1 * size * span},
    }
    wanted: dict[str, object] = {}
    for kind in kinds:
        for name, value in made[kind].items():
            if name == "lobes" and name in wanted:
                value = (*(a + b for a, b in zip(wanted[name][:2], value[:2], strict=True)), value[2])  # type: ignore[index]
            wanted[name] = value
    return Imperfections(span, **wanted, kinds=tuple(kinds))  # type: ignore[arg-type]
