"""How many samples the histories of a result hold: they are for pictures, which show less than a long record has."""

from __future__ import annotations

# Samples of a stretch of time up to which all are drawn.
MOST_DRAWN = 10_000


def drawn(samples: int) -> slice:
    """Which of so many samples are drawn: all of them, or every so many-th."""
    return slice(None, None, max(1, -(-samples // MOST_DRAWN)))
