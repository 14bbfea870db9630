"""Nothing is cut in the terminal, at whatever width."""

from __future__ import annotations

import io

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.console import Console

from brv_hypo.comparison.intervals import collinear_groups, estimate
from brv_hypo.comparison.result import DerivedEstimate, ReconstructionSummary
from brv_hypo.inference.derivatives import Derivative
from brv_hypo.report.document import Document, Table, Texts, flat
from brv_hypo.report.tables import (
    collinear_names,
    derived_texts,
    function_blocks,
    motion_known,
    ranking_table,
    term_table,
    vehicle_blocks,
)
from brv_hypo.report.terminal import FittingTable, terminal_view
from brv_hypo.report.trace import outcome_text, trace_document
from brv_hypo.tracing.result import Account, Errors, Step
from tests.chains import compared_nominal, traced_trim

WORDS = ("mechanism", "kind", "term")
WORD = st.text("abc_", min_size=1, max_size=30)
NUMBER = st.integers(0, 10**8).map(str)


def printed(renderable, width: int) -> str:
    console = Console(width=width, file=io.StringIO(), highlight=False, markup=False)
    console.print(renderable)
    return console.file.getvalue()


@st.composite
def tables(draw) -> Table:
    count = draw(st.integers(2, 9))
    headings = draw(st.permutations([*WORDS, *(f"n{i}" for i in range(7))]))[:count]
    rows = [{h: draw(WORD if h in WORDS else NUMBER) for h in headings} for _ in range(draw(st.integers(1, 4)))]
    return Table(rows, words=WORDS)


@settings(suppress_health_check=[HealthCheck.too_slow])  # drawing rows is slow on a busy machine
@given(tables(), st.integers(60, 120))
def test_a_table_fits_and_has_every_character(table, width) -> None:
    text = printed(FittingTable(table), width)
    assert max(cell_len(line) for line in text.splitlines()) <= width
    assert "…" not in text
    for row in table.rows:
        for heading, cell in row.items():
            if heading not in WORDS:
                assert cell in text
    letters = sum(len(cell) for row in table.rows for h, cell in row.items() if h in WORDS)
    body = "".join(line for line in text.splitlines() if not any(name in line for name in (*WORDS, "─")))
    if table.headings[0] not in WORDS:  # a first column of words is repeated where the table goes on below itself
        assert sum(body.count(letter) for letter in "abc_") == letters


def test_names_are_not_folded_where_closer_columns_do() -> None:
    headings = ("rank", "mechanism", *(f"n{i}" for i in range(6)))
    row = dict(zip(headings, ("1", "uneven_ablation", *["1.2345e+06"] * 6), strict=True))
    table = Table([row], words=WORDS)
    text = printed(FittingTable(table), 4 + 1 + 15 + 6 * 11)
    assert "uneven_ablation" in text
    assert len(text.splitlines()) == 3


def test_a_ranking_of_long_names_fits_80_columns_unfolded() -> None:
    comparison = compared_nominal()
    row = comparison.ranking[0].model_copy(update={"mechanism": "ablation_by_file", "f_ratio": 1.07e6, "cp": 1.07e6})
    table = ranking_table(comparison.model_copy(update={"ranking": (row,)}))
    lines = printed(FittingTable(table), 80).splitlines()
    assert len(lines) == 4
    assert "ablation_by_file" in lines[2]
    assert "other" in lines[3]


def test_names_of_discovered_effects_have_four_digits() -> None:
    term = compared_nominal().baseline.terms[0].model_copy(update={"name": "turns at -0.316672539482 rad/s, body_y"})
    (row,) = term_table("", [term]).rows
    assert row["term"] == "turns at -0.3167 rad/s, body_y"


@pytest.mark.parametrize(("verbose", "rows"), [(False, 2), (True, 5)])
def test_details_are_shown_with_verbose_alone(verbose, rows) -> None:
    table = Table([{"n1": f"row {i}"} for i in range(5)], most=2)
    blocks = (table, Texts(("every detail",), shown="verbose"), Texts(("for the page",), shown="page"))
    text = printed(terminal_view(Document("t", ("record",), "Verdict", "words", True, blocks), verbose=verbose), 80)
    assert text.count("row ") == rows
    assert ("and 3 more: add -v" in text) != verbose
    assert ("every detail" in text) == verbose
    assert "for the page" not in text


def test_warnings_follow_the_conclusion() -> None:
    blocks = (Texts(("mind this",), "Warnings", warning=True), Texts(("and so",), bullets=False))
    text = printed(terminal_view(Document("t", (), "Verdict", "words", False, blocks)), 80)
    assert text.index("and so") < text.index("words") < text.index("mind this")


@pytest.mark.parametrize(
    ("named_in", "refused", "words"),
    [
        (None, (), "added nothing; error"),
        (None, ("lag", "trim"), "added nothing (lag, trim did not lower the held-out error); error"),
        (
            0.0,
            ("lag", "trim"),
            "added nothing (lag did not lower the held-out error; few repetitions name trim); error",
        ),
    ],
)
def test_a_step_says_why_it_added_nothing(named_in, refused, words) -> None:
    errors = Errors(fit=1e-8, held_out=2e-8)
    step = Step.model_construct(added=None, named_in=named_in, refused=refused, error_before=errors, error_after=errors)
    assert outcome_text(step).startswith(words)


