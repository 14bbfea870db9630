"""Operations on an input file, each fixed by its seed; a mutated input is the seeds of the operations applied."""

from __future__ import annotations

import faulthandler
import json
import os
import random
import resource
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import yaml

NASTY: tuple[Any, ...] = (
    *(None, True, -1, 0, 2**31, 2**63 - 1, -(2**63), 1e300, -1e-300, float("nan"), float("inf")),
    *("", " ", "x" * 5000, "\x1b[2J", "\u202e", "../../etc/passwd", "/dev/zero", "none", "NaN", "1e999"),
    *([], {}, [[]], {"": {}}, [1, 2, 3], {"units": "m"}, ["lag", 7], "9" * 5000, "2001-99-99", "s**9**9**9"),
)
TEXTS = (
    *("&a [*a]", "!!python/object:os.system", "*missing", "[" * 500, "{" * 500, "<<: *a", "'", '"', "\x00", "\x9b"),
    *("9" * 5000, "1e400", ".inf", ".nan", "\t", "- - -", ": : :", "#", "\u2028", "---", "...", "|", ">", "%", "nan"),
)
SIZES = (0, 1, 3, 15, 16, 1 << 20, 1 << 32, 10**12)

Mutation = Callable[[Path, random.Random], None]


def bytes_flipped(path: Path, draw: random.Random) -> None:
    """Some bytes get other values."""
    content = bytearray(path.read_bytes())
    for _ in range(draw.choice((1, 4, 64)) if content else 0):
        content[draw.randrange(len(content))] = draw.choice((0, 1, 0x7F, 0x80, 0xFF, draw.randrange(256)))
    path.write_bytes(content)


def head_damaged(path: Path, draw: random.Random) -> None:
    """A word near the beginning, where formats keep sizes and addresses, gets another value."""
    content = bytearray(path.read_bytes())
    place = draw.randrange(max(1, min(len(content), 4096)))
    content[place : place + 8] = draw.choice((0, 1, 2**31, 2**32 - 1, 2**63, 2**64 - 1)).to_bytes(8, "little")
    path.write_bytes(content)


def cut_short(path: Path, draw: random.Random) -> None:
    """The end is missing."""
    content = path.read_bytes()
    path.write_bytes(content[: draw.randrange(len(content) + 1)])


def part_repeated(path: Path, draw: random.Random) -> None:
    """A part is repeated, or moved."""
    content = path.read_bytes()
    a, b, at = (draw.randrange(len(content) + 1) for _ in range(3))
    path.write_bytes(content[:at] + content[min(a, b) : max(a, b)][:100_000] + content[at:])


def text_inserted(path: Path, draw: random.Random) -> None:
    """Something nasty is put into the text."""
    content = path.read_bytes()
    at = draw.randrange(len(content) + 1)
    path.write_bytes(content[:at] + draw.choice(TEXTS).encode() + content[at + draw.choice((0, 0, 5)) :])


def value_replaced(path: Path, draw: random.Random) -> None:
    """One value of a YAML or JSON tree is another, gone, or under another key."""
    try:
        text = path.read_text(encoding="utf-8")
        tree = json.loads(text) if path.suffix == ".json" else yaml.safe_load(text)
    except Exception:  # an earlier operation broke it
        return
    node, nodes = tree, []
    while isinstance(node, dict | list) and node:
        key = draw.choice(list(node)) if isinstance(node, dict) else draw.randrange(len(node))
        nodes.append((node, key))
        node = node[key]
    if not nodes:
        return
    parent, key = draw.choice(nodes)
    if draw.random() < 0.2:
        parent.pop(key)
    elif isinstance(parent, dict) and draw.random() < 0.2:
        parent[draw.choice(("", "x", "\x1b[2J", "name", "time"))] = parent.pop(key)
    else:
        parent[key] = draw.choice(NASTY)
    path.write_text(json.dumps(tree) if path.suffix == ".json" else yaml.safe_dump(tree), encoding="utf-8")


def record_changed(path: Path, draw: random.Random) -> None:
    """One dataset, attribute or link of an HDF5 record is another."""
    try:
        with h5py.File(path, "r+") as file:
            group = file[draw.choice(("/", "/", "/vehicle", "/instruments"))]
            name = draw.choice([*group, "new", "truth", "vehicle"])
            draw.choice((_attribute, _attribute, _values, _values, _dataset, _dataset, _link, _removed))(
                group, name, draw
            )
    except Exception:  # what cannot be done to this file is not done
        return


