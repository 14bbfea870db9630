"""Text of any characters, without the table of all of Unicode that hypothesis takes seconds to build for its own."""

from __future__ import annotations

from hypothesis import strategies as st

_SURROGATES, _FIRST = 0x800, 0xD800  # of which no text in a file consists
_FEW = st.integers(0, 0xFF)
_ALL = st.integers(0, 0x10FFFF - _SURROGATES).map(lambda code: code + _SURROGATES * (code >= _FIRST))
CHARACTERS = st.one_of(_FEW, _ALL).map(chr)


def texts(max_size: int | None = None) -> st.SearchStrategy[str]:
    """Of `max_size` characters at most."""
    return st.text(CHARACTERS, max_size=max_size)
