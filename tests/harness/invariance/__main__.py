"""`python -m tests.harness.invariance`: every law on the same drawn flights; exits with 1 where one does not hold.

`--law` takes one of them, `--mechanism` the flights to which one is fitted. A flight on which a law does not hold is
printed with how far apart its comparisons are.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Collection, Iterable, Mapping

import numpy as np
from hypothesis import HealthCheck, Phase, assume, given, seed, settings
from hypothesis import strategies as st

from tests.harness.invariance.chain import PLANTS, Case, Distance
from tests.harness.invariance.laws import LAWS, NOTHING, Found, Law
from tests.harness.invariance.test_laws import SIMPLEST, cases

EVERY = 10  # flights between accounts of the result so far


class _Account:
    """What a law gave on flight after flight: distances, how often it did not hold, processor seconds."""

    def __init__(self, name: str, law: Law) -> None:
        self._name, self._law = name, law
        self._apart: list[Distance] = []
        self._seconds = 0.0
        self.broken = 0

    def check(self, data: st.DataObject, case: Case) -> None:
        """One flight more; printed where the law does not hold of it."""
        begun = time.process_time()
        found, allowed = self._checked(data, case)
        self._seconds += time.process_time() - begun
        self._apart.append(found)
        if not found.within(allowed):
            self.broken += 1
            print(f"{self._name} does not hold of {case}: {found}, where {allowed} is allowed", flush=True)

    def _checked(self, data: st.DataObject, case: Case) -> Found:
        """Comparisons that have not even the same terms are infinitely far apart."""
        try:
            return self._law(data, case)
        except (AssertionError, ValueError) as different:
            print(f"  {different}", flush=True)
            return Distance(math.inf, math.inf), Distance(0.0, 0.0)

    def __str__(self) -> str:
        apart = self._apart or [NOTHING]
        estimates = [each.estimates for each in apart]
        return (
            f"{self._name}: {self.broken} of {len(self._apart)} flights broken, estimates apart by "
            f"{np.median(estimates):.0e} standard errors in the median, {np.max(estimates):.0e} at most, criteria "
            f"by {max(each.criteria for each in apart):.0e} at most; {self._seconds:.0f} s of CPU"
        )


def check(
    laws: Mapping[str, Law], flights: int, number: int, mechanisms: Collection[str] = PLANTS
) -> Iterable[_Account]:
    """Every law on those of so many drawn flights to which one of these mechanisms is fitted.

    The laws share what they compare with.
    """
    accounts = [_Account(name, law) for name, law in laws.items()]

    # One run for each flight: a run of many would try again, with small changes, what it has tried.
    @settings(
        max_examples=1, phases=(Phase.generate,), suppress_health_check=list(HealthCheck), database=None, deadline=None
    )
    @given(case=cases(), data=st.data())
    def draw(case: Case, data: st.DataObject) -> None:
        assume(case != SIMPLEST)
        for account in accounts if case.mechanism in mechanisms else ():
            account.check(data, case)

    for drawn in range(1, flights + 1):
        seed(f"{number} {drawn}")(draw)()
        if drawn % EVERY == 0:
            print(f"after {drawn} flights", *accounts, sep="\n", flush=True)
    return accounts


def main() -> int:
    """Check every law, print where one does not hold, and a line for each."""
    parser = argparse.ArgumentParser(prog="python -m tests.harness.invariance", description=__doc__)
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--law", choices=sorted(LAWS), action="append", help="this one only")
    parser.add_argument("--mechanism", choices=PLANTS[1:], action="append", help="flights to which it is fitted only")
    options = parser.parse_args()
    laws = {name: LAWS[name] for name in options.law or sorted(LAWS)}
    accounts = check(laws, options.flights, options.seed, options.mechanism or PLANTS)
    print(*accounts, sep="\n")
    return 1 if any(account.broken for account in accounts) else 0


if __name__ == "__main__":
    sys.exit(main())
