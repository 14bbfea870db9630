"""Lagrange's polynomials through the nearest of many nodes, as one sparse operator."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from brv_hypo.arrays import FloatArray

NEAREST = 6
"""Nodes that a place lies between: degree 5, whose error at 24 nodes a cycle is 2e-6 of a sine."""


def lagrange(nodes: FloatArray, places: FloatArray) -> sparse.csr_array:
    """Weights (places, nodes) of the values at ascending `nodes` (m,) that make those at `places` (n,)."""
    width = min(NEAREST, nodes.size)
    first = np.clip(np.searchsorted(nodes, places, side="right") - width // 2, 0, nodes.size - width)
    weights = np.ones((places.size, width))
    for own in range(width):
        node = nodes[first + own]
        for other in range(width):
            if other != own:
                weights[:, own] *= (places - nodes[first + other]) / (node - nodes[first + other])
    which = (first[:, np.newaxis] + np.arange(width)).ravel()
    return sparse.csr_array(
        (weights.ravel(), which, np.arange(places.size + 1) * width), shape=(places.size, nodes.size)
    )
