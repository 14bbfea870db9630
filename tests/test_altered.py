from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import pytest

from brv_hypo.altered import altered


@dataclass(frozen=True)
class _Pair:
    first: int
    second: int = 2

    @cached_property
    def both(self) -> int:
        """Their sum."""
        return self.first + self.second


def test_a_copy_is_what_replace_gives_and_finds_its_own_sums() -> None:
    pair = _Pair(1)
    assert pair.both == 3
    assert altered(pair, second=5) == replace(pair, second=5)
    assert altered(pair, second=5).both == 6


def test_what_is_no_field_is_refused() -> None:
    with pytest.raises(TypeError, match="no field third"):
        altered(_Pair(1), third=3)
