"""The constants that decide stand in one file, each with a reason, and each decides something."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import brv_hypo
from brv_hypo import constants

PACKAGE = Path(brv_hypo.__file__).parent
FILE = Path(constants.__file__)
DECIDING = ("flight", "motion", "model", "regression", "ranking", "identification", "residuals")
STUDIES = {"benchmark", "study", "record_study", "planting", "planting_on_record", "variants"}
# What may stand in its module: no change of it changes what is concluded of a flight.
ARITHMETIC = {
    "CROSSFLOW_FLOOR",
    "NEAREST",
    "_CUTOFF",
    "_END",
    "_FEWEST",
    "_LEAST_ROUGHNESS",
    "_LEAST_WANDER",
    "_RIDGE",
    "_ROUNDING",
    "_SAME",
    "_SHORT",
    "_SPENT",
    "_STEP",
    "_UNTOLD",
    "_WORST_CONDITION",
}
MEMORY_AND_TIME = {
    "AT_ONCE",
    "_AT_ONCE",
    "_BLOCK",
    "_KEPT_VALUES",
    "_MOST_KEPT",
    "_REMEMBERED",
    "_TYPICAL_TERMS",
    "_WIDE",
}
PHYSICS_AND_MATHEMATICS = {
    "EDGE_OF_STEP",
    "FOOT",
    "GRAVITY",
    "HIGHEST_ALTITUDE",
    "LOWEST_ALTITUDE",
    "MAD_TO_SIGMA",
    "MEDIAN_EFFICIENCY",
    "_EARTH_RADIUS",
    "_FEET",
    "_G",
    "_GRAVITY",
    "_IDENTITY",
    "_PSF",
}
FORMATS_AND_SIZES = {
    "FEWEST_SAMPLES",
    "FORMAT_VERSION",
    "LARGEST_PROPERTY",
    "LONGEST_LINE",
    "LONGEST_UNITS",
    "MINIMUM_SAMPLES",
    "MOST_NOTES",
    "SHORTEST_STEP",
    "SLOWEST",
    "_CSV_BYTES",
    "_MOST_PLACES",
}
TOLD_AND_DRAWN = {
    "MOST_CUTS_NAMED",
    "MOST_DRAWN",
    "MOST_NAMED",
    "MOST_OTHERS",
    "_MANY_TIMES",
    "_MOST_TOLD",
    "_REGIONS",
    "_TOLD",
}
PROPOSED_BY_GUESS = {
    "ABOVE_GROUND",
    "FAR",
    "FASTEST_RADIANS",
    "NOSE_UP",
    "NOT_EARTHS",
    "RATES",
    "REST_SECONDS",
    "SLOWEST_FAST",
    "STILL",
    "WITHIN",
}
ELSEWHERE = ARITHMETIC | MEMORY_AND_TIME | PHYSICS_AND_MATHEMATICS | FORMATS_AND_SIZES | TOLD_AND_DRAWN


def assigned(tree: ast.Module) -> list[tuple[str, ast.expr, int]]:
    """Names of one target that a module assigns, their values and lines."""
    found = []
    for node in tree.body:
        target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
        value = getattr(node, "value", None)
        if isinstance(target, ast.Name) and isinstance(value, ast.expr):
            found.append((target.id, value, node.lineno))
        elif isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
            pairs = zip(target.elts, value.elts, strict=True)
            found += [(name.id, each, node.lineno) for name, each in pairs if isinstance(name, ast.Name)]
    return found


def is_number(value: ast.expr) -> bool:
    """Whether an expression is made of numbers alone."""
    if isinstance(value, ast.Constant):
        return isinstance(value.value, int | float) and not isinstance(value.value, bool)
    if isinstance(value, ast.UnaryOp):
        return is_number(value.operand)
    if isinstance(value, ast.BinOp):
        return is_number(value.left) and is_number(value.right)
    return isinstance(value, ast.Tuple) and bool(value.elts) and all(map(is_number, value.elts))


def sources() -> dict[Path, str]:
    """Every module that may use a constant."""
    effects = PACKAGE.parent / "plugins"
    return {path: path.read_text() for folder in (PACKAGE, effects) for path in folder.rglob("*.py") if path != FILE}


def test_every_constant_is_used() -> None:
    names = [name for name, _, _ in assigned(ast.parse(FILE.read_text()))]
    nodes = [node for text in sources().values() for node in ast.walk(ast.parse(text))]
    imports = [node for node in nodes if isinstance(node, ast.ImportFrom) and node.module == constants.__name__]
    used = {alias.name for node in imports for alias in node.names}
    assert len(names) == len(set(names)) > 300
    assert set(names) - used == set()


def test_every_constant_has_its_reason_beside_it() -> None:
    lines = FILE.read_text().splitlines()
    bare = []
    for name, _, number in assigned(ast.parse(FILE.read_text())):
        above = number - 2
        while re.match(r"[A-Z0-9_]+ = [^#]*$", lines[above]):  # those that a comment above speaks of together
            above -= 1
        if "#" not in lines[number - 1] and not lines[above].startswith("# "):
            bare.append(name)
    assert bare == []


def test_no_deciding_number_stands_elsewhere() -> None:
    strays = []
    for path, text in sources().items():
        package = path.relative_to(PACKAGE).parts[0] if path.is_relative_to(PACKAGE) else ""
        if package not in DECIDING or path.stem in STUDIES:
            continue
        allowed = ELSEWHERE | (PROPOSED_BY_GUESS if path.stem.startswith("guess") else set())
        found = assigned(ast.parse(text))
        strays += [f"{path.stem}: {name}" for name, value, _ in found if is_number(value) and name not in allowed]
    assert strays == []
