"""Results as a reader has them: what functions take, short repr, HTML, data frames, pickle and JSON."""

from __future__ import annotations

import copy
import json
import math
import pickle
from dataclasses import replace
from html import escape

import numpy as np
import pytest

import brv_hypo
from brv_hypo.comparison import CompareConfig, Comparison
from brv_hypo.errors import UsageError
from brv_hypo.flight import flights_of, one_flight
from brv_hypo.json_result import NullIsNaN, Result
from brv_hypo.likelihood import Segment, fit
from brv_hypo.report.write import document_of, write_figures, write_report
from brv_hypo.simulation import SimulatedFlight
from brv_hypo.subset import best_subsets
from brv_hypo.tracing import Trace
from tests.chains import compared_nominal, traced_trim, trimmed
from tests.flights import flown as planted

LONGEST = 200
"""Characters of a short repr."""


@pytest.fixture(scope="module")
def flown() -> SimulatedFlight:
    return trimmed()


@pytest.fixture(scope="module")
def record(flown, tmp_path_factory):
    path = tmp_path_factory.mktemp("record") / "flight.h5"
    flown.save(path)
    return path


@pytest.fixture(scope="module")
def compared() -> Comparison:
    return compared_nominal()


@pytest.fixture(scope="module")
def traced() -> Trace:
    return traced_trim()


@pytest.fixture(scope="module")
def reconstructed(record):
    return brv_hypo.reconstruct(str(record))


@pytest.fixture(scope="module")
def fitted():
    t = np.arange(0.0, 2.0, 0.02)
    y = np.exp(-t)[None, :] + 1e-3 * np.random.default_rng(1).standard_normal((1, t.size))
    segment = Segment(t=t, u=np.zeros((1, t.size)), y=y, x0=np.array([1.0]))
    return fit(lambda x, u, theta, t: -theta["k"] * x, lambda x, u, theta, t: x, [segment], {"k": 0.8})


@pytest.fixture(scope="module")
def selected():
    X = np.random.default_rng(1).standard_normal((40, 5))
    return best_subsets(X, X[:, 1] - X[:, 3], max_terms=3)


RESULTS = ("flown", "compared", "traced", "reconstructed", "fitted", "selected")


class TestWhatFunctionsTake:
    def test_path_flight_simulation_and_sequences_are_the_same(self, flown, record) -> None:
        assert one_flight(flown) is flown.flight
        assert one_flight(flown.flight) is flown.flight
        np.testing.assert_array_equal(one_flight(str(record)).q, one_flight(record).q)
        assert [flight.samples for flight in flights_of([record, flown, flown.flight])] == [601, 601, 601]
        assert len(flights_of(record)) == 1

    @pytest.mark.parametrize("wrong", [3, None, {"q": 1}, [[1.0, 2.0]]])
    def test_anything_else_is_refused(self, wrong) -> None:
        with pytest.raises(UsageError, match="expected"):
            flights_of(wrong)

    def test_no_flight_is_refused(self) -> None:
        with pytest.raises(UsageError, match="no flight"):
            brv_hypo.compare([])


@pytest.mark.parametrize("name", RESULTS)
class TestEveryResult:
    def test_its_repr_is_short(self, name, request) -> None:
        result = request.getfixturevalue(name)
        assert repr(result).startswith(f"<{type(result).__name__}: ")
        assert len(repr(result)) < LONGEST

    def test_it_has_an_html_view_and_a_data_frame(self, name, request) -> None:
        result = request.getfixturevalue(name)
        frame = result.to_dataframe()
        assert len(frame) > 0
        html = result._repr_html_()
        assert escape(result.conclusion()) in html
        assert len(html) < 20_000
        assert all(str(column) in html for column in frame.columns)

    def test_it_survives_pickle_and_copy(self, name, request) -> None:
        result = request.getfixturevalue(name)
        for again in (pickle.loads(pickle.dumps(result)), copy.deepcopy(result)):
            assert repr(again) == repr(result)
            assert again == result
            assert again.to_dataframe().equals(result.to_dataframe())


