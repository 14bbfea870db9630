"""`python -m tests.importing.mutated_tables COUNT`: tables of all dialects with damage; how many end in a fault."""

from __future__ import annotations

import random
import sys
import tempfile
import warnings
from pathlib import Path

from brv_hypo.errors import BrvHypoError
from brv_hypo.importing.formats import Layout, read_columns
from brv_hypo.importing.guess import guess_map
from tests.harness.fuzz.mutations import OF_TABLES, RAW
from tests.importing.dialects import DIALECTS, TRUTH


def fault_of(folder: Path, seed: int) -> str | None:
    """What is raised beside refusals where a damaged table is guessed at and read by its map; None for nothing."""
    draw = random.Random(seed)
    dialect = draw.choice([*DIALECTS])
    table = DIALECTS[dialect]
    table.write(path := folder / f"log.{table.suffix}")
    for _ in range(draw.choice((1, 1, 2, 4))):
        draw.choice(OF_TABLES if table.suffix == "csv" else RAW)(path, draw)
    columns = tuple(table.columns.get(name, name) for name in TRUTH)
    for attempt in (lambda: guess_map(path), lambda: read_columns(path, columns, Layout(**table.keys))):
        try:
            attempt()
        except BrvHypoError:
            continue
        except Exception as error:
            return f"{dialect}, seed {seed}: {type(error).__name__}: {error}"
    return None


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as name:
        faults = [fault for seed in range(int(sys.argv[1])) if (fault := fault_of(Path(name), seed))]
    print(*faults[:20], f"{sys.argv[1]} tables, {len(faults)} faults", sep="\n")
