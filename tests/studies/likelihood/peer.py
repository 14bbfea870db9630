"""`python -m tests.studies.likelihood.peer`: filter error beside statsmodels, on the same records in the same run.

The short period in turbulence: 8 parameters, process and measurement noise estimated, both programs from parameters a
fifth off and noises twice too large. The peer is `MLEModel` of statsmodels (Kalman filter in C, maximised by its L-BFGS
with its complex-step scores and its covariance from the observed information); the model is discretised exactly for
it. Processor times of one thread, the fit and its standard errors; the median of the ratios is what counts.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import expm

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.fit import fit
from brv_hypo.likelihood.result import FitResult
from brv_hypo.likelihood.segment import Segment
from tests.studies.likelihood.problems import short_period

_DRIVE = np.array([0.005, 0.03])
"""Process noise of angle of attack and pitch rate per root second, rad and rad/s."""
_OFF, _NOISE_OFF = 0.8, 2.0
"""Start over truth, of parameters and of noises."""
_WIDE = 1e2
"""Variance of the peer's initial state, far above that of any motion."""
_PEER_ITERATIONS = 500
_LEAST_NOISE = 1e-12
"""Noise that went to 0, for its logarithm."""


@dataclass(frozen=True)
class Comparison:
    """One record: processor s of both, whether both converged, and the largest difference of a parameter in sigma.

    `likelier`: log-likelihood of the peer's model at what is found here less that at what the peer found. The peer's
    first state is known less, which costs some tenths; above that the peer has ended at a poorer optimum.
    """

    ours: float
    peer: float
    converged: tuple[bool, bool]
    apart: float
    likelier: float

    @property
    def ratio(self) -> float:
        """How many times longer the peer takes."""
        return self.peer / self.ours


def compare(samples: int, seed: int | np.random.SeedSequence) -> Comparison:
    """Both programs on one simulated record."""
    problem = replace(short_period(), process_noise=_DRIVE, hold="linear")
    segment = problem.simulate(samples, seed)
    start = problem.start(_OFF)
    began = time.process_time()
    found = fit(problem.dynamics, problem.outputs, [segment], start, _NOISE_OFF * _DRIVE, estimate_process_noise=True)
    middle = time.process_time()
    peer = _fitted_by_peer(segment, start, _NOISE_OFF * problem.noise)
    ended = time.process_time()
    apart = max(abs(found.theta[name] - peer.theta[name]) / peer.error[name] for name in start)
    likelier = peer.log_likelihood_at(_as_the_peer_does(found, list(start))) - peer.log_likelihood
    return Comparison(middle - began, ended - middle, (found.converged, peer.converged), apart, likelier)


def _as_the_peer_does(found: FitResult, names: Sequence[str]) -> FloatArray:
    """The peer's parameters: those of the model, and logarithms of both noises."""
    measured = np.sqrt(found.noise_variance)
    noises = np.maximum(np.concatenate([found.process_noise, measured]), _LEAST_NOISE)
    return np.concatenate([[found.theta[name] for name in names], np.log(noises)])


@dataclass(frozen=True)
class _Peer:
    """What statsmodels found, whether it calls that converged, and its log-likelihood there and elsewhere."""

    theta: dict[str, float]
    error: dict[str, float]
    converged: bool
    log_likelihood: float
    log_likelihood_at: Callable[[FloatArray], float]


def _fitted_by_peer(segment: Segment, start: Mapping[str, float], noise: FloatArray) -> _Peer:
    from statsmodels.tsa.statespace.mlemodel import MLEModel

    t, u, names = np.asarray(segment.t), np.asarray(segment.u), list(start)
    step = float(t[1] - t[0])

    class ShortPeriod(MLEModel):  # type: ignore[misc]
        """Parameters as in `short_period`, then the logarithms of process and measurement noise."""

        @property
        def start_params(self) -> FloatArray:
            return np.concatenate([list(start.values()), np.log(_NOISE_OFF * _DRIVE), np.log(noise)])

        @property
        def param_names(self) -> list[str]:
            return [*names, "q_alpha", "q_rate", "r_alpha", "r_rate"]

        def update(self, params: Any, **options: Any) -> None:
            params = super().update(params, **options)
            theta = dict(zip(names, params[:8], strict=True))
            transition, by_input, driving = _discrete(theta, np.exp(2.0 * params[8:10]), step)
            self["transition"] = transition
            inputs = np.stack([u[0], np.append(u[0, 1:], u[0, -1])])
            self["state_intercept"] = by_input @ inputs
            self["state_cov"] = driving
            self["obs_intercept"] = np.array([theta["alpha_bias"], theta["q_bias"]])
            self["obs_cov"] = np.diag(np.exp(2.0 * params[10:12]))

    model = ShortPeriod(np.asarray(segment.y).T, k_states=2, k_posdef=2)
    model["design"] = model["selection"] = np.eye(2)
    model.ssm.initialize_approximate_diffuse(_WIDE)
    found = model.fit(disp=False, maxiter=_PEER_ITERATIONS)
    theta = dict(zip(names, np.real(found.params[:8]).tolist(), strict=True))
    error = dict(zip(names, found.bse[:8].tolist(), strict=True))
    return _Peer(theta, error, bool(found.mle_retvals["converged"]), float(found.llf), model.loglike)


def _discrete(theta: Mapping[str, Any], intensity: Any, step: float) -> tuple[Any, Any, Any]:
    """Transition (2, 2), effect of the input at both ends of a step, linear between (2, 2), and process noise (2, 2).

    Van Loan, IEEE Trans. Automatic Control 23 (1978) 395.
    """
    A = np.array([[theta["Z_alpha"], theta["Z_q"]], [theta["M_alpha"], theta["M_q"]]])
    B = np.array([theta["Z_delta"], theta["M_delta"]])
    held = np.zeros((4, 4), dtype=A.dtype)
    held[:2, :2], held[:2, 2], held[2, 3] = A, B, 1.0 / step
    moved = expm(held * step)
    noisy = np.zeros((4, 4), dtype=A.dtype)
    noisy[:2, :2], noisy[:2, 2:], noisy[2:, 2:] = -A, np.diag(intensity), A.T
    spread = expm(noisy * step)
    transition = spread[2:, 2:].T
    by_input = np.stack([moved[:2, 2] - moved[:2, 3], moved[:2, 3]], axis=1)
    return transition, by_input, transition @ spread[:2, 2:]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print one line a record and the median of the ratios."""
    parser = argparse.ArgumentParser(prog="python -m tests.studies.likelihood.peer", description=__doc__)
    parser.add_argument("--records", type=int, default=5)
    parser.add_argument("--samples", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args(arguments)
    compare(50, chosen.seed)  # loads what both need
    found = [compare(chosen.samples, each) for each in np.random.SeedSequence(chosen.seed).spawn(chosen.records)]
    for each in found:
        print(
            f"here {each.ours:.3f} s, statsmodels {each.peer:.2f} s, ratio {each.ratio:.1f}; "
            f"converged {each.converged}, {each.apart:.2f} sigma apart at most, "
            f"log-likelihood {each.likelier:+.2f} here"
        )
    print(f"median ratio {np.median([each.ratio for each in found]):.1f}")


if __name__ == "__main__":
    main()
