"""Which candidate is added, and how the candidates are reported."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, TypeVar, cast

import numpy as np
import pytest

from brv_hypo.comparison.intervals import Excess
from brv_hypo.mechanisms import find
from brv_hypo.model.baseline import SlopeSchedule
from brv_hypo.model.model import Model
from brv_hypo.model.term import Regressor
from brv_hypo.thresholds import SPECIFIC
from brv_hypo.tracing import acceptance
from brv_hypo.tracing.acceptance import Candidate, Choice, Tried, first_accepted, named_again
from brv_hypo.tracing.baseline import start_model
from brv_hypo.tracing.fit import Flights, correct
from brv_hypo.tracing.result import Step, TraceConfig
from brv_hypo.tracing.trace import _confirmed, beside_hints
from tests.flights import nominal

pytestmark = pytest.mark.thorough

SCATTER = 0.05
PARTS = ("deciding", "reported", "both")
ALONG, ACROSS = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


def candidate(
    name: str,
    gain: float,
    contribution: np.ndarray = ALONG,
    mechanisms: tuple[Any, ...] = (),
    selected: tuple[Regressor, ...] = (),
) -> Candidate:
    fit: Any = SimpleNamespace(name=name, mechanisms=mechanisms, selected=selected)
    kind: Any = "discovered" if name.startswith("discovered") else "mechanism"
    one = Candidate(kind, fit, fit, evidence=gain)
    return known(one, gain=gain, p_value=1e-9, contribution=contribution, fall=100.0)


Found = TypeVar("Found", Candidate, Tried)


def known(one: Found, **values: Any) -> Found:
    """The same with values that it would find itself."""
    other = replace(one)
    vars(other).update({**vars(one), **values})
    return other


def judged(one: Any, score: float, ratio: float) -> Tried:
    """What was tried, its ratio known to 0.1, on samples whose noise scatters it by as much as `SCATTER`."""
    nothing: Any = None
    tried = Tried(one, nothing, nothing, has_tolerance=False, gain=SPECIFIC)
    return known(tried, score=score, _scatter=SCATTER, ratios=dict.fromkeys(PARTS, (ratio, 0.1)))


def beside_nothing(*found: Candidate, white: bool = False, scheduled: bool = True) -> Choice:
    """What is chosen beside a model without columns; whether its residual is white, and its slope a schedule."""
    beside: Any = None
    return first_accepted(fit_beside_nothing(white, scheduled), found, beside)


def fit_beside_nothing(white: bool = False, scheduled: bool = True) -> Any:
    """A model without columns."""
    nuisances = SimpleNamespace(items=(), bounded=())
    problem = SimpleNamespace(rows=SimpleNamespace(nuisances=nuisances), baseline=())
    model = Model().having(*([SlopeSchedule(low=5.0, high=10.0, size=0.1)] if scheduled else []))
    source = SimpleNamespace(config=TraceConfig(significance=0.01))
    data, residual = SimpleNamespace(source=source), SimpleNamespace(white=white)
    return SimpleNamespace(problem=problem, model=model, data=data, residual=residual)


def chosen(found: list[Candidate], accepted: str, monkeypatch: pytest.MonkeyPatch, **beside: bool) -> Choice:
    """The choice where the held-out part agrees with `accepted` alone."""

    def tried(fit: Any, one: Candidate, beside: Any) -> Tried:
        return judged(one, 5.0 if one.name == accepted else -1.0, 0.5)

    monkeypatch.setattr(acceptance, "_try", tried)
    return beside_nothing(*found, **beside)


@pytest.mark.parametrize(("name", "accepted"), [("lag", False), ("discovered_1", True)])
def test_a_name_outside_the_family_that_explains_most_is_refused_and_a_description_is_not(
    name: str, accepted: bool
) -> None:
    tried = known(judged(candidate(name, 90.0), 5.0, 0.5), gain=0.0)
    assert tried.accepted
    assert known(tried, may_be_named=False).accepted is accepted


def test_what_is_reported_takes_no_part_in_fit_or_choice() -> None:
    source = Flights((nominal().flight,), TraceConfig())
    data = correct(source, start_model(source))
    parts = [set(part.rows.tolist()) for part in (data.fitted, data.deciding, data.reported)]
    assert sum(map(len, parts)) == len(set.union(*parts))
    assert [round(8.0 * len(rows) / data.whole.rows.size) for rows in parts] == [5, 2, 1]
    tried = judged(candidate("lag", 90.0), 5.0, 0.5)
    assert known(tried, ratios=tried.ratios | dict.fromkeys(PARTS[1:], (np.nan, np.nan))).accepted


def test_beside_noise_nothing_is_added_without_clear_evidence() -> None:
    tried = known(judged(candidate("accel_scale", 90.0), 5.0, 0.5), has_tolerance=True, gain=0.1)
    assert tried.accepted
    assert not known(tried, white=True).accepted
    assert known(tried, white=True, gain=2.0 * SPECIFIC).accepted


def test_a_refused_leader_makes_way_for_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [candidate("lag", 90.0), candidate("trim", 60.0, ACROSS)]
    result = chosen(found, "trim", monkeypatch)
    assert result.accepted is not None
    assert result.accepted.candidate.name == "trim"
    assert [one.name for one in result.reported] == ["trim", "lag"]
    assert [one.candidate.name for one in result.tried if not one.accepted] == ["lag"]


def test_what_explains_far_less_does_not_replace_a_refused_one(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [candidate("lag", 90.0), candidate("trim", 40.0, ACROSS)]
    result = chosen(found, "trim", monkeypatch)
    assert result.accepted is None
    assert result.reported[0].name == "lag"


def test_the_evidence_decides_which_is_tried_next(monkeypatch: pytest.MonkeyPatch) -> None:
    evidences = {"lag": 500.0, "damping": 200.0, "inplane": 100.0, "bias": 5.0}
    gains = {"lag": 85.0, "damping": 70.0, "inplane": 60.0, "bias": 190.0}
    found = [
        known(candidate(name, gains[name], np.eye(4)[k]), evidence=evidences[name]) for k, name in enumerate(evidences)
    ]
    result = chosen(found, "inplane", monkeypatch)
    assert [one.candidate.name for one in result.tried] == ["lag", "damping", "inplane"]
    assert result.accepted is not None


def test_only_what_is_significant_rivals_a_name() -> None:
    """The evidence alone may prefer what explains nothing that the fitted part shows."""
    found = [candidate("lag", 90.0), known(candidate("trim", 80.0, ACROSS), p_value=0.5)]
    choice = Choice(fit_beside_nothing(), tuple(found))
    assert [one.name for one in choice.significant] == ["lag"]


def test_a_few_are_tried_and_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [candidate(f"effect {k}", 90.0 - 4.0 * k, np.eye(6)[k]) for k in range(6)]
    result = chosen(found, "effect 5", monkeypatch)
    assert len(result.tried) == 3
    assert result.accepted is None
    assert result.reported[0].name == "effect 0"


def test_what_is_below_the_detection_limit_is_not_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    assert chosen([known(candidate("trim", 60.0), fall=24.0)], "trim", monkeypatch).tried == ()


def test_confounded_effects_come_right_after_what_is_added(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [candidate("lag", 90.0), candidate("trim", 60.0, ACROSS), candidate("magnus", 59.0, ALONG)]
    result = chosen(found, "trim", monkeypatch)
    assert [one.name for one in result.reported] == ["trim", "magnus", "lag"]


@pytest.mark.parametrize(("ahead", "first"), [(0.9, "inplane"), (-0.9, "inplane"), (-1.1, "discovered_1")])
def test_a_description_has_to_beat_a_name_clearly(ahead: float, first: str, monkeypatch: pytest.MonkeyPatch) -> None:
    named = candidate("inplane", 100.0)
    described = candidate("discovered_1", 100.0 - ahead * SPECIFIC)
    result = chosen([named, described], "none", monkeypatch)
    assert result.ranked[0].name == first


@pytest.mark.parametrize(
    ("of_record", "fell", "ratio", "accepted"),
    [
        (False, 3.0, 0.99, True),
        (False, 3.0, 1.01, False),
        (False, 1.5, 0.5, False),
        (True, 3.0, 1.05, True),
        (True, 3.0, 1.18, True),
        (True, 3.0, 1.22, False),
        (True, 1.5, 0.5, False),
    ],
)
def test_errors_of_the_record_need_not_lower_the_error_of_the_moments(
    of_record: bool, fell: float, ratio: float, accepted: bool
) -> None:
    one = SimpleNamespace(effect=object() if of_record else None)
    assert judged(one, fell, ratio).accepted is accepted


@pytest.mark.parametrize(("p_value", "tried"), [(1e-9, ["lag"]), (1e-4, [])])
def test_where_the_residual_is_white_only_what_is_beyond_doubt_counts(
    monkeypatch: pytest.MonkeyPatch, p_value: float, tried: list[str]
) -> None:
    one = known(candidate("lag", 90.0), p_value=p_value)
    found = chosen([one], "lag", monkeypatch, white=True)
    assert [each.candidate.name for each in found.tried] == tried


@pytest.mark.parametrize(("scheduled", "first"), [(True, "inplane"), (False, "mach_stiffness")])
def test_a_schedule_comes_before_jumps_where_the_model_has_none(
    monkeypatch: pytest.MonkeyPatch, scheduled: bool, first: str
) -> None:
    jumps = candidate("inplane", 90.0, mechanisms=(find("inplane"),))
    schedule = candidate("mach_stiffness", 60.0, ACROSS, mechanisms=(find("mach_stiffness"),))
    found = chosen([jumps, schedule], first, monkeypatch, scheduled=scheduled)
    assert found.ranked[0].name == first


@pytest.mark.parametrize(("ratio", "expected"), [(1.0 + 0.9 * SCATTER, True), (1.0 + 1.1 * SCATTER, False)])
def test_moments_worse_by_less_than_noise_scatters_their_error_are_not_worse(ratio: float, expected: bool) -> None:
    one: Any = SimpleNamespace(effect=object())
    tried = known(judged(one, 8.0, ratio), ratios={"deciding": (ratio, 0.001)}, has_tolerance=True)
    assert tried.accepted is expected


@pytest.mark.parametrize(("gain", "accepted"), [(0.1, True), (-0.9, True), (-1.1, False)])
def test_what_processes_explain_far_better_is_not_accepted(gain: float, accepted: bool) -> None:
    one = known(judged(candidate("lag", 90.0), 5.0, 0.5), gain=SPECIFIC * gain)
    assert one.agrees
    assert one.accepted is accepted
    assert known(one, has_tolerance=True).accepted is (accepted and gain > 0.0)


@pytest.mark.parametrize(
    ("changed", "named_in", "said"),
    [
        ({}, 1.0, ()),
        ({"both": (0.99, 0.1)}, 1.0, ("the held-out error of the moments does not fall significantly",)),
        ({"reported": (1.01, 0.1)}, 1.0, ("the held-out error of the moments does not fall significantly",)),
        ({"elsewhere": 1.2}, 1.0, ("flights that are predicted from the others are predicted worse",)),
        (
            {"gain": SPECIFIC},
            1.0,
            (
                "processes may explain the flight instead: beside them it gains 5.0 in ln evidence, and one of 10 "
                "effects that were tried needs 7.3",
            ),
        ),
        ({"impossible": Excess("lag", 9.0, "eps = 70")}, 1.0, ("its value is impossible: eps = 70",)),
        ({}, 0.7, ("fewer than 75 % of the repetitions name it",)),
    ],
)
def test_what_is_no_finding_says_why(changed: dict[str, Any], named_in: float, said: tuple[str, ...]) -> None:
    one = judged(candidate("lag", 90.0), 5.0, 0.5)
    one = known(one, **({"gain": 2.0 * SPECIFIC, "elsewhere": None, "impossible": None} | changed))
    one = known(one, ratios=one.ratios | {name: changed[name] for name in PARTS if name in changed})
    assert one.doubts(named_in, 10) == said


@pytest.mark.parametrize(
    ("earlier", "gone", "reported"),
    [
        ([], (), False),
        ([("finding", "lag")], (), False),
        ([(None, None)], (), False),
        ([("finding", "lag"), ("hint", "trim")], (), True),
        ([("hint", "trim"), ("finding", "lag")], (), True),
        ([("hint", "trim"), ("finding", "lag")], ("trim",), True),
        ([("hint", "trim")], ("trim",), False),
    ],
)
def test_what_is_found_beside_hints_is_a_hint(
    earlier: list[tuple[Any, str | None]], gone: tuple[str, ...], reported: bool
) -> None:
    """On Opportunity's record a constant body-fixed moment, of a moment that drifts in the body, was a finding."""
    known = [Step.model_construct(status=status, added=name) for status, name in earlier]
    last = Step.model_construct(status="finding", added="magnus", removed=gone)
    steps = beside_hints([*known, last])
    assert steps[-1].doubts == (("it rests on an earlier hint",) if reported else ())
    assert (steps[-1].status == "hint") is reported