class TestJson:
    @pytest.mark.parametrize("name", ["compared", "traced"])
    def test_a_result_comes_back_from_its_json(self, name, request, tmp_path) -> None:
        result = request.getfixturevalue(name)
        text = result.to_json()
        json.loads(text, parse_constant=lambda constant: pytest.fail(constant))
        again = type(result).from_json(text)
        assert again == result
        assert hash(again) == hash(result)
        assert again.to_json() == text
        (tmp_path / "result.json").write_text(text)
        assert type(result).from_json(tmp_path / "result.json").to_json() == text

    def test_another_result_is_not_equal(self, compared, traced, flown) -> None:
        assert compared != traced
        assert compared != compared.model_copy(update={"ranking": compared.ranking[:1]})
        assert compared.verdict != compared.verdict.model_copy(update={"stability": 0.123})
        assert flown.flight != replace(flown.flight, q=np.nextafter(flown.flight.q, 1.0))

    def test_it_is_the_json_of_the_command_line(self, compared) -> None:
        from brv_hypo.cli.session import as_json

        assert json.loads(as_json(compared)) == json.loads(compared.to_json())

    def test_null_is_read_as_not_a_number(self) -> None:
        class Part(NullIsNaN):
            value: float
            several: dict[str, float]
            perhaps: float | None = 1.0

        part = Part.model_validate({"value": None, "several": {"a": None, "b": 2.0}, "perhaps": None})
        assert math.isnan(part.value)
        assert math.isnan(part.several["a"])
        assert part.several["b"] == 2.0
        assert part.perhaps is None

    @pytest.mark.parametrize("text", ["{}", '{"schema": 3}'])
    def test_what_is_no_result_is_refused(self, text) -> None:
        with pytest.raises(UsageError, match="not the JSON of a Comparison"):
            Comparison.from_json(text)

    def test_a_missing_file_is_refused(self, tmp_path) -> None:
        with pytest.raises(UsageError, match="cannot be read"):
            Comparison.from_json(tmp_path / "nowhere.json")


def test_a_pickled_motion_still_gives_its_past(reconstructed) -> None:
    again = pickle.loads(pickle.dumps(reconstructed)).motion
    earlier = again.delayed(0.05).delayed(0.05)
    np.testing.assert_allclose(earlier.alpha, reconstructed.motion.delayed(0.1).alpha, rtol=1e-12)


