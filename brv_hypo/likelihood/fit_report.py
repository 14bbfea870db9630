"""A fit in words and numbers, in the manner of lmfit's report."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from brv_hypo.arrays import FloatArray

if TYPE_CHECKING:
    from brv_hypo.likelihood.result import FitResult

_CORRELATED = 0.5
"""Least correlation that is listed."""
_MOST_CORRELATIONS = 10
_FAR = 0.5
"""Weight below which a sample is counted as far off."""


def fit_report(result: FitResult) -> str:
    """Status, statistics, noise, parameters with both errors, correlations, and what to beware of."""
    blocks = (
        ["[[Fit]]", *_statistics(result)],
        ["[[Noise]]", *_noise(result)],
        ["[[Parameters]]", *_parameters(result)],
        _correlations(result),
        _warnings(result),
    )
    return "\n".join(line for block in blocks for line in block)


def correlations(result: FitResult) -> FloatArray:
    """Correlation of the estimates (p, p), from the coloured covariance; nan where there is no error."""
    error = np.sqrt(np.diag(result.covariance_coloured))
    with np.errstate(all="ignore"):
        return np.asarray(result.covariance_coloured / np.outer(error, error))


def _statistics(result: FitResult) -> list[str]:
    p = len(result.names)
    aic = 2.0 * p + 2.0 * result.nllf
    rows = [
        ("status", f"{result.status}: {result.message}"),
        ("iterations", f"{result.iterations}"),
        ("measured values", f"{result.samples}"),
        ("parameters", f"{p}"),
        ("log-likelihood", f"{result.log_likelihood:.6g} (without its constant)"),
        ("Akaike", f"{aic:.6g}"),
        (
            "steps per sample",
            f"{result.mesh_steps}, mesh moves estimates by {result.mesh_shift:.2g} sigma at most",
        ),
    ]
    return [f"    {name:<18}= {value}" for name, value in rows]


def _noise(result: FitResult) -> list[str]:
    found = []
    for i, (variance, error, test) in enumerate(
        zip(np.diag(result.noise_covariance), result.noise_std_error, result.whiteness, strict=True)
    ):
        spread = f" +/- {error:.2g}" if np.isfinite(error) else ""
        colour = "white" if test.white else f"not white (p {test.p_value:.1g}, lag {test.largest_lag})"
        found.append(f"    output {i}: {np.sqrt(variance):.4g}{spread}{_tails(result, i)}, innovations {colour}")
    for i, (size, error) in enumerate(zip(result.process_noise, result.process_noise_std_error, strict=True)):
        if size > 0.0:
            spread = f" +/- {error:.2g}" if np.isfinite(error) else ""
            found.append(f"    state {i} is driven by {size:.4g}{spread} per root second")
    return found


def _tails(result: FitResult, output: int) -> str:
    """Degrees of freedom of an output's noise, and how many samples hardly count."""
    if result.noise_freedom is None:
        return ""
    weights = np.concatenate([each[output] for each in result.weights])
    freedom, far = result.noise_freedom[output], int(np.sum(weights < _FAR))
    return f" (scale of Student's t, {freedom:.3g} degrees of freedom; {far} samples weigh less than {_FAR:g})"


def _parameters(result: FitResult) -> list[str]:
    width = max(len(name) for name in result.theta)
    found = []
    for name, value in result.theta.items():
        if name not in result.std_error:
            found.append(f"    {name:<{width}}  {value: .6g} (held)")
            continue
        error, white = result.std_error_coloured[name], result.std_error[name]
        note = f" +/- {error:.3g} (white {white:.3g})" if np.isfinite(error) else " (not determined)"
        relative = f" ({abs(error / value):.2%})" if np.isfinite(error) and value != 0.0 else ""
        kind = " (at its bound)" if name in result.at_bound else "" if name in result.names else " (tied)"
        found.append(f"    {name:<{width}}  {value: .6g}{note}{relative}{kind}")
    return found


def _correlations(result: FitResult) -> list[str]:
    matrix = correlations(result)
    i, j = np.triu_indices(len(result.names), 1)
    size = np.abs(matrix[i, j])
    order = [k for k in np.argsort(-np.nan_to_num(size), kind="stable") if size[k] >= _CORRELATED]
    if not order:
        return []
    rows = [
        f"    C({result.names[i[k]]}, {result.names[j[k]]}) = {matrix[i[k], j[k]]:+.3f}"
        for k in order[:_MOST_CORRELATIONS]
    ]
    return [f"[[Correlations]] (of {_CORRELATED:g} and more)", *rows]


def _warnings(result: FitResult) -> list[str]:
    found = list(result.remarks)
    if result.identifiability.near_null:
        found.append(str(result.identifiability))
    return ["[[Beware]]", *(f"    {text}" for text in found)] if found else []
