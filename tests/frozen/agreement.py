"""When a result agrees with the frozen one: three classes for values, and one for messages.

A path is `NAME.COMMAND:values/ranking/0/f_ratio`; `*` in the paths of `explained.yaml` matches any part of one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Any, Literal

import yaml

ACROSS_BUILDS = 1e-6
"""Of a standard error, or relative: what another build of numpy or BLAS may change."""
CLOSE = 1e-9

ABSENT = "(absent)"
Same = Callable[[float, float, float], bool]
"""Whether two numbers agree; the third is the size that their difference is held against."""
SMALL_PROBABILITY = 1e-3
"""Below it a probability is compared as if it were this large."""
SIZE_OF_ZERO = 1e-9
"""What a difference from nothing is held against: a sum that cancels leaves its rounding."""
_NUMBER = re.compile(r"[-+]?\d+(?:[.,]\d+)*(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Difference:
    """Two leaves that do not agree, at `path`; `size` is what a difference of numbers is compared with."""

    path: str
    frozen: Any
    found: Any
    size: float = 0.0

    @property
    def relative(self) -> float:
        """The change of a number, relative; infinite for anything else."""
        if not (_is_number(self.frozen) and _is_number(self.found)) or self.frozen == 0.0:
            return math.inf
        return abs(self.found - self.frozen) / abs(self.frozen)

    def within(self, share: float) -> bool:
        """Whether these are numbers that differ by no more than this share of their size."""
        both = _is_number(self.frozen) and _is_number(self.found)
        return both and abs(self.found - self.frozen) <= share * self.size

    def __str__(self) -> str:
        size = f" ({self.relative:.1e} relative)" if math.isfinite(self.relative) else ""
        return f"{self.path}: {_shown(self.frozen)} -> {_shown(self.found)}{size}"


@dataclass(frozen=True)
class Explanation:
    """Paths that need not be identical, and why: `close`, or `explained` for those that need only exist."""

    path: str
    reason: str
    agreement: Literal["close", "explained"] = "explained"

    def covers(self, path: str) -> bool:
        return fnmatchcase(path, self.path)


@dataclass(frozen=True)
class Allowance:
    """How far apart numbers at these paths may be with other libraries than those of the writing, and why."""

    path: str
    share: float
    reason: str


def identical(frozen: Any, found: Any, path: str = "", *, exact: bool = False) -> list[Difference]:
    """The same keys, texts, flags and whole numbers; the same numbers, bit for bit, where `exact`.

    This holds on the machine where the result was written. Elsewhere, with another numpy or BLAS, an estimate beside
    its `std_error` may differ by 1e-6 of it, and its F-ratio as the square of the two; any other number by 1e-6 of
    itself, a probability by 1e-9 at least, one of an array by 1e-6 of the largest in it.
    """
    return list(_differences(frozen, found, path, _bit_for_bit if exact else _within(ACROSS_BUILDS)))


def close(frozen: Any, found: Any, path: str = "") -> list[Difference]:
    """As `identical`, but numbers may differ by 1e-9 of the same sizes: for a change in the order of arithmetic."""
    return list(_differences(frozen, found, path, _within(CLOSE)))


def explained(frozen: Any, found: Any, path: str = "") -> list[Difference]:
    """Whatever is frozen is there, with any value; more may be there."""
    return [each for each in _differences(frozen, found, path, _anything) if each.found is ABSENT]


def same_words(frozen: str, found: str) -> bool:
    """The same words; numbers in them may differ by one of the last digit printed."""
    if _NUMBER.split(frozen) != _NUMBER.split(found):
        return False
    pairs = zip(_NUMBER.findall(frozen), _NUMBER.findall(found), strict=True)
    return all(a == b or abs(_number(a) - _number(b)) <= 1.01 * _last_digit(a) for a, b in pairs)


def disagreements(
    frozen: dict[str, Any],
    found: dict[str, Any],
    name: str,
    *,
    required: Literal["exact", "close", "across builds"] = "across builds",
    explanations: Sequence[Explanation] | None = None,
    allowances: Sequence[Allowance] = (),
) -> list[Difference]:
    """What of a result, values and messages, agrees neither as `required` nor as `explained.yaml` says of its path.

    `name` is NAME.COMMAND. Messages are the same, to the word where `required` is exact (`same_words`). `allowances`
    are those for other libraries, where the libraries are others.
    """
    known = read_explanations() if explanations is None else explanations
    if required == "close":
        values = close(frozen["values"], found["values"], f"{name}:values")
    else:
        values = identical(frozen["values"], found["values"], f"{name}:values", exact=required == "exact")
    words = list(_in_words(frozen["messages"], found["messages"], f"{name}:messages", exact=required == "exact"))
    return [each for each in (*values, *words) if not _is_explained(each, known) and not _is_allowed(each, allowances)]


@cache
def read_explanations(file: Path = Path(__file__).parent / "explained.yaml") -> tuple[Explanation, ...]:
    """What the file holds; a path without a reason is refused."""
    entries = yaml.safe_load(file.read_text(encoding="utf-8")) or []
    found = tuple(Explanation(e["path"], e["reason"], e.get("agreement", "explained")) for e in entries)
    for each in found:
        if not each.reason.strip() or each.agreement not in ("close", "explained"):
            raise ValueError(f"{file.name}: '{each.path}' needs a reason, and close or explained as its agreement")
    return found


@cache
def read_allowances(file: Path = Path(__file__).parent / "rounding.yaml") -> tuple[Allowance, ...]:
    """What the file holds, in its order."""
    return tuple(Allowance(**each) for each in yaml.safe_load(file.read_text(encoding="utf-8")))


def _is_allowed(difference: Difference, allowances: Sequence[Allowance]) -> bool:
    share = next((each.share for each in allowances if fnmatchcase(difference.path, each.path)), 0.0)
    return difference.within(share)


def _is_explained(difference: Difference, explanations: Sequence[Explanation]) -> bool:
    for each in explanations:
        if each.covers(difference.path):
            if each.agreement == "explained":
                return difference.found is not ABSENT
            if difference.within(CLOSE):
                return True
    return False


def _differences(frozen: Any, found: Any, path: str, same: Same, size: float | None = None) -> Iterator[Difference]:
    if isinstance(frozen, dict) and isinstance(found, dict):
        for key in sorted(frozen.keys() | found.keys()):
            place = _joined(path, key)
            old, new = frozen.get(key, ABSENT), found.get(key, ABSENT)
            yield from _differences(old, new, place, same, _size_beside(frozen, key, place))
    elif isinstance(frozen, list) and isinstance(found, list):
        numbers = [abs(each) for each in frozen if _is_number(each)]
        largest = max(numbers) if numbers and len(frozen) > 1 else None
        for k, (old, new) in enumerate(zip(frozen, found, strict=False)):
            yield from _differences(old, new, _joined(path, str(k)), same, largest)
        if len(frozen) != len(found):
            yield Difference(_joined(path, "length"), len(frozen), len(found))
    elif frozen is ABSENT or found is ABSENT:
        yield Difference(path, frozen, found)
    elif isinstance(frozen, float) and _is_number(found):
        compared_with = (abs(frozen) or SIZE_OF_ZERO) if size is None else size
        if not same(frozen, found, compared_with):
            yield Difference(path, frozen, found, compared_with)
    elif same is not _anything and (type(frozen) is not type(found) or frozen != found):
        yield Difference(path, frozen, found)


def _size_beside(section: dict[str, Any], key: str, path: str) -> float | None:
    """What a number's difference is compared with, by its neighbours and name; None: the number itself."""
    number, std_error = section.get(key), section.get("std_error")
    if not _is_number(number):
        return None
    if key == "value" and _is_number(std_error) and std_error > 0.0:
        return float(std_error)
    if key == "f_ratio" and "std_error" in section:
        return 2.0 * math.sqrt(abs(number)) + abs(number)
    if "probability" in path or "p_value" in path:
        return max(abs(number), SMALL_PROBABILITY)
    return None


