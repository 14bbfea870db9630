"""The names that scripts import from `brv_hypo`, whatever was imported before."""

from __future__ import annotations

import doctest
import inspect
import logging
import re
import subprocess
import sys
from importlib import import_module
from types import SimpleNamespace

import pytest
from rich.progress import Progress

import brv_hypo
from brv_hypo import errors
from brv_hypo.comparison import CompareConfig
from brv_hypo.errors import UsageError
from brv_hypo.motion import ReconstructionConfig
from brv_hypo.simulation import SimulationConfig
from brv_hypo.study import StudyConfig
from brv_hypo.tracing import TraceConfig

NAMES = ("load_flight", "reconstruct", "compare", "simulate")
SETTINGS = {"compare": CompareConfig, "trace": TraceConfig, "reconstruct": ReconstructionConfig}
SETTINGS |= {"predict": TraceConfig, "simulate": SimulationConfig, "run_study": StudyConfig}
EXAMPLES = ("brv_hypo.progress", "brv_hypo.flight.format", "brv_hypo.simulation.simulator")
EXAMPLES += ("brv_hypo.model.reconstruction", "brv_hypo.results", "brv_hypo.flight.record")
EXAMPLES += ("brv_hypo.subset.best", "brv_hypo.likelihood.fit")
THOROUGH_EXAMPLES = ("brv_hypo.comparison.compare",)
SLOW_EXAMPLES = ("brv_hypo.tracing.trace", "brv_hypo.prediction.predict", "brv_hypo.study.run")
QUICK = {"mechanisms": ["lag"], "maximum_likelihood": "none", "knot_count": 2, "refine": False}


def run(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    "before",
    [
        "import brv_hypo.simulation",
        "pass",
        pytest.param("from brv_hypo.simulation import config_path", marks=pytest.mark.slow),
    ],
)
@pytest.mark.thorough
def test_the_public_names_are_functions(before):
    check = f"from brv_hypo import {', '.join(NAMES)}; print(all(map(callable, ({', '.join(NAMES)}))))"
    done = run(f"{before}; {check}; import brv_hypo; print(callable(brv_hypo.simulate))")
    assert done.stdout.split() == ["True", "True"], done.stderr


def test_the_package_costs_nothing_to_import():
    done = run("import sys, brv_hypo; print({'numpy', 'pydantic', 'scipy'} & set(sys.modules))")
    assert done.stdout.strip() == "set()", done.stderr


def test_every_name_is_a_function_here():
    assert all(callable(getattr(brv_hypo, name)) for name in NAMES)


def test_parts_of_the_package_are_found():
    assert brv_hypo.mechanisms.use_plugin_files
    assert issubclass(brv_hypo.errors.UsageError, ValueError)


def test_an_unknown_name_is_refused():
    with pytest.raises(AttributeError, match="has no attribute 'nonsense'"):
        _ = brv_hypo.nonsense


def test_the_map_in_the_docstring_names_every_public_function():
    assert all(f"\n{name}(" in brv_hypo.__doc__ for name in brv_hypo.__all__)
    functions, _, places = brv_hypo.__doc__.strip().partition("\n\nWhere things are")
    assert len(functions.splitlines()) <= 12
    assert len(places.splitlines()) <= 4


@pytest.mark.parametrize(("name", "model"), SETTINGS.items())
def test_every_setting_is_a_keyword_with_its_meaning(name, model):
    function, fields = getattr(brv_hypo, name), model.model_fields.keys()
    given = inspect.get_annotations(function)["settings"].removeprefix("Unpack[").removesuffix("]")
    assert vars(import_module(model.__module__))[given].__annotations__.keys() == fields
    assert fields <= inspect.signature(function).parameters.keys()
    for heading in ("Parameters", "Returns", "Other Parameters", "Raises", *fields):
        assert re.search(rf"^{heading}(?: : .+)?\n(-+|    .+)$", function.__doc__, re.MULTILINE)


def test_keywords_go_over_the_settings(flight_file):
    for config in (None, {"method": "joint"}, ReconstructionConfig(gyro_sigma=1e-4)):
        assert brv_hypo.reconstruct(flight_file, config, method="rates").method == "rates"
    assert brv_hypo.load_flight(flight_file, instruments="laboratory").instruments.grade == "laboratory"


@pytest.mark.parametrize(
    "module",
    [
        *EXAMPLES,
        *(pytest.param(module, marks=pytest.mark.thorough) for module in THOROUGH_EXAMPLES),
        *(pytest.param(module, marks=pytest.mark.slow) for module in SLOW_EXAMPLES),
    ],
)
def test_examples_of_docstrings_run(module, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = doctest.testmod(import_module(module))
    assert done.attempted > done.failed == 0


@pytest.mark.parametrize(
    ("call", "expected", "code"),
    [
        (lambda flight: brv_hypo.load_flight("nowhere.h5"), FileNotFoundError, 3),
        (lambda flight: brv_hypo.load_flight(__file__), ValueError, 3),
        (lambda flight: brv_hypo.reconstruct(flight, "nowhere.yaml"), FileNotFoundError, 2),
        (lambda flight: brv_hypo.reconstruct(flight, methode="rates"), ValueError, 2),
        (lambda flight: brv_hypo.compare(flight, mechanisms=["lagg"]), ValueError, 2),
        (lambda flight: flight.save(flight.path), FileExistsError, 2),
        (lambda flight: flight.save("flight.csv"), ValueError, 2),
        (lambda flight: brv_hypo.compare(flight.window(0.0, 0.3), **QUICK), ValueError, 1),
    ],
)
def test_errors_are_what_python_code_catches(flight_file, call, expected, code):
    with pytest.raises(expected) as caught:
        call(brv_hypo.load_flight(flight_file))
    assert isinstance(caught.value, errors.BrvHypoError)
    assert caught.value.exit_code == code


@pytest.mark.thorough
def test_one_form_of_progress_serves_callables_rich_tqdm_and_the_log(nominal_file, caplog):
    calls, texts, rich = [], [], Progress(disable=True)
    tqdm = SimpleNamespace(total=None, n=0.0, set_description_str=texts.append)
    result = brv_hypo.compare(nominal_file, **QUICK, progress=lambda *given: calls.append(given))
    fractions = [fraction for fraction, _ in calls]
    assert 0.0 <= fractions[0] < 0.1 < 0.7 < fractions[-2] < fractions[-1] == 1.0
    assert fractions == sorted(fractions)
    with caplog.at_level(logging.INFO, "brv_hypo"):
        for progress in (lambda *given: calls.append(given), tqdm, rich):
            brv_hypo.simulate("research_cone", seed=1, duration=1.0, progress=progress)
    assert {text for _, text in calls} >= {*texts} == {"simulating"}
    assert tqdm.n == rich.tasks[0].completed == calls[-1][0] > 0.6
    assert len(caplog.records) == 3 * len(texts)
    assert not [name for name in dir(result) if name.startswith("model")]


def test_a_progress_that_is_none_is_refused_in_words():
    with pytest.raises(UsageError, match="got progress of type int, expected a function"):
        brv_hypo.simulate("research_cone", seed=1, duration=1.0, progress=3)


def test_a_flight_saves_and_plots_itself(flight_file, tmp_path):
    flight = brv_hypo.load_flight(flight_file)
    flight.save(tmp_path / "again.h5")
    assert brv_hypo.load_flight(tmp_path / "again.h5").samples == flight.samples
    assert len(flight.plot("rates").axes) == 3
