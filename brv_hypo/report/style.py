"""The one look of tables, and how numbers are written."""

from __future__ import annotations

import math
from collections.abc import Iterator

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from brv_hypo.io.text import printable

NOT_A_NUMBER = "–"


class _PlainConsole(Console):
    """A console on which no text, wherever it comes from, acts as a control code."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterator[Segment]:
        """As the base class, each piece of text made printable."""
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else printable(text), style, control)


def plain_console() -> Console:
    """Standard output for human readers: nothing in a text is markup, or more than text."""
    return _PlainConsole(highlight=False, markup=False)


LEAST_PLAIN, MOST_PLAIN = 1e-4, 1e6
"""Numbers from the one to below the other are written without an exponent."""


def number(value: float | None, digits: int = 3) -> str:
    """At `digits` significant digits, as 0.00012, 6.90e6 or 2.6e-5; a dash for no number."""
    if value is None or not math.isfinite(value):
        return NOT_A_NUMBER
    rounded = f"{value:.{digits - 1}e}"
    if value == 0.0 or LEAST_PLAIN <= abs(value) < MOST_PLAIN:
        return f"{float(rounded):.{max(digits, 7)}g}"
    mantissa, exponent = rounded.split("e")
    return f"{mantissa}e{int(exponent)}"


def known_to(value: float, sigma: float) -> str:
    """An estimate to the second digit of its standard error, and no further; at most at 9 digits."""
    if not (math.isfinite(value) and math.isfinite(sigma) and value != 0.0 and sigma > 0.0):
        return number(value, 4)
    digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(sigma)) + 2
    if digits < 1:  # the estimate is less than the last digit of its error that is worth showing
        return "0"
    digits = min(digits, 9)
    if not LEAST_PLAIN <= abs(value) < MOST_PLAIN:
        return number(value, digits)
    return f"{value:.{max(digits - 1 - math.floor(math.log10(abs(value))), 0)}f}"


def f_ratio(value: float | None) -> str:
    """A ratio of variances: below a hundredth it says nothing."""
    if value is not None and math.isfinite(value) and 0.0 <= value < 0.01:
        return "<0.01"
    return number(value)


def probability(value: float | None) -> str:
    """A probability in percent, never rounded to certainty."""
    if value is None or not math.isfinite(value):
        return NOT_A_NUMBER
    if value >= 0.995:
        return ">99 %"
    if value <= 0.005:
        return "<1 %"
    return f"{100.0 * value:.0f} %"


def p_value(value: float | None) -> str:
    """A probability under the null hypothesis at two digits; none is nought."""
    return "<1e-99" if value is not None and value < 1e-99 else number(value, 2)


def share(value: float | None) -> str:
    """A ratio in percent at two digits."""
    if value is not None and 0.0 < value < 1e-4:
        return "<0.01 %"
    return NOT_A_NUMBER if value is None else f"{number(100.0 * value, 2)} %"


def interval(region: tuple[float, float] | None) -> str:
    """A region of time; a dash where it is the whole."""
    return NOT_A_NUMBER if region is None else f"{region[0]:.2f}–{region[1]:.2f}"