def test_what_follows_a_step_that_the_final_model_demotes_is_a_hint() -> None:
    first, second = (Step.model_construct(status="finding", added=name) for name in ("magnus", "trim"))
    gains = {"magnus": 0.4 * SPECIFIC, "trim": 8.0 * SPECIFIC}
    beside: Any = SimpleNamespace(
        terms=gains, gain=gains.__getitem__, is_adequate=lambda _: True, rest_of_family=lambda _: 0.0
    )
    assert [step.status for step in beside_hints(_confirmed([first, second], beside))] == ["hint", "hint"]


def test_a_finding_whose_final_value_is_impossible_is_a_hint() -> None:
    steps = [Step.model_construct(status="finding", added=name) for name in ("lag", "trim")]
    gains = dict.fromkeys(("lag", "trim"), 8.0 * SPECIFIC)
    beside: Any = SimpleNamespace(
        terms=gains, gain=gains.__getitem__, is_adequate=lambda _: True, rest_of_family=lambda _: 0.0
    )
    found = _confirmed(steps, beside, Excess("trim", 9.0, "C_m0 = 70"))
    assert [step.doubts for step in found] == [(), ("its final value is impossible: C_m0 = 70",)]


@dataclass(frozen=True)
class Again:
    """In place of the evidence beside all processes: in each repetition its `rows` say what an effect gains."""

    rows: dict[str, float]

    def gain_of(self, fit: Any) -> float:
        return self.rows[fit.name]


