"""The hosted manual is built without a warning, and loads nothing from the network (extra `manual`)."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from brv_hypo.docs import notebooks, topics

for needed in ("sphinx", "myst_nb", "furo"):
    pytest.importorskip(needed)
pytestmark = pytest.mark.thorough

SOURCE = Path(__file__).parents[2] / ".github" / "manual"


def test_every_page_is_built_without_a_warning(tmp_path) -> None:
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-d", tmp_path / "trees", SOURCE]
    done = subprocess.run([*command, tmp_path / "site"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    pages = {path.stem: path.read_text(encoding="utf-8") for path in (tmp_path / "site").rglob("*.html")}
    books = {name.removesuffix(".ipynb") for name in notebooks()}
    assert pages.keys() >= {*topics(), *books, "index", "functions", "search"}
    assert not [name for name, page in pages.items() if re.search(r'<(?:script|link|img)[^>]*"https?:', page)]
    assert 'id="brv_hypo.compare"' in pages["functions"]
