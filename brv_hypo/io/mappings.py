"""YAML and JSON files as plain mappings, within budgets: what they hold is checked before it is built.

YAML knows aliases, with which a few lines mean gigabytes, and dates, which no setting of ours is:
what aliases expand to is counted, and dates remain text.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import yaml

from brv_hypo.errors import UsageError
from brv_hypo.io.files import read_text
from brv_hypo.io.text import one_line

YAML_ENDINGS = (".yaml", ".yml")
YAML_BYTES = 512 * 1024  # the longest configuration that comes along has 4 kB
YAML_VALUES = 50_000  # values that a YAML file may have, aliases expanded
JSON_BYTES = 64 * 1024 * 1024  # a result with every series in it has some megabytes
DEEPEST = 40  # levels of nesting
TOO_DEEP = f"more than {DEEPEST} levels of nesting"
LARGEST_WHOLE = 2**63  # whole numbers are read below this size, as arrays hold them

_DATES = "tag:yaml.org,2002:timestamp"


def read_yaml(path: str | Path, expected: str) -> dict[str, Any]:
    """The mapping in a YAML file, {} where it is empty; UsageError with the place of what is wrong or too much."""
    text = read_text(path, expected, YAML_BYTES)
    try:
        content = _load(text)
    except (yaml.YAMLError, RecursionError) as failure:
        raise UsageError(f"{path}: cannot be read: it is not YAML{_reason(failure)}. Correct the file.") from None
    return _mapping(content, path, expected)


def read_json(path: str | Path, expected: str) -> dict[str, Any]:
    """The mapping in a JSON file; UsageError with the place of what is wrong or too much."""
    text = read_text(path, expected, JSON_BYTES)
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as failure:
        raise UsageError(
            f"{path}: cannot be read: it is not JSON that can be used ({one_line(str(failure))}), "
            f"expected {expected}. Likely cause: another file, or one cut short."
        ) from None
    return _mapping(content, path, expected)


def read_mapping(path: str | Path, expected: str) -> dict[str, Any]:
    """The mapping in a file of JSON, which begins with a brace, or of YAML; raises UsageError as their readers do."""
    begins = read_text(path, expected, JSON_BYTES).lstrip()[:1]
    return read_json(path, expected) if begins == "{" else read_yaml(path, expected)


def _mapping(content: Any, path: str | Path, expected: str) -> dict[str, Any]:
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise UsageError(f"{path} holds {type(content).__name__}, expected a mapping: {expected}.")
    odd = next((key for key in content if not isinstance(key, str)), None)
    if odd is not None:
        raise UsageError(f"{path}: found the key {one_line(repr(odd))}, expected names. Put text in quotes.")
    return content


class _Loader(yaml.SafeLoader):
    """Plain data only; dates stay text."""

    yaml_implicit_resolvers = {  # noqa: RUF012 - as the base class declares it
        first: [(tag, pattern) for tag, pattern in resolvers if tag != _DATES]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        """As the base class; what a value's own type refuses is a refusal with its place."""
        try:
            value = super().construct_object(node, deep)
        except yaml.YAMLError:
            raise
        except Exception as failure:  # the constructors raise errors of many kinds
            raise _fault(f"a value that cannot be read ({type(failure).__name__}: {failure})", node) from None
        if isinstance(value, int) and abs(value) >= LARGEST_WHOLE:
            raise _fault(f"a whole number of {len(node.value)} digits", node)
        return value


def _load(text: str) -> Any:
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _expanded(node, {}, set())
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _expanded(node: Any, known: dict[int, int], above: set[int]) -> int:
    """How many values a node expands to; raises MarkedYAMLError for too many or too deep, and where it holds itself."""
    if id(node) in known:
        return known[id(node)]
    if id(node) in above or len(above) >= DEEPEST:
        raise _fault("an alias of what it stands in" if id(node) in above else TOO_DEEP, node)
    total = 1
    if not isinstance(node, yaml.ScalarNode):
        pairs = isinstance(node, yaml.MappingNode)
        parts = [part for pair in node.value for part in pair] if pairs else node.value
        keys = set[str]()
        for key in (pair[0] for pair in node.value if pairs and isinstance(pair[0], yaml.ScalarNode)):
            if key.value in keys and key.value != "<<":
                raise _fault(f"'{key.value}' is there twice, of which one would be ignored", key)
            keys.add(key.value)
        above.add(id(node))
        total += sum(_expanded(part, known, above) for part in parts)
        above.discard(id(node))
    if total > YAML_VALUES:
        raise _fault(f"aliases or lists that stand for more than {YAML_VALUES} values", node)
    known[id(node)] = total
    return total


def _fault(problem: str, node: yaml.Node) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)


def _reason(failure: yaml.YAMLError | RecursionError) -> str:
    """What is wrong, and where if that is known."""
    if not isinstance(failure, yaml.MarkedYAMLError):
        return f": {TOO_DEEP if isinstance(failure, RecursionError) else one_line(str(failure))}"
    mark = failure.problem_mark or failure.context_mark
    where = "" if mark is None else f", line {mark.line + 1}, column {mark.column + 1}"
    what = " ".join(part for part in (failure.context, failure.problem) if part)
    return f"{where}: {one_line(what)}"
