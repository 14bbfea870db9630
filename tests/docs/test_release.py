"""What goes out: README, picture, wheel and sdist hold what they should."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tarfile
import zipfile
from importlib.metadata import version
from pathlib import Path

import pytest

from brv_hypo.docs import notebooks, topics

pytestmark = pytest.mark.thorough

ROOT = Path(__file__).resolve().parents[2]
PAGE_FILES = (
    *("page.css", "page.js", "stretches.js", "manual.css", "manual.js"),
    *("plotly-basic.min.js.gz", "plotly-basic.LICENSE"),
)


@pytest.fixture(scope="module")
def readme() -> str:
    return (ROOT / "README.md").read_text()


def test_the_readme_is_short_and_says_at_once_what_fits(readme) -> None:
    lines = readme.splitlines()
    assert len(lines) <= 80
    beginning = "\n".join(lines[:25])
    for expected in ("gyros", "accelerometers", "dynamic pressure", "samples or more a cycle", "bodies of revolution"):
        assert expected in beginning
    assert "licence is the owner's choice" in readme


def test_what_the_readme_links_is_there(readme) -> None:
    links = re.findall(r"\]\(([^)]+)\)", readme)
    assert [link for link in links if not (ROOT / link).is_file()] == []
    assert all(f"brv_hypo/docs/{topic}.md" in links for topic in topics())


def test_the_picture_is_of_the_demo_and_asks_the_network_for_nothing() -> None:
    picture = (ROOT / ".github" / "demo.svg").read_text()
    assert "Verdict" in picture
    assert "sticking" in picture
    assert not re.findall(r"(?:url\(|href=|src=)[\"']?https?:", picture)


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "hatchling", "build", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    return folder


def test_the_wheel_holds_manual_pages_configurations_and_plugins(built) -> None:
    (wheel,) = built.glob("*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    expected = {f"brv_hypo/docs/{topic}.md" for topic in topics()} | {f"brv_hypo/report/page/{f}" for f in PAGE_FILES}
    expected |= {"brv_hypo/configs/demo.yaml", "brv_hypo_mechanisms/lag.py", "brv_hypo_effects/magnus.py"}
    assert expected - names == set()
    assert not any(name.startswith("tests/") for name in names)


@pytest.fixture(scope="module", params=["*.whl", "*.tar.gz"], ids=["wheel", "sdist"])
def installed(request, built, tmp_path_factory):
    """A command of the package, as the wheel or the sdist installs it in a fresh environment, run far from the tree.

    Dependencies are those of this environment, by path: nothing is downloaded, and no editable install is seen.
    """
    home = tmp_path_factory.mktemp("fresh")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", home / "venv"], check=True)
    python = home / "venv" / "bin" / "python"
    ask = [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]
    own = Path(subprocess.run(ask, check=True, capture_output=True, text=True).stdout.strip())
    (own / "dependencies.pth").write_text("\n".join(p for p in sys.path if p.endswith("site-packages")))
    (package,) = built.glob(request.param)
    install = ["install", "--no-deps", "--no-build-isolation", "--no-index", "--force-reinstall", "-q", package]
    clean = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "PYTHONHOME")}
    subprocess.run([sys.executable, "-m", "pip", "--python", python, *install], check=True, env=clean)

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [python.with_name("brv-hypo"), *arguments]
        return subprocess.run(command, cwd=home, env=clean, capture_output=True, text=True)

    run.place = own
    return run


def test_what_is_installed_runs_from_its_own_files(installed) -> None:
    place = installed("docs", "--notebooks", "books")
    assert place.returncode == 0, place.stderr
    assert (installed.place / "brv_hypo" / "docs" / "notebooks" / "loop.ipynb").is_file()
    assert (installed.place / "brv_hypo_mechanisms" / "lag.py").is_file()
    assert installed("--version").stdout.split()[-1] == version("brv-hypo")


@pytest.mark.parametrize("installed", ["*.whl"], ids=["wheel"], indirect=True)
def test_what_is_installed_flies_and_inspects_with_its_plugins(installed) -> None:
    known = installed("mechanisms")
    assert all(name in known.stdout for name in ("sticking", "magnus", "gyro_bias"))
    assert installed("config", "new", "import").returncode == 0
    flown = installed("simulate", "research_cone", "--plant", "lag", "-o", "flight.h5")
    assert flown.returncode == 0, flown.stderr
    assert "usable" in installed("inspect", "flight.h5").stdout


def test_the_sdist_holds_what_the_wheel_is_built_from(built) -> None:
    (sdist,) = built.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    expected = {"pyproject.toml", "README.md", "configs/demo.yaml", "plugins/brv_hypo_effects/magnus.py"}
    expected |= {f"brv_hypo/docs/notebooks/{name}" for name in notebooks()}
    assert expected - names == set()