def _in_words(frozen: dict[str, str], found: dict[str, str], path: str, *, exact: bool) -> Iterator[Difference]:
    for key in sorted(frozen.keys() | found.keys()):
        old, new = frozen.get(key, ABSENT), found.get(key, ABSENT)
        if old != new and (exact or not same_words(old, new)):
            yield Difference(_joined(path, key), old, new)


def _within(share: float) -> Same:
    def same(frozen: float, found: float, size: float) -> bool:
        return frozen == found or abs(found - frozen) <= share * size

    return same


def _bit_for_bit(frozen: float, found: float, size: float) -> bool:
    return repr(frozen) == repr(found)


def _anything(frozen: Any, found: Any, size: float) -> bool:
    return True


def _is_number(item: Any) -> bool:
    return isinstance(item, int | float) and not isinstance(item, bool)


def _joined(path: str, key: str) -> str:
    return f"{path}/{key}" if path else key


def _number(text: str) -> float:
    return float(text.replace(",", ""))


def _last_digit(text: str) -> float:
    mantissa, _, power = text.replace(",", "").partition("e")
    decimals = len(mantissa.partition(".")[2])
    return float(f"1e{int(power or 0) - decimals}")


def _shown(item: Any) -> str:
    text = item if isinstance(item, str) else repr(item)
    return text if len(text) <= 160 else text[:157] + "..."
