"""What goes out: README, picture, wheel and sdist hold what they should."""

from __future__ import annotations

import re
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from brv_hypo.docs import topics

ROOT = Path(__file__).resolve().parents[2]
PAGE_FILES = ("page.css", "page.js", "manual.css", "manual.js", "plotly-basic.min.js.gz", "plotly-basic.LICENSE")


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


def test_the_sdist_holds_what_the_wheel_is_built_from(built) -> None:
    (sdist,) = built.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"pyproject.toml", "README.md", "configs/demo.yaml", "plugins/brv_hypo_effects/magnus.py"} - names == set()
