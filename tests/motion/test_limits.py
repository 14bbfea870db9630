"""What a reconstruction says limits it is said of the record as it is, and names what is counted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from brv_hypo.motion.inertial import inertial_record
from brv_hypo.motion.methods import ReconstructionConfig, methods
from brv_hypo.motion.pipeline import limits_of, moment_estimate
from tests.flights import nominal


def test_noise_is_compared_with_the_moments_that_the_gyros_measured() -> None:
    """Fitted errors that explain nearly all of the moments do not make the noise thousands of times these."""
    config = ReconstructionConfig(method="rates")
    record = inertial_record(nominal().flight, config)
    wind = methods()["rates"](record, config, ())
    moments = moment_estimate(wind.record, wind.effects)
    assert not any("differentiating" in text for text in limits_of(record, wind, moments))
    emptied = replace(moments, body=1e-4 * moments.body)
    (warning,) = (text for text in limits_of(record, wind, emptied) if "differentiating" in text)
    share = float(warning.split("the gyros is ")[1].split(" %")[0])
    size = np.sqrt(np.mean(np.abs(record.moment[moments.usable]) ** 2) / 2.0)
    noise = np.sqrt(np.mean(moments.noise_sigma[moments.usable] ** 2))
    assert 0.2 * noise / size < share / 100.0 + 0.005 < 5.0 * noise / size + 0.01
    assert "0.01 % of these moments remain" in warning
