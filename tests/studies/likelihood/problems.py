"""Model problems with a known answer: for the benchmark, the studies and the tests.

Some mislead a fit: a model without the stall that was flown, inputs held between samples, gaps, motion too fast for
its samples.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.collocation import Differenced, Function
from brv_hypo.likelihood.result import FitResult
from brv_hypo.likelihood.segment import Hold, Segment

# ---- Model problems with a known answer: for the benchmark, the study and the tests ----


_SUBSTEPS = 8
"""Steps of the simulation between samples."""


def by_central_differences(function: Function) -> Function:
    """The function, differentiated by central differences."""
    return Differenced(function)


@dataclass(frozen=True)
class ModelProblem:
    """Functions, truth and instruments of a problem.

    Attributes:
        dynamics, outputs: as `fit` takes them.
        truth: parameters that the data are simulated with.
        inputs: u(t), t (n,) -> (n_inputs, n).
        x0: true initial state, (n_states,).
        noise: standard deviation of each output, (n_outputs,).
        rate: samples per second.
        process_noise: standard deviation per root second of the noise that drives each state, (n_states,).
        delays: names of parameters that are delays.
        hold: what the inputs do between samples; "zero" where `inputs` steps at the samples only.
        guess: the segment's x0, (n_states,); None for zeros.
        substeps: steps of the simulation between samples; more where the motion is fast for them.
    """

    dynamics: Function
    outputs: Function
    truth: Mapping[str, float]
    inputs: Callable[[FloatArray], FloatArray]
    x0: FloatArray
    noise: FloatArray
    rate: float
    process_noise: FloatArray | None = None
    delays: tuple[str, ...] = ()
    hold: Hold = "cubic"
    guess: FloatArray | None = None
    substeps: int = _SUBSTEPS

    def simulate(self, n: int, seed: int | np.random.SeedSequence, correlation: float = 0.0) -> Segment:
        """A record of n samples; `correlation` is that of the noise from one sample to the next.

        The segment's x0 is what the instruments give: zeros, or the guess.
        """
        rng = np.random.default_rng(seed)
        t = np.arange(n) / self.rate
        return self.measure(t, self.trajectory(t, rng), rng, correlation)

    def measure(self, t: FloatArray, x: FloatArray, rng: np.random.Generator, correlation: float) -> Segment:
        """A record of the true states x, (n_states, n), with fresh noise."""
        u = self.inputs(t)
        y = np.array(self.outputs(x, u, self.truth, t, *self._delayed(t, x, u)))
        y += self.noise[:, None] * markov_noise(rng, y.shape, correlation)
        guess = np.zeros(self.x0.size) if self.guess is None else self.guess
        return Segment(t, u, y, guess, hold=self.hold)

    def trajectory(self, t: FloatArray, rng: np.random.Generator) -> FloatArray:
        """True states, (n_states, n), by Runge-Kutta steps much finer than the samples."""
        step = (t[1] - t[0]) / self.substeps
        fine = t[0] + step * np.arange((t.size - 1) * self.substeps + 1)
        u_mid = self.inputs(fine + step / 2)
        u, u_end = (u_mid, u_mid) if self.hold == "zero" else (self.inputs(fine), self.inputs(fine + step))
        lag = {name: round(self.truth[name] / step) for name in self.delays}
        x = np.empty((self.x0.size, fine.size))
        x[:, 0] = self.x0
        drive = self.process_noise

        def slope(state: FloatArray, inputs: FloatArray, k: float) -> FloatArray:
            past: tuple[Any, ...] = ()
            if self.delays:
                past = ({name: _past(x, u, k - shift) for name, shift in lag.items()},)
            # One sample as scalars: NumPy takes several times as long over arrays of one.
            return np.asarray(self.dynamics(state, inputs, self.truth, fine[0], *past), dtype=float)

        for k in range(fine.size - 1):
            now = x[:, k]
            k1 = slope(now, u[:, k], k)
            k2 = slope(now + step / 2 * k1, u_mid[:, k], k + 0.5)
            k3 = slope(now + step / 2 * k2, u_mid[:, k], k + 0.5)
            k4 = slope(now + step * k3, u_end[:, k], k + 1)
            x[:, k + 1] = now + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            if drive is not None:
                x[:, k + 1] += np.sqrt(step) * drive * rng.standard_normal(drive.size)
        return x[:, :: self.substeps]

    def start(self, share: float) -> dict[str, float]:
        """Start values: that share of the truth."""
        return {name: share * value for name, value in self.truth.items()}

    def score(self, result: FitResult) -> list[float]:
        """Errors of the parameters in standard errors."""
        return [(result.theta[name] - value) / result.std_error[name] for name, value in self.truth.items()]

    def with_truth(self, **values: float) -> ModelProblem:
        """The same problem with other true values."""
        return replace(self, truth=dict(self.truth) | values)

    def _delayed(self, t: FloatArray, x: FloatArray, u: FloatArray) -> tuple[Any, ...]:
        if not self.delays:
            return ()
        from brv_hypo.likelihood.collocation import Delayed
        from brv_hypo.likelihood.segment import interpolation

        late = {name: interpolation(t, t - self.truth[name])[0].T for name in self.delays}
        return ({name: Delayed(np.asarray(x @ at), np.asarray(u @ at)) for name, at in late.items()},)


def markov_noise(rng: np.random.Generator, shape: tuple[int, ...], correlation: float) -> FloatArray:
    """Noise of unit variance, correlated along the last axis by `correlation` per sample."""
    from scipy.signal import lfilter

    white = rng.standard_normal(shape)
    white[..., 1:] *= np.sqrt(1.0 - correlation**2)
    return np.asarray(lfilter([1.0], [1.0, -correlation], white, axis=-1))


def short_period() -> ModelProblem:
    """Short-period motion of an aircraft: 2 states (alpha, q), 2 outputs, 8 parameters, 25 Hz."""

    def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
        alpha, q = x
        return np.array(
            [
                theta["Z_alpha"] * alpha + theta["Z_q"] * q + theta["Z_delta"] * u[0],
                theta["M_alpha"] * alpha + theta["M_q"] * q + theta["M_delta"] * u[0],
            ]
        )

    def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return np.array([x[0] + theta["alpha_bias"], x[1] + theta["q_bias"]])

    truth = {
        "Z_alpha": -1.2, "Z_q": 0.95, "Z_delta": -0.1,
        "M_alpha": -6.0, "M_q": -1.5, "M_delta": -8.0,
        "alpha_bias": 0.01, "q_bias": -0.02,
    }  # fmt: skip
    return ModelProblem(dynamics, outputs, truth, _elevator, np.array([0.02, 0.0]), np.array([0.002, 0.005]), rate=25.0)


def spinning_body(
    pitch_damping: float = -0.3, limit: float = np.inf, x0: tuple[float, ...] = (0.0, 0.1, 0.15, 0.05)
) -> ModelProblem:
    """A spinning axisymmetric body with gyros and accelerometers: 10 parameters.

    States q, r (rad/s), alpha, beta (rad); roll rate and velocity are inputs. The damping M_q changes its
    sign at the total angle of attack `limit`, rad: a positive M_q makes small motion grow up to a limit
    cycle.
    """
    inertia = 0.8

    def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
        q, r, alpha, beta = x
        p = u[0]
        damping = theta["M_q"] * (1.0 - (alpha * alpha + beta * beta) / limit**2)
        stiffness, magnus = theta["M_alpha"], theta["M_p"] * p
        return np.array(
            [
                inertia * p * r + stiffness * alpha + damping * q + magnus * beta + theta["M_y"],
                -inertia * p * q - stiffness * beta + damping * r + magnus * alpha + theta["M_z"],
                q - p * beta - theta["Z_alpha"] * alpha,
                -r + p * alpha - theta["Z_alpha"] * beta,
            ]
        )

    def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
        q, r, alpha, beta = x
        force = -u[1] * theta["Z_alpha"]
        return np.array(
            [
                q + theta["q_bias"],
                r + theta["r_bias"],
                force * alpha + theta["az_bias"],
                force * beta + theta["ay_bias"],
            ]
        )

    truth = {
        "M_alpha": -20.0, "M_q": pitch_damping, "M_p": 0.4, "M_y": 0.05, "M_z": -0.08, "Z_alpha": 0.3,
        "q_bias": 0.004, "r_bias": -0.003, "az_bias": 0.2, "ay_bias": -0.1,
    }  # fmt: skip
    noise = np.array([0.01, 0.01, 0.2, 0.2])
    return ModelProblem(dynamics, outputs, truth, _spin, np.array(x0), noise, rate=25.0)


def growing_body() -> ModelProblem:
    """The spinning body with an angle of attack that grows twentyfold in 2 s and then stays bounded."""
    return spinning_body(pitch_damping=2.9, limit=0.2, x0=(0.0, 0.02, 0.005, 0.0))


def lagging_body() -> ModelProblem:
    """An oscillator whose restoring moment acts late: 2 states, 4 parameters, one of them a delay."""

    def dynamics(x: Any, u: Any, theta: Any, t: Any, delayed: Any) -> Any:
        angle, rate = x
        late = delayed["delay"].x[0]
        return np.array([rate, theta["stiffness"] * angle + theta["late"] * late + theta["damping"] * rate + u[0]])

    def outputs(x: Any, u: Any, theta: Any, t: Any, delayed: Any) -> Any:
        return np.array([x[0], x[1]])

    truth = {"stiffness": -12.0, "late": -4.0, "damping": -1.0, "delay": 0.2}
    return ModelProblem(
        dynamics,
        outputs,
        truth,
        _elevator_strong,
        np.array([0.0, 0.0]),
        np.array([0.002, 0.01]),
        50.0,
        delays=("delay",),
    )


def _past(x: FloatArray, u: FloatArray, k: float) -> Any:
    """States and inputs at the fine step k, whole or half; the first one held before the start."""
    from brv_hypo.likelihood.collocation import Delayed

    low = max(int(np.floor(k)), 0)
    high = max(int(np.ceil(k)), 0)
    return Delayed(0.5 * (x[:, low] + x[:, high]), 0.5 * (u[:, low] + u[:, high]))


def _elevator(t: FloatArray) -> FloatArray:
    return np.asarray(0.05 * np.sin(0.9 * t) + 0.05 * np.sin(2.3 * t + 1) + 0.03 * np.sin(5 * t))[None]


def _elevator_strong(t: FloatArray) -> FloatArray:
    return 20 * _elevator(t)


def _spin(t: FloatArray) -> FloatArray:
    return np.array([1.5 + 0.3 * np.sin(0.2 * t), 300.0 - 2.0 * t % 100])


_MASS, _AREA, _CHORD, _INERTIA = 7500.0, 28.0, 2.3, 40000.0
"""kg, m2, m, kg m2: a small business jet."""
_DENSITY, _GRAVITY, _THRUST = 0.6, 9.81, 9000.0
"""kg/m3, m/s2, N."""
_SPEED = 120.0
"""About which lift, drag and moment change with speed, m/s."""
_STALL_ANGLE, _STALL_WIDTH = 0.17, 0.012
"""Angle of attack at which the flow separates, and over which, rad."""
_TRIM = -0.02
"""Elevator, rad."""
_FAST_SUBSTEPS = 64
"""Steps of the simulation between samples that are far apart."""

_AIRCRAFT = {
    "CL0": 0.12, "CLV": 0.1, "CLa": 5.3, "CD0": 0.03, "CDV": -0.05, "CDa": 0.1,
    "Cm0": 0.06, "CmV": 0.0, "Cma": -0.6, "Cmq": -18.0, "Cmde": -1.1,
}  # fmt: skip
"""Derivatives of the aircraft below its stall."""


def stalled_aircraft(severity: float) -> tuple[ModelProblem, ModelProblem]:
    """Longitudinal motion of an aircraft flown into stall: as it was flown, and the model without a stall.

    4 states (speed, angle of attack, pitch angle, pitch rate), 7 outputs (those, pitch acceleration, longitudinal and
    normal specific force), 11 parameters. At `severity` 4 the stall takes most of the lift that its angle would add.
    The truth of the second is that below the stall; what fits the record best is something else.
    """
    noise = np.array([0.3, 0.002, 0.002, 0.002, 0.01, 0.05, 0.2])
    start = np.array([_SPEED, 0.08, 0.08, 0.0])

    def forces(x: Any, u: Any, theta: Any, stall: float) -> tuple[Any, Any, Any, Any]:
        speed, alpha, _, q = x
        change = speed / _SPEED - 1.0
        lift = theta["CL0"] + theta["CLV"] * change + theta["CLa"] * alpha
        drag = theta["CD0"] + theta["CDV"] * change + theta["CDa"] * alpha
        moment = theta["Cm0"] + theta["CmV"] * change + theta["Cma"] * alpha + theta["Cmde"] * u[0]
        moment = moment + theta["Cmq"] * q * _CHORD / (2.0 * speed)
        if stall:
            beyond = alpha - _STALL_ANGLE
            separated = 0.5 * stall * (1.0 + np.tanh(beyond / _STALL_WIDTH))
            lift = lift - separated * (3.0 * beyond + 0.1)
            drag = drag + separated * (0.8 * beyond + 0.05) + 1.2 * alpha * alpha
            moment = moment - separated * (0.5 * beyond + 0.04)
        return lift, drag, moment, 0.5 * _DENSITY * _AREA * speed * speed

    def problem(stall: float) -> ModelProblem:
        def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
            speed, alpha, pitch, q = x
            lift, drag, moment, push = forces(x, u, theta, stall)
            along = (-push * drag + _THRUST * np.cos(alpha)) / _MASS + _GRAVITY * np.sin(alpha - pitch)
            across = (-push * lift - _THRUST * np.sin(alpha)) / _MASS + _GRAVITY * np.cos(alpha - pitch)
            return np.array([along, across / speed + q, q, push * _CHORD * moment / _INERTIA])

        def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
            _, alpha, _, _ = x
            lift, drag, moment, push = forces(x, u, theta, stall)
            forward = (push * (lift * np.sin(alpha) - drag * np.cos(alpha)) + _THRUST) / _MASS
            normal = -push * (lift * np.cos(alpha) + drag * np.sin(alpha)) / _MASS
            return np.array([*x, push * _CHORD * moment / _INERTIA, forward, normal])

        return ModelProblem(dynamics, outputs, _AIRCRAFT, _pull_ups, start, noise, rate=20.0, guess=start)

    return problem(severity), problem(0.0)


def held_short_period() -> ModelProblem:
    """The short period under a digital controller, whose elevator steps at the samples, 25 a second."""
    smooth = short_period()

    def stepped(t: FloatArray) -> FloatArray:
        sample = np.floor(np.asarray(t) * smooth.rate + 1e-6)
        return np.asarray(0.06 * np.sign(np.sin(0.37 * sample)) * np.cos(0.05 * sample))[None]

    return replace(smooth, inputs=stepped, hold="zero")


def oscillator(frequency: float) -> ModelProblem:
    """A damped oscillator, rad/s, its angle measured at 20 Hz: fast for its samples beyond about 10 rad/s."""

    def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return np.array([x[1], -theta["stiffness"] * x[0] - theta["damping"] * x[1]])

    def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return x[:1]

    truth = {"stiffness": frequency**2, "damping": 0.3}
    return ModelProblem(
        dynamics,
        outputs,
        truth,
        _nothing,
        np.array([1.0, 0.0]),
        np.array([0.01]),
        rate=20.0,
        guess=np.array([1.0, 0.0]),
        substeps=_FAST_SUBSTEPS,
    )


def kinetics(speed: float) -> ModelProblem:
    """A reaction whose first steps are `speed` times as fast as its last, all states measured at 20 Hz."""

    def dynamics(x: Any, u: Any, theta: Any, t: Any) -> Any:
        forward, back = theta["k1"] * x[0], theta["k3"] * x[1] * x[2]
        return np.array([back - forward, forward - back - theta["k2"] * x[1], theta["k2"] * x[1]])

    def outputs(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return x

    truth = {"k1": speed, "k2": 1.0, "k3": 2.0 * speed}
    start = np.array([1.0, 0.0, 0.0])
    return ModelProblem(
        dynamics, outputs, truth, _nothing, start, np.full(3, 0.005), rate=20.0, guess=start, substeps=_FAST_SUBSTEPS
    )


def with_gap(segment: Segment, first: float, seconds: float) -> Segment:
    """Nothing measured for so long, from a fraction of the record on."""
    t = np.asarray(segment.t)
    start = t[0] + first * (t[-1] - t[0])
    return replace(segment, y=np.where((t >= start) & (t < start + seconds), np.nan, segment.y))


def thinned(segment: Segment, share: float, rng: np.random.Generator) -> Segment:
    """That share of the samples, drawn anew, not measured."""
    y = np.array(segment.y)
    y[:, rng.random(y.shape[1]) < share] = np.nan
    return replace(segment, y=y)


def scattered(truth: Mapping[str, float], spread: float, rng: np.random.Generator) -> dict[str, float]:
    """Start values up to that fraction off the truth, either way."""
    return {name: value * (1.0 + spread * rng.uniform(-1.0, 1.0)) for name, value in truth.items()}


def _pull_ups(t: FloatArray) -> FloatArray:
    """Elevator, (1, n): two pull-ups into the stall, their recoveries, and a small motion after."""
    steps = ((2.0, 5.0, -0.12), (5.0, 7.0, 0.05), (12.0, 15.5, -0.14), (15.5, 18.0, 0.04))
    moved = sum(size * ((t > start) & (t < stop)) for start, stop, size in steps)
    return np.asarray(_TRIM + 1.2 * (moved - 0.03 * np.sin(1.1 * t) * (t > 18.0)))[None]


def _nothing(t: FloatArray) -> FloatArray:
    return np.zeros((0, np.size(t)))