def test_without_pandas_a_data_frame_says_how_to_install_it(compared, monkeypatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(UsageError, match=r"pip install -e '.\[tables\]'"):
        compared.to_dataframe()


@pytest.mark.parametrize("name", ["compared", "traced", "reconstructed", "flown"])
def test_a_result_is_written_as_a_page(name, request, tmp_path) -> None:
    result = request.getfixturevalue(name)
    write_report(result, tmp_path / "page.html")
    html = (tmp_path / "page.html").read_text()
    assert document_of(result).title in html
    assert len(html) < 1_500_000
    with pytest.raises(UsageError, match="exists"):
        write_report(result, tmp_path / "page.html")


@pytest.mark.thorough
def test_the_figures_of_a_result_are_written(traced, tmp_path) -> None:
    names = {path.name for path in write_figures(traced, tmp_path / "figures")}
    assert {"residuals.png", "residuals.svg", "spectrum.svg"} <= names


class TestPlot:
    """The charts of a result as figures, by the names of its picture files."""

    @pytest.mark.parametrize(("name", "panels"), [("compared", 2), ("traced", 2), ("reconstructed", 2)])
    def test_the_principal_chart_is_drawn_where_none_is_named(self, name, panels, request) -> None:
        figure = request.getfixturevalue(name).plot()
        assert len(figure.axes) == panels
        assert figure._repr_png_().startswith(b"\x89PNG")

    @pytest.mark.thorough
    def test_every_chart_of_the_page_is_there_by_name(self, compared) -> None:
        for chart in document_of(compared).charts:
            assert len(compared.plot(chart.name).axes) == len(chart.panels)

    @pytest.mark.thorough
    def test_the_winner_lies_on_top(self) -> None:
        flight = planted("research_cone", "bodyfixed").flight
        won = brv_hypo.compare(flight, CompareConfig(mechanisms=("bodyfixed",), maximum_likelihood="none"))
        labels = [line.get_label() for line in won.plot("moments").axes[0].get_lines()]
        assert [label for label in labels if label in ("baseline only", "bodyfixed")] == ["baseline only", "bodyfixed"]

    def test_an_unknown_chart_is_refused_with_those_there_are(self, compared) -> None:
        with pytest.raises(UsageError, match=r"got chart 'momenst', expected one .* moments, .*residuals.*[a-z]\.$"):
            compared.plot("momenst")

    def test_a_result_from_json_has_no_histories_to_draw(self, traced) -> None:
        with pytest.raises(UsageError, match="no part of its JSON: call compare or trace again, or keep"):
            Trace.from_json(traced.to_json()).plot("moments")

    def test_a_comparison_from_json_draws_the_charts_of_what_it_has(self, compared) -> None:
        again = Comparison.from_json(compared.to_json())
        (axes,) = again.plot().axes
        assert axes.get_xlabel() == "probability, %"
        charts = "evidence, probability, limits, cp, errors, static-offset, static-slope, damping, coefficients-damping"
        with pytest.raises(UsageError, match=rf"has: {charts}\. The others .* no part of its JSON"):
            again.plot("moments")

    def test_without_matplotlib_it_says_how_to_install_it(self, compared, monkeypatch) -> None:
        from brv_hypo.report import write

        monkeypatch.setattr(write, "find_spec", lambda name: None)
        with pytest.raises(UsageError, match=r"plot\(\) needs matplotlib.*'.\[figures\]'"):
            compared.plot()


def test_rows_of_a_trace_have_the_same_columns_where_nothing_was_added(traced) -> None:
    last = traced.steps[-1].model_copy(update={"added": None, "error_after": None})
    rows = traced.model_copy(update={"steps": (*traced.steps, last)}).rows()
    assert len({tuple(row) for row in rows}) == 1
    assert rows[-1]["fit_after"] is None


class TestXarray:
    @pytest.mark.parametrize("name", RESULTS)
    def test_a_data_set_has_the_columns_of_the_data_frame(self, name, request) -> None:
        pytest.importorskip("xarray")
        result = request.getfixturevalue(name)
        data, frame = result.to_xarray(), result.to_dataframe()
        assert set(frame.columns) <= set(data.variables)
        assert {str(frame[key].dtype) for key in frame.columns.intersection(["rank", "n_terms"])} <= {"Int64"}
        assert not any(str(data[key].dtype) == "Int64" for key in data.variables)
        assert data.attrs["title"] == result.headline()
        assert set(data.sizes.values()) == {len(frame)}

    def test_histories_lie_over_time_with_their_units(self, reconstructed, flown) -> None:
        pytest.importorskip("xarray")
        data = reconstructed.to_xarray()
        assert data["alpha"].dims == ("time",)
        assert {name: data[name].attrs["units"] for name in ("time", "alpha", "C_N_prime")} == {
            "time": "s",
            "alpha": "rad",
            "C_N_prime": "1",
        }
        assert flown.to_xarray()["velocity"].attrs["units"] == "m/s"
        np.testing.assert_array_equal(data["time"], reconstructed.motion.time)

    def test_without_xarray_it_says_how_to_install_it(self, compared, monkeypatch) -> None:
        import sys

        monkeypatch.setitem(sys.modules, "xarray", None)
        with pytest.raises(UsageError, match=r"pip install -e '.\[xarray\]'"):
            compared.to_xarray()


def test_what_has_no_report_is_refused(tmp_path) -> None:
    with pytest.raises(UsageError, match="only these"):
        write_report("a comparison", tmp_path / "page.html")


def test_the_version_is_known() -> None:
    assert brv_hypo.__version__[0].isdigit()
    assert issubclass(Comparison, Result)
