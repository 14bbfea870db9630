"""What is fitted along in every hypothesis: noise-free histories, with priors where tolerances bound them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from brv_hypo.flight.record import Flight
from brv_hypo.motion import reconstruct
from brv_hypo.ranking import CompareConfig
from brv_hypo.ranking.compare import prepare
from brv_hypo.regression.nuisance import Nuisances
from tests.flights import nominal

GYROS, ACCELEROMETERS = ("p", "q", "r"), ("ax", "ay", "az")


def noisier(flight: Flight, seed: int) -> Flight:
    """The flight with noise added, about as much as it has."""
    rng = np.random.default_rng(seed)
    channels = {
        name: getattr(flight, name)
        + np.std(np.diff(getattr(flight, name), 3)) / np.sqrt(20.0) * rng.standard_normal(flight.samples)
        for name in (*GYROS, *ACCELEROMETERS)
    }
    return replace(flight, **channels)


@cache
def carried(seed: int) -> Nuisances:
    return prepare([reconstruct(noisier(nominal().flight, seed))], CompareConfig()).rows.nuisances