def _attribute(group: Any, name: str, draw: random.Random) -> None:
    item = draw.choice((group, group.get(name, group)))
    key = draw.choice(("units", "format", "format_version", "title", "planet", "history", "grade", "x"))
    value = draw.choice(NASTY)
    if isinstance(value, dict | list) or value is None:
        value = draw.choice((np.arange(5.0), h5py.Empty("f8"), np.array(["a", "b"], dtype=h5py.string_dtype())))
    item.attrs[key] = value


def _values(group: Any, name: str, draw: random.Random) -> None:
    values = np.array(np.real(group[name][()]), dtype=float)
    flat = values.reshape(-1)
    a, b = sorted(draw.randrange(flat.size + 1) for _ in range(2))
    b = draw.choice((a + 1, b))
    flat[a:b] = draw.choice((0.0, -1.0, 1e300, -1e300, 1e-300, np.nan, np.inf, -999.0, 1e20, flat[0]))
    group[name][...] = values


def _dataset(group: Any, name: str, draw: random.Random) -> None:
    units = group[name].attrs.get("units", "s") if name in group else "s"
    if name in group:
        del group[name]
    kind = draw.choice(("f8", "f4", "i8", "u1", "S8", "c16", "?", [("a", "f8")], h5py.string_dtype(), ">f8", "V5"))
    size = draw.choice(SIZES)
    shape = draw.choice(((size,), (size, 2), (), (1,), (3,), (400,), (2, 2, 2)))
    made = group.create_dataset(name, shape=shape, dtype=kind, chunks=True if 0 not in shape and shape else None)
    made.attrs["units"] = draw.choice((units, units, "m", "", "\x1b[2J", "s^^s"))


def _link(group: Any, name: str, draw: random.Random) -> None:
    if name in group:
        del group[name]
    group[name] = draw.choice(
        (h5py.SoftLink("/q"), h5py.SoftLink("/nowhere"), h5py.ExternalLink("/dev/zero", "/q"), group.file["/"], group)
    )


def _removed(group: Any, name: str, draw: random.Random) -> None:
    del group[name]


def folded(path: Path, draw: random.Random) -> None:
    """Columns of a table are of another length or order, or hold other text."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    row = draw.randrange(max(len(lines), 1))
    if lines:
        cells = lines[row].split(",")
        cells[draw.randrange(len(cells))] = str(draw.choice((*NASTY, *TEXTS)))
        lines[row] = ",".join(cells * draw.choice((1, 1, 2)))
    path.write_text("\n".join(lines), encoding="utf-8", errors="replace")


RAW: tuple[Mutation, ...] = (bytes_flipped, head_damaged, cut_short, part_repeated)
OF_TEXT: tuple[Mutation, ...] = (*RAW, text_inserted, text_inserted)
OF_TREES: tuple[Mutation, ...] = (*OF_TEXT, *[value_replaced] * 8)
OF_RECORDS: tuple[Mutation, ...] = (*RAW, *[record_changed] * 8)
OF_TABLES: tuple[Mutation, ...] = (*OF_TEXT, *[folded] * 4)

DAMAGING_SECONDS = 2  # of the processor, for what takes a hundredth


def mutated(path: Path, mutations: tuple[Mutation, ...], seeds: tuple[int, ...]) -> tuple[str, ...]:
    """Apply one operation for each seed; their names.

    In a child: the HDF5 library may crash, or never end, as it writes into what was damaged before, and the file stays
    as it is then.
    """
    draws = [random.Random(seed) for seed in seeds]
    chosen = [draw.choice(mutations) for draw in draws]
    child = os.fork()
    if child == 0:
        faulthandler.disable()
        resource.setrlimit(resource.RLIMIT_CPU, (DAMAGING_SECONDS, DAMAGING_SECONDS))
        try:
            for mutation, draw in zip(chosen, draws, strict=True):
                mutation(path, draw)
        finally:
            os._exit(0)
    os.waitpid(child, 0)
    return tuple(mutation.__name__ for mutation in chosen)
