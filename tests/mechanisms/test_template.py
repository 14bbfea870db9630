"""The plugin that `brv-hypo mechanisms new` writes installs, is found and passes its own tests."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from brv_hypo.cli.main import write_plugin
from brv_hypo.errors import UsageError


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """The plugin package as written, and an environment in which it is installed."""
    parent = tmp_path_factory.mktemp("plugin")
    package = write_plugin("uneven_ablation", parent)
    site = parent / "site"
    pip = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([*pip, "--target", str(site), str(package)], check=True, capture_output=True, text=True)
    paths = os.pathsep.join([str(site), *(path for path in sys.path if path)])
    return package, {**os.environ, "PYTHONPATH": paths}


def run(environment, *arguments):
    package, variables = environment
    return subprocess.run(
        [sys.executable, "-m", *arguments], cwd=package, env=variables, capture_output=True, text=True, check=False
    )


@pytest.mark.thorough
def test_the_installed_plugin_passes_the_conformance_kit(environment):
    done = run(environment, "brv_hypo", "mechanisms", "check", "uneven_ablation")
    assert done.returncode == 0, done.stderr
    assert "passes 17 of 17 checks" in done.stdout


@pytest.mark.thorough
def test_the_plugin_is_listed_with_its_package_and_version(environment):
    done = run(environment, "brv_hypo", "mechanisms", "--json", "-")
    assert '"package": "brv-hypo-uneven-ablation"' in done.stdout
    assert '"name": "sticking"' in done.stdout


@pytest.mark.slow
def test_the_tests_that_come_with_it_pass(environment):
    done = run(environment, "pytest", "-q", "-p", "no:cacheprovider")
    assert done.returncode == 0, done.stdout
    assert "20 passed" in done.stdout


def test_nothing_but_the_package_is_written(tmp_path):
    package = write_plugin("magnus2", tmp_path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["brv-hypo-magnus2"]
    written = sorted(str(file.relative_to(package)) for file in package.rglob("*") if file.is_file())
    assert written == ["README.md", "brv_hypo_magnus2.py", "pyproject.toml", "tests/test_brv_hypo_magnus2.py"]
    assert not any("$" in file.read_text() for file in package.rglob("*") if file.is_file())


@pytest.mark.parametrize("name", ["none", "Lag", "2lag", "a-b", "a+b", "lambda", "", "../up"])
def test_a_name_that_cannot_be_one_is_refused(name, tmp_path):
    with pytest.raises(UsageError, match="cannot name a mechanism"):
        write_plugin(name, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_an_existing_package_is_not_changed(tmp_path):
    package = write_plugin("mine", tmp_path)
    (package / "README.md").write_text("my notes")
    with pytest.raises(UsageError, match="exists already"):
        write_plugin("mine", tmp_path)
    assert (package / "README.md").read_text() == "my notes"


def test_a_missing_parent_is_made(tmp_path):
    assert write_plugin("mine", tmp_path / "of" / "mine").is_dir()
    (tmp_path / "file").write_text("no directory")
    with pytest.raises(UsageError, match="cannot be written"):
        write_plugin("mine", tmp_path / "file" / "below")


def test_a_process_is_written_that_keeps_the_contract(tmp_path):
    package = write_plugin("five_lobes", tmp_path, "process")
    environment = package, {**os.environ, "PYTHONPATH": os.pathsep.join([str(package), *filter(None, sys.path)])}
    plugin = "brv_hypo_five_lobes.py"
    assert "class FiveLobes(MomentProcess)" in (package / plugin).read_text()
    done = run(environment, "brv_hypo", "mechanisms", "check", "five_lobes", "--plugin", plugin)
    assert "passes 20 of 20 checks" in done.stdout, done.stderr


def test_an_effect_is_written_with_tests_of_its_own(tmp_path):
    package = write_plugin("gyro_trend", tmp_path, "effect")
    written = sorted(str(file.relative_to(package)) for file in package.rglob("*") if file.is_file())
    assert written == ["README.md", "brv_hypo_gyro_trend.py", "pyproject.toml", "tests/test_brv_hypo_gyro_trend.py"]
    assert not any("$" in file.read_text() for file in package.rglob("*") if file.is_file())
    assert "class GyroTrend(RecordEffect)" in (package / "brv_hypo_gyro_trend.py").read_text()


@pytest.mark.slow
def test_the_tests_that_come_with_an_effect_pass(tmp_path):
    package = write_plugin("gyro_trend", tmp_path, "effect")
    site = tmp_path / "site"
    pip = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([*pip, "--target", str(site), str(package)], check=True, capture_output=True, text=True)
    paths = os.pathsep.join([str(site), *(path for path in sys.path if path)])
    done = run((package, {**os.environ, "PYTHONPATH": paths}), "pytest", "-q", "-p", "no:cacheprovider")
    assert done.returncode == 0, done.stdout
    assert "9 passed" in done.stdout
