"""What users do with a fit: reports, tables, pickles."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np

from brv_hypo.likelihood import Segment, fit

TIMES = np.linspace(0.0, 5.0, 101)


def decay(x: Any, u: Any, theta: Any, t: Any) -> Any:
    return -theta["rate"] * x + theta["gain"]


def measured(x: Any, u: Any, theta: Any, t: Any) -> Any:
    return x


def record(sigma: float, rate: float = 0.8, gain: float = 0.4) -> Segment:
    x = gain / rate + (2.0 - gain / rate) * np.exp(-rate * TIMES)
    y = x + sigma * np.random.default_rng(4).standard_normal(TIMES.size)
    return Segment(TIMES, np.zeros((0, TIMES.size)), y[None], np.array([2.0]))


SEGMENT = record(0.02)
START = {"rate": 0.5, "gain": 0.5}
PLAIN = fit(decay, measured, [SEGMENT], START)


def test_the_report_says_what_a_reader_needs() -> None:
    fixed = fit(
        decay, measured, [SEGMENT], {"rate": 0.5, "gain": 0.4, "idle": 3.0}, bounds={"idle": (3.0, 3.0)}
    )  # fmt: skip
    text = fixed.report()
    for part in ("[[Fit]]", "status", "converged", "[[Noise]]", "output 0", "[[Parameters]]", "(held)"):
        assert part in text
    assert max(map(len, repr(fixed).splitlines())) < 200
    assert "<table>" in fixed._repr_html_()


def test_the_report_warns() -> None:
    def twice(x: Any, u: Any, theta: Any, t: Any) -> Any:
        return x + theta["bias"] - theta["trim"]

    text = fit(decay, twice, [SEGMENT], START | {"bias": 0.0, "trim": 0.0}).report()
    assert "[[Beware]]" in text
    assert "hardly seen by the data" in text
    assert "(not determined)" in text


def test_a_table_by_parameter_and_a_pickle() -> None:
    table = PLAIN.to_dataframe().set_index("parameter")
    assert list(table.index) == ["rate", "gain"]
    assert table.loc["rate", "value"] == PLAIN.theta["rate"]
    assert table.loc["gain", "std_error"] == PLAIN.std_error_coloured["gain"]
    again = pickle.loads(pickle.dumps(PLAIN))
    assert again.theta == PLAIN.theta
    assert again.status == "converged"
    np.testing.assert_array_equal(again.states[0], PLAIN.states[0])
