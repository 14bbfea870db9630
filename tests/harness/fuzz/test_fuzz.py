"""The fuzzing that every run of the tests does, and every input that once failed."""

from __future__ import annotations

from itertools import islice

import pytest

from brv_hypo.io import sandbox
from tests.harness.fuzz.run import Input, failure_of, inputs
from tests.harness.fuzz.targets import TARGETS

BATCHES, OF_A_BATCH, QUICK = 20, 25, 8
# Of the first batch the default tests try the first inputs, the thorough ones the others; the rest is slow.
# By target, the seeds of the operations on its valid input: each ended in a fault, a hang or litter once. The second
# crashed the HDF5 library as it was damaged.
FOUND: tuple[tuple[str, tuple[int, ...]], ...] = (
    ("record", (126550628,)),
    ("record json", (2974007189, 2294465374, 404625220, 1250414270)),
)


@pytest.fixture(autouse=True)
def a_reader_soon_given_up(monkeypatch):
    """What keeps a library busy for ever does so in one second as in five."""
    monkeypatch.setattr(sandbox, "READ_CPU_SECONDS", 1)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("batch", "start", "stop"),
    [
        (0, 0, QUICK),
        pytest.param(0, QUICK, OF_A_BATCH, marks=pytest.mark.thorough),
        *(pytest.param(k, 0, OF_A_BATCH, marks=pytest.mark.slow) for k in range(1, BATCHES)),
    ],
)
def test_mutated_inputs_end_as_the_contract_says(batch, start, stop):
    cases = islice(inputs(OF_A_BATCH, seed=1000 + batch), start, stop)
    failures = [failure for case in cases if (failure := failure_of(case))]
    assert failures == []


@pytest.mark.parametrize(
    "target",
    [
        pytest.param(each, marks=pytest.mark.thorough if "reconstruct" in each.arguments else (), id=each.label)
        for each in TARGETS
    ],
)
def test_the_valid_input_ends_as_the_contract_says(target):
    assert failure_of(Input(target, ())) is None


@pytest.mark.thorough
@pytest.mark.parametrize(("label", "seeds"), FOUND)
def test_an_input_that_failed_once_does_not_again(label, seeds):
    target = next(target for target in TARGETS if target.label == label)
    assert failure_of(Input(target, seeds)) is None
