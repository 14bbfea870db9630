"""Robertson's reaction: rates nine decades apart, all states measured, and what its status advises.

As it is, the fastest state settles thousands of times over between two samples: `too stiff`. Where that state follows
the others at once (quasi-steady state: Bodenstein, Z. physikalische Chemie 85 (1913) 329), it is an output alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from brv_hypo.arrays import FloatArray
from brv_hypo.likelihood.estimate import fit
from brv_hypo.likelihood.hard_problems import scattered
from brv_hypo.likelihood.segment import Segment
from brv_hypo.likelihood.status import Status

TRUTH = {"k1": 0.04, "k2": 3e7, "k3": 1e4}
_NOISE = np.array([3e-3, 3e-7, 3e-3])
_SPREAD = 0.5
"""How far off start values are, at most."""
_ROUNDS = 3
"""Times that the fastest state is found again from the others, beside which it is 4e-5 at most."""


def reaction(x: Any, u: Any, theta: Any, t: Any) -> Any:
    """All three states."""
    decay, pairs, back = theta["k1"] * x[0], theta["k2"] * x[1] ** 2, theta["k3"] * x[1] * x[2]
    return np.stack([back - decay, decay - pairs - back, pairs])


def followed(x: Any, u: Any, theta: Any, t: Any) -> Any:
    """All states from the first, (3, n): the second follows at once, the sum stays 1."""
    fast = 0.0 * x[0]
    for _ in range(_ROUNDS):
        back = theta["k3"] * (1.0 - x[0] - fast)
        fast = 2.0 * theta["k1"] * x[0] / (back + np.sqrt(back**2 + 4.0 * theta["k2"] * theta["k1"] * x[0]))
    return np.stack([x[0], fast, 1.0 - x[0] - fast])


def slow_reaction(x: Any, u: Any, theta: Any, t: Any) -> Any:
    """The first state alone, of which the sum loses what pairs make of the second."""
    return -theta["k2"] * followed(x, u, theta, t)[1:2] ** 2


def motion(times: FloatArray) -> FloatArray:
    """True states, (3, n)."""
    from scipy.integrate import solve_ivp

    found = solve_ivp(
        lambda t, x: reaction(x, None, TRUTH, t), (0.0, times[-1]), [1.0, 0.0, 0.0], "Radau", times,
        rtol=1e-9, atol=1e-13,
    )  # fmt: skip
    return np.asarray(found.y)


def measured(times: FloatArray, x: FloatArray, rng: np.random.Generator) -> Segment:
    """A record of all three states, the first start known."""
    y = x + _NOISE[:, None] * rng.standard_normal(x.shape)
    return Segment(times, np.zeros((0, times.size)), y, np.array([1.0, 0.0, 0.0]), x0_std=0.0)


def print_robertson(trials: int, seed: int, echo: Callable[[str], None]) -> None:
    """Both models on the same records over seven decades of time."""
    times = np.append(0.0, np.geomspace(0.4, 4e6, 60))
    x = motion(times)
    stiff, scores = [], []
    for child in np.random.SeedSequence(seed).spawn(trials):
        rng = np.random.default_rng(child)
        whole, start = measured(times, x, rng), scattered(TRUTH, _SPREAD, rng)
        stiff.append(fit(reaction, lambda x, u, theta, t: x, [whole], start).status is Status.STIFF)
        slow = replace(whole, y=np.where(times > 0.0, whole.y, np.nan), x0=np.array([1.0]))
        found = fit(slow_reaction, followed, [slow], start)
        error = [(found.theta[k] - v) / found.std_error[k] for k, v in TRUTH.items()]
        scores.append(error if found.converged else [np.nan] * len(TRUTH))
    good = np.isfinite(scores).all(axis=1)
    kept = np.array(scores)[good]
    echo(f"Robertson's reaction, {trials} trials: {np.mean(stiff):.1%} too stiff")
    echo(
        f"  its fastest state following at once: {good.mean():.1%} converged, "
        f"within 2 sigma {np.mean(np.abs(kept) <= 2):.1%}, "
        f"scatter {np.sqrt(np.mean(kept**2)):.2f} sigma, mean error {np.max(np.abs(kept.mean(axis=0))):.2f} at most"
    )
