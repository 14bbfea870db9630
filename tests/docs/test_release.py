"""What goes out: README, picture, wheel and sdist contain what they should."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from importlib.metadata import version
from pathlib import Path

import pytest
import yaml

from brv_hypo.docs import notebooks, topics

pytestmark = pytest.mark.thorough

ROOT = Path(__file__).resolve().parents[2]
PAGE_FILES = (
    *("page.html.j2", "table.html.j2", "manual.html.j2", "book.html.j2"),
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


def test_the_citation_is_of_this_version() -> None:
    cited = yaml.safe_load((ROOT / ".github" / "CITATION.cff").read_text())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert cited["version"] == project["version"]
    assert [author["name"] for author in cited["authors"]] == [author["name"] for author in project["authors"]]
    assert cited["references"][0]["number"] in (ROOT / "brv_hypo" / "docs" / "citation.md").read_text()


def test_the_picture_is_of_the_demo_and_needs_no_network() -> None:
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


def test_the_wheel_has_manual_pages_configurations_and_plugins(built) -> None:
    (wheel,) = built.glob("*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    expected = {f"brv_hypo/docs/{topic}.md" for topic in topics()} | {f"brv_hypo/report/page/{f}" for f in PAGE_FILES}
    expected |= {"brv_hypo/configs/demo.yaml", "brv_hypo/importing/map.yaml.j2"}
    expected |= {"brv_hypo_mechanisms/lag.py", "brv_hypo_effects/moments.py"}
    expected |= {"brv_hypo_effects/processes.py", "brv_hypo_effects/record.py"}
    assert expected - names == set()
    assert not any(name.startswith("tests/") for name in names)


@pytest.fixture(scope="module", params=["*.whl", "*.tar.gz"], ids=["wheel", "sdist"])
def installed(request, built, tmp_path_factory):
    """A command of the package, as the wheel or the sdist installs it in a fresh environment, run far from the tree.

    Dependencies are those of this environment, by path: nothing is downloaded, and no editable install is used.
    """
    home = tmp_path_factory.mktemp("fresh")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", home / "venv"], check=True)
    python = home / "venv" / "bin" / "python"
    where = [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]
    own = Path(subprocess.run(where, check=True, capture_output=True, text=True).stdout.strip())
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
    assert (installed.place / "brv_hypo" / "docs" / "notebooks" / "own_csv.ipynb").is_file()
    assert (installed.place / "brv_hypo_mechanisms" / "lag.py").is_file()
    assert (installed.place / "brv_hypo_effects" / "processes.py").is_file()
    assert installed("--version").stdout.split()[-1] == version("brv-hypo")


@pytest.mark.parametrize("installed", ["*.whl"], ids=["wheel"], indirect=True)
def test_what_is_installed_flies_and_inspects_with_its_plugins(installed) -> None:
    known = installed("mechanisms")
    assert all(name in known.stdout for name in ("sticking", "magnus", "gyro_bias", "body_change", "turbulence"))
    assert installed("config", "new", "import").returncode == 0
    flown = installed("simulate", "research_cone", "--plant", "lag", "-o", "flight.h5")
    assert flown.returncode == 0, flown.stderr
    assert "usable" in installed("inspect", "flight.h5").stdout


VERSIONS = tuple(f"3.{minor}" for minor in (14, 13, 12, 11))
"""Of Python, the newest first, of which one beside this one is looked for."""
NOT_TO_BE_HAD = (
    *("NewConnectionError", "NameResolutionError", "ProxyError", "ReadTimeoutError", "Network is unreachable"),
    *("ConnectTimeoutError", "No matching distribution found"),
)
"""What pip says where it reaches no index, or one without packages for that Python."""
IMPATIENT = {"PIP_RETRIES": "1", "PIP_DEFAULT_TIMEOUT": "20"}
LONGEST = 500.0
"""Seconds that pip may take, several times what it needs."""


def another_python() -> Path | None:
    """An interpreter of another version than this one: of the command `python3.x`, or one that pyenv installed."""
    own = f"{sys.version_info.major}.{sys.version_info.minor}"
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    for name in VERSIONS:
        on_path = shutil.which(f"python{name}")
        found = [*([Path(on_path)] if on_path else []), *sorted(pyenv.glob(f"{name}.*/bin/python"))]
        for python in found if name != own else ():
            # The command may be a shim of pyenv, which knows a version that is not chosen.
            answer = subprocess.run([python, "-m", "venv", "-h"], capture_output=True, check=False)
            if answer.returncode == 0:
                return python
    return None


@pytest.fixture(scope="module")
def other(built, tmp_path_factory):
    """A command in a fresh environment of another Python, where the wheel is installed with all that it requires."""
    python = another_python()
    if python is None:
        pytest.skip(f"no Python is installed beside {sys.version.split()[0]}: looked for {', '.join(VERSIONS)}")
    home = tmp_path_factory.mktemp("other")
    subprocess.run([python, "-m", "venv", home / "venv"], check=True)
    clean = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "PYTHONHOME")} | IMPATIENT

    def run(program: str, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
        command = [home / "venv" / "bin" / program, *arguments]
        return subprocess.run(
            command, cwd=home, env=clean, capture_output=True, text=True, check=False, timeout=LONGEST
        )

    (wheel,) = built.glob("*.whl")
    try:
        done = run("pip", "install", "-q", wheel, "hatchling")
    except subprocess.TimeoutExpired:
        pytest.skip(f"pip has no packages for {python} within {LONGEST:.0f} s")
    if done.returncode != 0 and any(sign in done.stderr for sign in NOT_TO_BE_HAD):
        pytest.skip(f"pip has no packages for {python}: {done.stderr.strip().splitlines()[-1]}")
    assert done.returncode == 0, done.stderr
    return run


@pytest.mark.slow
def test_another_python_installs_the_wheel_and_uses_it(other) -> None:
    """As a new user would, with the newest of everything that the wheel requires: demo, manual, plugins."""
    assert other("python", "--version").stdout.split()[1].split(".")[:2] != [str(n) for n in sys.version_info[:2]]
    shown = other("brv-hypo", "demo")
    assert "Verdict: sticking" in shown.stdout, shown.stderr
    assert "What data fit" in other("brv-hypo", "docs", "start").stdout
    known = other("brv-hypo", "mechanisms").stdout
    assert all(name in known for name in ("sticking", "magnus", "gyro_bias", "body_change", "turbulence"))


@pytest.mark.slow
def test_another_python_builds_and_installs_the_sdist(other, built) -> None:
    (sdist,) = built.glob("*.tar.gz")
    install = ("install", "-q", "--no-deps", "--no-index", "--no-build-isolation", "--force-reinstall")
    done = other("pip", *install, sdist)
    assert done.returncode == 0, done.stderr
    assert other("brv-hypo", "--version").stdout.split()[-1] == version("brv-hypo")
    assert other("brv-hypo", "docs", "--notebooks", "books").returncode == 0


def test_the_sdist_has_what_the_wheel_is_built_from(built) -> None:
    (sdist,) = built.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    expected = {"pyproject.toml", "README.md", "configs/demo.yaml", "plugins/brv_hypo_effects/moments.py"}
    expected |= {f"brv_hypo/docs/notebooks/{name}" for name in notebooks()}
    assert expected - names == set()
