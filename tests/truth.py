"""What was planted in a simulated flight, from its file: for tests alone, nothing that analyses a flight may see it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from brv_hypo.io.binary import Tree, read_tree


def load_truth(path: str | Path) -> dict[str, Any]:
    """The group `truth`, as nested dicts of arrays, numbers and text; {} without any."""
    truth = read_tree(path, only={"truth": None}).groups.get("truth")
    return {} if truth is None else _plain(truth)


def _plain(tree: Tree) -> dict[str, Any]:
    values = {name: dataset.values[()] for name, dataset in tree.datasets.items()}
    return {**tree.attributes, **values, **{name: _plain(below) for name, below in tree.groups.items()}}
