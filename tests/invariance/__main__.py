"""`python -m tests.invariance`: every law on drawn flights; exits with 1 where one does not hold.

`--law` takes one of them; a flight on which a law does not hold is printed with how far apart its comparisons are.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Iterator

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from tests.invariance.chain import Case, Distance
from tests.invariance.laws import LAWS, Found, Law
from tests.invariance.test_laws import CASES


def drawn(law: Law, flights: int, number: int) -> Iterator[tuple[Case, Found]]:
    """What the law finds on so many drawn flights."""
    found: list[tuple[Case, Found]] = []

    @seed(number)
    @settings(
        max_examples=flights,
        phases=(Phase.generate,),
        suppress_health_check=list(HealthCheck),
        database=None,
        deadline=None,
    )
    @given(case=CASES, data=st.data())
    def draw(case: Case, data: st.DataObject) -> None:
        found.append((case, _asked(law, data, case)))

    draw()
    yield from found


def _asked(law: Law, data: st.DataObject, case: Case) -> Found:
    """Comparisons that have not even the same terms are infinitely far apart."""
    try:
        return law(data, case)
    except (AssertionError, ValueError) as different:
        print(f"  {different}", flush=True)
        return Distance(math.inf, math.inf), Distance(0.0, 0.0)


def main() -> int:
    """Ask every law, print where one does not hold, and a line for each."""
    parser = argparse.ArgumentParser(prog="python -m tests.invariance", description=__doc__)
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--law", choices=sorted(LAWS), action="append", help="this one only")
    options = parser.parse_args()
    broken = 0
    for name in options.law or sorted(LAWS):
        begun, apart = time.process_time(), []
        for case, (found, allowed) in drawn(LAWS[name], options.flights, options.seed):
            apart.append(found.estimates)
            if not found.within(allowed):
                broken += 1
                print(f"{name} does not hold of {case}: {found}, where {allowed} is allowed", flush=True)
        print(
            f"{name}: {len(apart)} flights, estimates apart by {np.median(apart):.0e} standard errors in the median, "
            f"{np.max(apart):.0e} at most; {time.process_time() - begun:.0f} s of CPU",
            flush=True,
        )
    print(f"{broken} broken")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
