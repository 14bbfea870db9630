"""The conformance kit: named checks that every plugin must pass, for authors to run in their own tests.

    @pytest.mark.parametrize("check", MECHANISM_CHECKS, ids=str)
    def test_keeps_the_contract(check):
        check(Ablation())

check.py      what a check is; `conformance(item)` runs all that apply
mechanism.py  the checks of a mechanism
effect.py     the checks of a record effect
renamed.py    a mechanism under other names and units of its parameters
samples.py    the motion and the flight record that they are run on
"""

from brv_hypo.mechanisms.conformance.check import Check, Nonconformity, Outcome
from brv_hypo.mechanisms.conformance.effect import EFFECT_CHECKS
from brv_hypo.mechanisms.conformance.mechanism import MECHANISM_CHECKS
from brv_hypo.mechanisms.conformance.renamed import Alias, renamed
from brv_hypo.mechanisms.conformance.run import conformance, relied_on
from brv_hypo.mechanisms.conformance.samples import sample_flight, sample_motion

__all__ = [
    "EFFECT_CHECKS",
    "MECHANISM_CHECKS",
    "Alias",
    "Check",
    "Nonconformity",
    "Outcome",
    "conformance",
    "relied_on",
    "renamed",
    "sample_flight",
    "sample_motion",
]
