"""Text that is fit to print, how numbers are written, and the one wording of a refusal.

Text of foreign origin must not write on a terminal as we do: control codes and marks that reverse the order of
what follows are left out (`printable`, `one_line`). A refused dataset is always reported in the same four parts:
what was found, what was expected, the likely cause, the remedy (`refusal`); `naming` puts the file in front.
"""

from __future__ import annotations

import difflib
import math
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from brv_hypo.errors import FlightRecordError

LONGEST_LINE = 300  # characters kept of a title or of another text that belongs on one line
# Marks that reverse the order of what follows, and separators that begin a new line.
_REORDERING = frozenset("\u061c\u200e\u200f\u2028\u2029\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")
NOT_A_NUMBER = "–"
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
LOW_NOISE = 0.9  # times the noise: 1 sigma (`thresholds.NOISE_LEVEL`) below 1
LEAST_PLAIN, MOST_PLAIN = 1e-4, 1e6
"""Numbers from the one to below the other are written without an exponent."""


def printable(text: str) -> str:
    """The text without control codes, marks that reorder it, and code points that no encoding has."""
    if text.isascii() and text.isprintable():
        return text
    left_out = _REORDERING | {each for each in text if unicodedata.category(each) in ("Cc", "Cs")} - {*"\n\t"}
    return "".join(each for each in text if each not in left_out)


def one_line(text: str) -> str:
    """The text on one line: printable, without line breaks, and not endless."""
    line = printable(text).replace("\n", " ").replace("\t", " ")
    return line if len(line) <= LONGEST_LINE else line[:LONGEST_LINE] + "..."


def counted(count: int, thing: str) -> str:
    """So many of a thing: "1 sample", "2 samples"."""
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"


def hypothesis(name: str) -> str:
    """What a person reads for a hypothesis: `none` is the baseline only."""
    return "baseline only" if name == "none" else name


def nearest(name: str, known: Iterable[str], cutoff: float = 0.6, most: int = 1) -> list[str]:
    """The known names that an unknown one is like, the most alike first."""
    return difflib.get_close_matches(name, list(known), n=most, cutoff=cutoff)


def meant(name: str, known: Iterable[str], otherwise: str, cutoff: float = 0.6, most: int = 1) -> str:
    """A question after the known names, `most` at most, that an unknown one is like, or `otherwise`; for a refusal."""
    near = nearest(name, known, cutoff, most)
    if not near:
        return otherwise
    return f"is '{near[0]}' meant?" if most == 1 else f"did you mean {' or '.join(near)}?"


def refused(place: str, *parts: str) -> FlightRecordError:
    """A refusal of what is at `place` ("" is the file): found, expected, cause and remedy, in hostile words."""
    found, expected, cause, remedy = map(one_line, parts)
    where = f"{one_line(place)}: " if place else ""
    return FlightRecordError(f"{where}found {found}, expected {expected}. Likely cause: {cause}. Remedy: {remedy}.")


def refusal(dataset: str, *parts: str) -> FlightRecordError:
    """The refusal of `dataset`, as of `refused`; the caller that knows the file puts its path in front."""
    return refused(f"dataset '{dataset}'", *parts)


@contextmanager
def naming(path: str | Path) -> Iterator[None]:
    """Put the file in front of whatever is refused inside."""
    try:
        yield
    except FlightRecordError as error:
        raise FlightRecordError(f"{path or 'flight'}: {error}") from error


# ---- How numbers are written ----


def number(value: float | None, digits: int = 3) -> str:
    """At `digits` significant digits, as 0.00012, 6.90×10⁶ or 2.6×10⁻⁵; a dash for no number."""
    if value is None or not math.isfinite(value):
        return NOT_A_NUMBER
    rounded = f"{value:.{digits - 1}e}"
    if value == 0.0 or LEAST_PLAIN <= abs(value) < MOST_PLAIN:
        return f"{float(rounded):.{max(digits, 7)}g}"
    mantissa, exponent = rounded.split("e")
    return f"{mantissa}×10{str(int(exponent)).translate(RAISED)}"


