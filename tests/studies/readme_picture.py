"""The README's picture of `brv-hypo demo`: run `python -m tests.studies.readme_picture FILE.svg`."""

from __future__ import annotations

import io
import re
import sys
from pathlib import Path

from rich.console import Console, RenderableType

from brv_hypo.comparison import compare
from brv_hypo.report.comparison import comparison_document
from brv_hypo.report.listings import simulation_blocks
from brv_hypo.report.terminal import blocks_view, terminal_view
from brv_hypo.simulation import simulate

WIDTH = 88
SEED = 1


def terminal_picture(*printed: RenderableType, title: str, width: int = WIDTH) -> str:
    """What a terminal would show, as SVG that loads no font from the network."""
    console = Console(record=True, width=width, file=io.StringIO(), highlight=False, markup=False, force_terminal=True)
    for part in printed:
        console.print(part)
    svg = console.export_svg(title=title)
    return re.sub(r"@font-face\s*\{.*?\}\s*", "", svg, flags=re.DOTALL)


def demo_picture() -> str:
    """The demo, simulated and compared afresh."""
    flown = simulate("demo", seed=SEED)
    comparison = compare([flown.flight])
    view = terminal_view(comparison_document(comparison))
    return terminal_picture(blocks_view(simulation_blocks(flown), False), "", view, title="brv-hypo demo")


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(demo_picture(), encoding="utf-8")