def test_coefficients_that_are_nearly_collinear_are_marked_and_named() -> None:
    covariance = np.array([[1.0, 0.95, 0.0], [0.95, 1.0, 0.0], [0.0, 0.0, 1.0]])
    groups = collinear_groups(["C_m0 at 2.00 s", "C_malpha at 2.00 s", "C_mq"], covariance)
    assert groups == (("C_m0 at 2.00 s", "C_malpha at 2.00 s"),)
    terms = [estimate(name, "lag", 1.0, 0.1, "1", channel="both") for name in ("C_m0", "C_malpha", "C_mq")]
    terms[:2] = [term.model_copy(update={"region_s": (2.0, 3.0)}) for term in terms[:2]]
    marked = [row["value"].endswith("*") for row in term_table("", terms, collinear=groups).rows]
    assert marked == [True, True, False]
    assert collinear_names(groups)[0] == "* C_m0 at 2.00 s, C_malpha at 2.00 s are nearly collinear."


def test_a_function_is_marked_where_it_is_collinear_and_in_parentheses_where_it_is_extrapolated() -> None:
    known = Derivative(
        flight=0,
        time_s=(1.0, 2.0),
        mach=(3.0, 2.0),
        alpha_rad=(0.05, 0.05),
        at_zero=(-0.1, -0.2),
        at_zero_std_error=(0.01, 0.01),
        at_flown=(-0.3, -0.4),
        at_flown_std_error=(0.01, 0.01),
        alpha_ends_rad=((0.0, 0.05), (0.04, 0.05)),
        collinear_with={"two_lobes": (0.5, 0.95)},
    )
    flown, said, zero = function_blocks({"C_mq": [known]})
    assert flown.heading == "At the angle of attack flown (model, its C_damping in C_mq, and processes)"
    assert [row["C_mq"] for row in flown.rows] == ["-0.300 ± 0.01", "-0.400 ± 0.01*"]
    assert [row["C_mq"] for row in zero.rows] == ["-0.100 ± 0.01", "(-0.200)"]
    assert said.texts[0] == "* C_mq is nearly collinear with two_lobes (correlation up to 0.95) at 2 s."


def test_the_first_models_of_an_account_are_explained() -> None:
    account = tuple(Account(model=n, held_out=v, std_error=0.1) for n, v in (("constant", 2.0), ("scheduled", 1.0)))
    blocks = trace_document(traced_trim().model_copy(update={"account": account})).beside
    (said,) = (each.texts[0] for each in blocks if isinstance(each, Texts) and each.texts and "sigma" in each.texts[0])
    assert "scheduled: static slope by Mach number" in said
    assert "constant: a constant slope" in said


def test_a_result_says_which_motion_it_is_about_and_how_far_that_is_from_the_instruments_own() -> None:
    known = ReconstructionSummary(
        method="joint", alpha_rms_sigma_rad=0.02, phi_w_rms_sigma_rad=0.2, moved_rad=np.radians(1.1)
    )
    assert motion_known(known).startswith("motion of the instruments alone (joint method), known to 1.1 deg in alpha,")
    assert motion_known(known, "lag").startswith("motion about lag (joint method)")
    assert "its distance from reconstruct's, 1.1 deg, included" in motion_known(known, "lag")
    traced = traced_trim()
    assert trace_document(traced).subtitle[-1] == motion_known(traced.reconstruction, "the final model")
    assert 0.0 < traced.reconstruction.moved_rad < traced.reconstruction.alpha_rms_sigma_rad


def test_what_is_described_in_generic_terms_is_described_in_words() -> None:
    traced = traced_trim()
    update = {"effect": "discovered_1", "kind": "discovered", "description": "a moment that turns"}
    candidate = traced.steps[0].candidates[0].model_copy(update=update)
    steps = (traced.steps[0].model_copy(update={"candidates": (candidate,)}), *traced.steps[1:])
    texts = flat(trace_document(traced.model_copy(update={"steps": steps})).blocks)
    assert any(isinstance(each, Texts) and "discovered_1: a moment that turns." in each.texts for each in texts)


def test_the_vehicle_is_listed_with_what_is_known_of_it() -> None:
    table, said = vehicle_blocks(compared_nominal().flights)
    assert [row["quantity"] for row in table.rows] == ["mass", "ixx", "iyy", "reference length", "reference area"]
    assert table.rows[2]["tolerance"] != "–"
    assert "is assumed, so is their scale" in said.texts[0]


def test_a_time_that_is_not_determined_is_said_to_be_so() -> None:
    """An angle has the digits of its error in degrees too; a coefficient of nought is one."""
    found = (("lag delay", 0.01, 19.0, "s"), ("threshold", 0.017412, 6.3e-5, "rad"), ("C_b", 1e-5, 0.014, "1"))
    derived = [DerivedEstimate(name=n, value=v, std_error=e, units=u) for n, v, e, u in found]
    assert derived_texts(derived) == [
        "lag delay = undetermined, ± 19 s",
        "threshold = 0.017412 ± 6.3×10⁻⁵ rad (0.9976 ± 0.0036 deg)",
        "C_b = 0 ± 0.014",
    ]