def known_to(value: float, sigma: float) -> str:
    """An estimate to the second digit of its standard error, and no further; at most at 9 digits."""
    if not (math.isfinite(value) and math.isfinite(sigma) and value != 0.0 and sigma > 0.0):
        return number(value, 4)
    first = math.floor(math.log10(abs(value)))
    digits = min(first - math.floor(math.log10(sigma)) + 2, 9)
    if digits < 1:  # the estimate is less than the last digit of its error that is worth showing
        return "0"
    plain = LEAST_PLAIN <= abs(value) < MOST_PLAIN
    return f"{value:.{max(digits - 1 - first, 0)}f}" if plain else number(value, digits)


def estimated(value: float, sigma: float) -> str:
    """An estimate with its standard error."""
    return f"{known_to(value, sigma)} ± {number(sigma, 2)}"


def f_ratio(value: float | None) -> str:
    """A ratio of variances: below a hundredth it says nothing."""
    return "<0.01" if value is not None and 0.0 <= value < 0.01 else number(value)


def probability(value: float | None) -> str:
    """A probability in percent, never rounded to certainty."""
    if value is None or not math.isfinite(value):
        return NOT_A_NUMBER
    return ">99 %" if value >= 0.995 else "<1 %" if value <= 0.005 else f"{100.0 * value:.0f} %"


def p_value(value: float | None) -> str:
    """A probability under the null hypothesis at two digits; none is nought."""
    return "<10⁻⁹⁹" if value is not None and value < 1e-99 else number(value, 2)


def share(value: float | None) -> str:
    """A ratio in percent at two digits."""
    if value is None:
        return NOT_A_NUMBER
    return "<0.01 %" if 0.0 < value < 1e-4 else f"{number(100.0 * value, 2)} %"


def percent(ratio: float) -> str:
    """A ratio in percent, without the sign: whole; near nothing and near all to hundredths."""
    if ratio < 5e-5:
        return "<0.01" if ratio > 0.0 else "0"
    return f"{100.0 * ratio:.{0 if 0.01 <= ratio <= 0.98 else 2}f}"


def percents(parts: Sequence[float], digits: int) -> list[str]:
    """Parts of a whole in percent, without the sign; what rounding lacks for 100 is in the largest."""
    rounded = [round(100.0 * part, digits) for part in parts]
    rounded[list(parts).index(max(parts))] += 100.0 - sum(rounded)
    least, pairs = 10.0**-digits, zip(parts, rounded, strict=True)
    return [
        f"{size:.{digits}f}" if size > 0.5 * least else f"<{least:g}" if part > 0.0 else "0" for part, size in pairs
    ]


def below_noise(ratio: float) -> str:
    """What it means that the rms of a residual is far below that of the noise, after its ratio; else nothing."""
    return f", below {LOW_NOISE}: noise is stated too large, or the fit takes some of it" if ratio < LOW_NOISE else ""


def error_share(ratio: float | None) -> str:
    """A held-out error over another in percent; of one far larger its size says nothing."""
    return ">1000 %" if ratio is not None and ratio > 10.0 else share(ratio)


def times(*ends: float) -> str:
    """A time in a sentence, or an interval's ends, to hundredths without needless digits: 2 s, 2 to 4.25 s."""
    return f"{' to '.join(dict.fromkeys(f'{end:.2f}'.rstrip('0').rstrip('.') for end in ends))} s"


def instant(time: float, sigma: float) -> str:
    """A time to the second digit of its standard error, however late its clock is."""
    if not (math.isfinite(time) and math.isfinite(sigma) and sigma > 0.0):
        return number(time, 4)
    return f"{time:.{max(1 - math.floor(math.log10(sigma)), 0)}f}"


def interval(region: tuple[float, float] | None) -> str:
    """A region of time; a dash where it is the whole."""
    return NOT_A_NUMBER if region is None else f"{region[0]:.2f}–{region[1]:.2f}"