@pytest.mark.parametrize("offered", [("lag",), ("lag", "trim")])
def test_a_repetition_names_what_leads_it_and_is_wanted_there(
    offered: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that alone is significant is repeated too."""
    gains = [{"lag": 30.0, "trim": 20.0}, {"lag": 30.0, "trim": 40.0}, {"lag": -30.0, "trim": -40.0}]
    monkeypatch.setattr(acceptance, "_with_other_blocks", lambda *_: gains)
    monkeypatch.setattr(acceptance, "_with_other_knots", lambda *_: ())
    candidates, beside, fit = [candidate(name, 90.0) for name in offered], Again({}), fit_beside_nothing()
    named = [*named_again(cast(Any, beside), candidates, candidates[0], fit)]
    assert named == [True, len(offered) == 1, False]


def test_what_few_repetitions_name_is_not_accepted(monkeypatch: pytest.MonkeyPatch) -> None:
    """It predicts more with these blocks and knots alone: so a second was added on one of 251 flights."""
    result = chosen([candidate("lag", 90.0), candidate("trim", 60.0, ACROSS)], "trim", monkeypatch)
    for share in (0.0, 0.4):
        unnamed = replace(result, named_in=share)
        assert unnamed.accepted is None
        assert unnamed.leading is result.tried[0]
    for share in (None, 0.5, 1.0):
        assert replace(result, named_in=share).accepted is result.tried[-1]
