"""A graded verdict: what the leader explains, and the processes beside it, in terminal, page and Python."""

from __future__ import annotations

import io

import numpy as np
import pytest
from rich.cells import cell_len
from rich.console import Console

from brv_hypo import plot_compare
from brv_hypo.comparison import Comparison
from brv_hypo.comparison.diagnostics import events_unreached
from brv_hypo.comparison.result import (
    LEAST_PROCESS,
    MEAN_SQUARES,
    OTHER,
    QUOTED,
    DerivedEstimate,
    Explained,
    Knot,
    MaximumLikelihood,
    MechanismLimit,
    NetInterval,
    ProcessEstimate,
    RecordError,
    TermEstimate,
    beyond_text,
    beyond_tolerances,
    within_text,
)
from brv_hypo.comparison.verdict import with_prediction_error
from brv_hypo.docs import text
from brv_hypo.docs.manual import generated
from brv_hypo.flight.record import RecordFault, RecordTrial
from brv_hypo.io.text import hypothesis, number, probability
from brv_hypo.linearisation.nuisance import BEYOND_CHANCE, beyond_level
from brv_hypo.mechanisms.registry import moment_processes, record_processes
from brv_hypo.report.comparison import comparison_document
from brv_hypo.report.document import Bars, Table, Texts, flat
from brv_hypo.report.html import page
from brv_hypo.report.tables import (
    RISING,
    estimate_blocks,
    flight_texts,
    gap_table,
    knot_table,
    limit_blocks,
    ranking_table,
    term_table,
)
from brv_hypo.report.terminal import terminal_view
from tests.chains import compared_nominal, compared_sticking

NAN = float("nan")
EXPLAINED = Explained(share=0.87, unexplained=0.13, interval_95=(0.81, 0.92), processes=0.09, noise=0.04)
ADEQUACY_AND_STABILITY = (
    "The leader's residual is 0.90 times the noise (rms); 100 % of the repetitions give the same answer."
)
SENTENCE = "Of the residual of the baseline: damping 87 % (81 to 92 %), processes 9 %, noise 4 %. " + MEAN_SQUARES
MOMENT = 0.0412


def process(name: str, family: str, size: float, units: str, share: float, tolerance: float) -> ProcessEstimate:
    return ProcessEstimate(
        name=name,
        family=family,
        size=size,
        std_error=0.15 * size,
        units=units,
        share_of_moment=share,
        tolerance=tolerance,
    )


PROCESSES = (
    process("static_change", "stiffness", 0.051 * MOMENT, "1", 0.049, 0.01 * MOMENT),
    process("body_change", "body", 0.024 * MOMENT, "1", 0.023, 0.01 * MOMENT),
    process("turbulence", "air", 1.43, "m/s", 0.016, 0.1),
    process("density_change", "air", 0.0061, "1", 0.012, 0.002),
    process("cross_damping_change", "rate", 0.0081 * MOMENT, "1", 0.0079, 0.01 * MOMENT),
    process("accel_drift", "accelerometers", 0.0212, "m/s^2", 0.0031, 0.005),
    process("gyro_drift", "gyros", 3.1e-4, "rad/s", 0.0021, 8.7e-5),
    process("side_change", "side", 0.0009 * MOMENT, "1", 0.0009, 0.01 * MOMENT),
)


def graded(winner: str | None = "damping", explained: Explained | None = EXPLAINED, **verdict: object) -> Comparison:
    """A comparison in which `damping` is ranked first, 12.34 nats above the baseline only."""
    comparison = compared_nominal()
    known = {"damping": 12.34, "none": 0.0}
    rows = sorted(comparison.ranking, key=lambda row: -known[row.mechanism])
    ranking = [
        row.model_copy(update={"rank": rank, "log_evidence": known[row.mechanism]})
        for rank, row in enumerate(rows, start=1)
    ]
    new = {"winner": winner, "outcome": "named" if winner else "none adequate", "reason": "One sentence."}
    chances = {"damping": 0.95, "none": 0.03, "other": 0.02}
    new |= {
        "equivalent": (winner,) if winner else (),
        "probability": chances,
        "explained": explained,
        "processes": PROCESSES,
        **verdict,
    }
    return comparison.model_copy(
        update={"ranking": tuple(ranking), "verdict": comparison.verdict.model_copy(update=new)}
    )


def printed(comparison: Comparison, *, verbose: bool = False) -> str:
    console = Console(width=80, file=io.StringIO(), highlight=False, markup=False)
    console.print(terminal_view(comparison_document(comparison), verbose=verbose))
    return console.file.getvalue()


def line_of(text: str, name: str) -> list[str]:
    (line,) = (line for line in text.splitlines() if line.startswith(name))
    return line.split()


class TestTerminal:
    def test_what_the_leader_explains_follows_the_sentence_of_the_verdict(self) -> None:
        shown = printed(graded())
        inside = " ".join(shown.replace("│", " ").split())
        assert f"One sentence. {SENTENCE}" in inside
        assert shown.index("One sentence.") < shown.index("Of the residual") < shown.index("Processes beside damping")

    def test_four_processes_are_shown_in_80_columns_and_the_others_with_verbose(self) -> None:
        short, whole = printed(graded()), printed(graded(), verbose=True)
        assert max(cell_len(line) for line in short.splitlines()) <= 80
        assert "and 3 more: add -v" in short
        assert f"Estimated below 0.1 % of the moment: {PROCESSES[-1].name}." in whole
        assert PROCESSES[-1].share_of_moment <= LEAST_PROCESS
        for each in PROCESSES[:3]:
            assert line_of(short, each.name) == line_of(whole, each.name)
        assert "gyro_drift" not in short

    def test_a_star_is_explained_where_a_row_that_is_shown_has_one(self) -> None:
        value = graded().ranking[0].terms[0].model_copy(update={"value": 1.0, "std_error": 0.1, "region_s": (0.0, 1.0)})
        values = [value.model_copy(update={"name": f"term_{k}"}) for k in range(6)]
        for pair, short in ((("term_0", "term_5"), True), (("term_4", "term_5"), False)):
            interval = NetInterval(start_s=0.0, stop_s=1.0, values=values, collinear_groups=(pair,))
            row = graded().ranking[0].model_copy(update={"intervals": (interval,)})
            named = graded().model_copy(update={"ranking": (row, *graded().ranking[1:])})
            assert ("are nearly collinear" in printed(named)) == short
            assert "are nearly collinear" in printed(named, verbose=True)

    def test_values_beyond_two_standard_errors_are_in_time_order_and_others_with_verbose(self) -> None:
        value = graded().ranking[0].terms[0].model_copy(update={"std_error": 0.1, "region_s": (0.0, 1.0)})
        sizes = ({"first": 0.5, "less": 0.01}, {"second": 1.0, "small": 0.1})
        intervals = []
        for begin, some in enumerate(sizes):
            region = (float(begin), begin + 1.0)
            values = [value.model_copy(update={"name": n, "value": x, "region_s": region}) for n, x in some.items()]
            intervals.append(NetInterval(start_s=region[0], stop_s=region[1], values=values))
        row = graded().ranking[0].model_copy(update={"intervals": intervals})
        shown = graded().model_copy(update={"ranking": (row, *graded().ranking[1:])})
        table, *_ = estimate_blocks(shown)
        assert [each["term"] for each in table.rows] == ["first", "second"]
        said = "2 further values within two sigma: see the terms of damping."
        assert [said in " ".join(printed(shown, verbose=verbose).split()) for verbose in (False, True)] == [False, True]
        assert "small" in printed(shown, verbose=True)

    def test_a_value_that_rises_is_said_to_be_a_mean(self) -> None:
        for name, said in (("ramp in C", True), ("jump in C", False)):
            term = graded().ranking[0].terms[0].model_copy(update={"name": name, "value": 1.0, "std_error": 0.1})
            net = term.model_copy(update={"name": "C", "region_s": (0.0, 1.0)})
            interval = NetInterval(start_s=0.0, stop_s=1.0, values=(net,))
            row = graded().ranking[0].model_copy(update={"terms": (term,), "intervals": (interval,)})
            shown = graded().model_copy(update={"ranking": (row, *graded().ranking[1:])})
            assert (RISING in " ".join(printed(shown).split())) == said

    @pytest.mark.parametrize(("outcome", "winner"), [("named", "damping"), ("named", "none"), ("undecided", None)])
    def test_limits_are_on_the_first_screen_whatever_is_named(self, outcome: str, winner: str | None) -> None:
        """Of the moment's rms, as a moment coefficient and in N m; they are no sign of a mechanism."""
        large = MechanismLimit(mechanism="inplane", share_of_moment_95=1.9, coefficient_95=1.9 * MOMENT)
        damping = {"share_of_moment_95": 0.02, "share_in_part_95": 0.01, "coefficient_95": 0.02 * MOMENT}
        limit = MechanismLimit(mechanism="damping", **damping)
        shown = printed(graded(winner, outcome=outcome, limits=(large, limit, MechanismLimit(mechanism="lag"))))
        begin = shown.index("Upper limits at 95 %: what may hide beside leader, trim and baseline")
        cells = line_of(shown[begin:], "damping")
        assert [each for each in cells if each != "(leader)"][:6] == ["damping", "2", "%", "1", "%", "0.00082"]
        assert begin < shown.index("damping ", begin) < shown.index("inplane ", begin)
        said = " ".join(shown.split())
        assert "Above 100 %: nothing that is smaller than the whole moment is excluded." in said
        assert "Withheld for lag: the record says nothing of their size." in said
        assert max(map(cell_len, shown.splitlines())) <= 80
        assert len(shown.splitlines()) <= 46

    def test_a_limit_in_a_part_is_drawn_beside_that_throughout(self) -> None:
        """A long bar of what hides in trim and baseline read as a larger cause than the leader."""
        parts = {"share_of_moment_95": 0.59, "share_in_part_95": 0.011}
        hides, leads = (
            MechanismLimit(mechanism="bodyfixed", **parts),
            MechanismLimit(mechanism="damping", share_of_moment_95=0.18),
        )
        (chart,) = (c for c in comparison_document(graded(limits=(hides, leads))).charts if c.name == "limits")
        bars = [layer for layer in chart.panels[0].layers if isinstance(layer, Bars)]
        assert [(*bar.names, bar.role) for bar in bars] == [
            ("damping (leader)", "first"),
            ("bodyfixed, throughout", "third"),
            ("bodyfixed, in a part", "third"),
        ]
        assert [*bars[2].values] == pytest.approx([1.1])

    def test_what_is_credible_has_a_mark_without_bold_too(self) -> None:
        lines = printed(graded("damping")).splitlines()
        assert next(line for line in lines if line.split()[:2] == ["1", "damping"]).endswith(" •")
        assert not any(line.endswith("•") for line in lines if line.split()[:2] == ["2", "lag"])

    def test_a_limit_is_a_moment_at_the_pressure_of_the_record(self) -> None:
        comparison = compared_sticking()
        each = comparison.verdict.limits[0]
        table, *_, texts = limit_blocks(comparison)
        (row,) = (row for row in table.rows if row["mechanism"].removesuffix(" (leader)") == each.mechanism)
        vehicle, pressure = comparison.flights[0].vehicle, np.array(comparison.series[0].dynamic_pressure_pa)
        scale = np.sqrt(np.mean(pressure**2)) * vehicle["reference_area"] * vehicle["reference_length"]
        assert row["N m, rms"] == number(each.coefficient_95 * scale, 2)
        assert "N m: at the rms dynamic pressure" in texts.texts[0]

    def test_a_process_has_its_size_with_error_and_unit_and_its_multiple_of_an_ordinary_size(self) -> None:
        shown = printed(graded())
        assert line_of(shown, "turbulence") == ["turbulence", "air", "1.6", "%", "1.43", "0.21", "m/s", "14", "×"]
        assert line_of(shown, "static_change")[2:4] + line_of(shown, "static_change")[-2:] == ["4.9", "%", "5.1", "×"]

    def test_a_process_below_its_sigma_is_in_parentheses_after_the_others_and_with_verbose(self) -> None:
        doubtful = process("flow", "body", 0.09 * MOMENT, "1", 0.09, 0.01 * MOMENT)
        doubtful = doubtful.model_copy(update={"std_error": 1.2 * doubtful.size})
        found = graded(processes=(doubtful, *PROCESSES[:2]))
        assert "(9 %)" not in printed(found)
        assert line_of(printed(found, verbose=True), "flow")[2:5] == ["(9", "%)", "(0.0037)"]
        assert "(9 %)" in printed(graded(processes=(doubtful,)))

    def test_a_process_of_a_plugin_is_named_beside_one_of_the_same_drift(self) -> None:
        """A drift of the gyros may be taken for theirs in general."""
        own = process("gyro_warming", "gyros", 1e-6, "rad/s", 1e-5, 8.7e-5)
        said = " ".join(printed(graded(processes=(*PROCESSES, own))).split())
        assert "gyro_drift and gyro_warming may be one drift (gyros): the data may give it to either." in said
        assert "may be one drift" not in printed(graded())

    def test_that_no_process_is_large_is_said(self) -> None:
        shown = " ".join(printed(graded(processes=PROCESSES[-1:])).split())
        assert "in all hypotheses) makes over 0.1 % of the moment." in shown
        assert "Processes beside" not in shown

    def test_a_verdict_of_an_earlier_version_has_neither(self) -> None:
        shown = printed(graded(explained=None, processes=()))
        assert "rocess" not in shown.replace("no processes", "")
        assert "explains" not in shown

    def test_the_ranking_has_the_evidence_in_the_order_of_the_ranks(self) -> None:
        rows = ranking_table(graded()).rows
        assert [(row["rank"], row["mechanism"], row["ln evidence"]) for row in rows] == [
            ("1", "damping", "12.3"),
            ("2", "baseline only", "0.0"),
            ("–", "other", "–"),
        ]
        assert rows[-1]["prob."] == probability(graded().verdict.probability[OTHER])
        unknown = graded().ranking[0].model_copy(update={"log_evidence": NAN})
        row, _ = ranking_table(graded().model_copy(update={"ranking": (unknown,)})).rows
        assert row["ln evidence"] == "–"


class TestPage:
    def test_the_verdict_is_followed_by_the_ranking_and_processes_and_then_the_contents(self) -> None:
        html = page(comparison_document(graded()))
        said = (
            f"<strong>Verdict: damping</strong>\nOne sentence.\n{SENTENCE}",
            '<th scope="col">rank</th>',
            ">Processes beside",
            ">Data quality</a>",
        )
        places = [html.index(text) for text in said]
        assert places == sorted(places)
        assert "A process is a smooth change that nobody has modelled" in html
        assert "ln evidence: ln of the record&#39;s probability density" in html

    def test_limits_that_are_withheld_are_not_drawn_and_the_page_says_why(self) -> None:
        withheld = graded(None, limits=(MechanismLimit(mechanism="damping", share_of_moment_95=NAN),))
        assert "limits" not in {chart.name for chart in comparison_document(withheld).charts}
        assert "Limits are withheld: no hypothesis that was compared is adequate." in page(
            comparison_document(withheld)
        )
        document = comparison_document(graded())
        assert "limits" in {chart.name for chart in document.charts}
        texts = [text for block in flat(document.blocks) if isinstance(block, Texts) for text in block.texts]
        assert not any(text.startswith("Withheld") for text in texts)


class TestPython:
    def test_the_headline_says_how_much_the_named_mechanism_explains(self) -> None:
        assert repr(graded()) == "<Comparison: 1 flight, 2 hypotheses: named damping (explains 87 %)>"
        assert "named damping (explains 87 %)" in graded()._repr_html_()
        assert SENTENCE in graded()._repr_html_()

    @pytest.mark.parametrize(("share", "words"), [(0.9969, "99.69 %"), (0.0042, "0.42 %"), (0.5, "50 %")])
    def test_a_share_near_nothing_or_all_is_not_rounded_to_it(self, share, words) -> None:
        rest = {"unexplained": 1.0 - share, "processes": 1.0 - share, "noise": 0.0}
        explained = Explained(share=share, interval_95=(share, share), **rest)
        assert f"explains {words}" in graded(explained=explained).headline()

    def test_shares_have_one_number_of_digits_and_a_sum_of_100(self) -> None:
        rest = {"unexplained": 0.0154, "processes": 0.0152, "noise": 0.0002}
        for ends, words in (
            ((0.96, 1.0), "98 % (96 to 100 %), processes 2 %, noise <1 %"),
            ((0.98, 0.989), "98.46 % (98.00 to 98.90 %), processes 1.52 %, noise 0.02 %"),
        ):
            found = graded(explained=Explained(share=0.9846, interval_95=ends, **rest))
            assert f"damping {words}." in found.conclusion()
        thirds = Explained(share=1 / 3, interval_95=(0.3, 0.4), unexplained=2 / 3, processes=1 / 3, noise=1 / 3)
        assert "damping 34 % (30 to 40 %), processes 33 %, noise 33 %." in graded(explained=thirds).conclusion()

    def test_baseline_only_explains_nothing_of_its_own_residual(self) -> None:
        rest = {"unexplained": 1.0, "processes": 0.02, "noise": 0.98}
        named = graded("none", Explained(share=0.0, interval_95=(0.0, 0.0), **rest))
        empty = named.model_copy(update={"ranking": named.ranking[::-1]})
        assert empty.headline().endswith("named baseline only")
        said = "Of the residual of the baseline: processes 2 %, noise 98 %."
        assert empty.conclusion() == f"One sentence.\n{said}\n{ADEQUACY_AND_STABILITY}"

    def test_a_leader_that_is_not_named_explains_its_share_all_the_same(self) -> None:
        assert "explains" not in graded(None).headline()
        stable = ADEQUACY_AND_STABILITY.replace("give the same answer", "find none adequate either")
        assert graded(None).conclusion() == f"One sentence.\n{SENTENCE}\n{stable}"

    def test_gaps_are_part_of_the_answer_and_of_the_quality_of_the_data(self) -> None:
        found = graded()
        flight = found.flights[0].model_copy(update={"start_s": 0.0, "stop_s": 6.0, "gaps_s": ((1.0, 1.2), (3.0, 3.4))})
        errors = [
            RecordError(name=name, value=value, std_error=0.1, units="rad", tolerance=1.0)
            for name, value in (("gap_turn x 1", 0.5), ("gap_turn y 2", 0.2), ("gap_turn z 2", -0.9))
        ]
        cut = found.model_copy(update={"flights": (flight,), "record_errors": tuple(errors)})
        said = "2 gaps, 0.6 s or 10 % in all, the longest 0.4 s from 3 s: errors include what the vehicle may have done"
        assert said in cut.conclusion()
        assert "dated to within" not in cut.conclusion()
        assert [list(row.values()) for row in gap_table(cut).rows] == [
            ["1.00–1.20", "gap_turn x 1", "0.5 rad", "0.50"],
            ["3.00–3.40", "gap_turn z 2", "-0.9 rad", "-0.90"],
        ]
        assert "gap" not in found.conclusion()

    def test_a_change_in_a_gap_is_said_to_be_dated_to_within_it(self) -> None:
        found = compared_sticking()
        flight = found.flights[0].model_copy(update={"gaps_s": ((0.95, 1.05),)})
        assert (
            "a change of the leader is dated to within one"
            in found.model_copy(update={"flights": (flight,)}).conclusion()
        )

    def test_processes_beside_every_hypothesis_are_listed(self) -> None:
        """Those that make up for a mechanism which is not in the hypothesis are large."""
        found = compared_sticking()
        leader, baseline = found.ranking
        shown = {e.name: e.share_of_moment for e in found.verdict.processes if e.is_shown and e.size > e.std_error}
        assert leader.process_shares == shown
        assert max(baseline.process_shares.values()) > 10.0 * max(shown.values(), default=0.0)
        listed = printed(found, verbose=True).partition(
            "Processes beside each hypothesis: all, listed above their sigma"
        )[2]
        assert next(iter(baseline.process_shares)) in listed

    def test_processes_and_noise_are_listed_separately_where_they_are_known(self) -> None:
        known = EXPLAINED.model_copy(update={"processes": 0.13 - 3e-5, "noise": 3e-5})
        assert f"(81 to 92 %), processes 13 %, noise <1 %. {MEAN_SQUARES}" in graded(explained=known).conclusion()

    def test_when_a_named_mechanism_acts_is_part_of_the_answer(self) -> None:
        """Where a coefficient, not a direction, is more than two standard errors; only where it is named."""
        term = TermEstimate(
            name="C", mechanism="damping", channel="in-plane", value=1.0, std_error=0.1, f_ratio=100.0, units="1"
        )
        small = term.model_copy(update={"value": 0.1})
        direction = term.model_copy(update={"name": "phi", "value": 2.0, "units": "rad"})
        ends = [(1.0, 2.0, small), (2.0, 3.0, term), (3.0, 4.5, term), (4.5, 6.0, small)]
        intervals = tuple(NetInterval(start_s=a, stop_s=b, values=(value, direction)) for a, b, value in ends)
        for winner, said in (
            ("damping", "One sentence. damping acts from 2 to 4.5 s (Mach "),
            (None, "One sentence.\n"),
        ):
            found = graded(winner)
            row = found.ranking[0].model_copy(update={"intervals": intervals})
            assert found.model_copy(update={"ranking": (row,)}).conclusion().startswith(said)

    def test_a_gradual_end_is_dated_by_its_middle_as_its_knot_is(self) -> None:
        about = {"channel": "in-plane", "f_ratio": 100.0, "units": "1", "std_error": 0.1}
        term = TermEstimate(name="C", mechanism="damping", value=1.0, **about)
        ends = [(1.0, 2.0, 0.0), (2.0, 3.4, 1.0), (3.4, 4.0, 0.1), (4.0, 6.0, 0.0)]
        nets = [(a, b, term.model_copy(update={"value": value})) for a, b, value in ends]
        intervals = tuple(NetInterval(start_s=a, stop_s=b, values=(net,)) for a, b, net in nets)
        derived = tuple(
            DerivedEstimate(name=f"damping {name}", value=value, std_error=0.1, units="s")
            for name, value in (("knot", 2.0), ("knot", 3.7), ("onset width", 0.6))
        )
        row = graded("damping").ranking[0].model_copy(update={"intervals": intervals, "derived": derived})
        found = graded("damping").model_copy(update={"ranking": (row,)})
        assert "damping acts from 2 to 3.7 s" in found.conclusion()
        assert [each["change"] for each in knot_table(found, row).rows] == ["onset", "end"]

    @pytest.mark.parametrize(
        ("value", "said"),
        [
            (-7.35, "which adds damping: C_mq is -8.35 with it"),
            (0.42, "which takes damping away: C_mq is -0.585 with it"),
        ],
    )
    def test_the_size_of_one_coefficient_is_part_of_the_answer(self, value: float, said: str) -> None:
        """And whether a damping moment takes energy out of the motion, whatever its mechanism is called."""
        about = {"channel": "in-plane", "f_ratio": 100.0, "units": "1", "std_error": 0.1}
        term = TermEstimate(name="C_damping", mechanism="damping", value=value, **about)
        nothing = term.model_copy(update={"value": 0.0})
        ends = [(1.0, 2.0, nothing), (2.0, 3.0, term), (3.0, 6.0, nothing)]
        intervals = tuple(NetInterval(start_s=a, stop_s=b, values=(net,)) for a, b, net in ends)
        size = {"share_of_moment": 0.2, "share_std_error": 0.01}
        row = graded("damping").ranking[0].model_copy(update={"intervals": intervals, **size})
        first = graded("damping").model_copy(update={"ranking": (row,)}).conclusion().splitlines()[0]
        assert f" C_damping is {value} ± 0.1, {said}, -1 without. Its rms moment is " in first
        assert ", 20" in first
        unknown = row.model_copy(update={"share_std_error": 0.3})
        assert unknown.size == "Its own moment is not known: processes, or its parts, may cancel it."

    def test_errors_beyond_tolerances_are_part_of_the_answer(self) -> None:
        """A trim of 14 tolerances is, what is within its tolerance is not; also where nothing is adequate."""
        sizes = {"trim C_m0": 1e-3, "gyro_bias p": 1e-5}
        errors = tuple(
            RecordError(name=name, value=-value, std_error=1e-6, units="1", tolerance=7e-5)
            for name, value in sizes.items()
        )
        update = {"record_errors": errors, "warnings": (beyond_text(errors, "damping"),)}
        named = graded().model_copy(update=update)
        said = "Beside damping and processes, errors are beyond their tolerances (--instruments): "
        said += "trim C_m0 is -0.001, 14.3 times its tolerance."
        assert named.conclusion() == f"One sentence.\n{SENTENCE}\n{ADEQUACY_AND_STABILITY}\n{said}"
        assert " ".join(printed(named).split()).count("errors are beyond their tolerances") == 1
        inadequate = graded(None).model_copy(update=update)
        assert "(--instruments), which may be what the hypotheses lack: trim C_m0" in inadequate.conclusion()
        assert beyond_text(errors, "damping", "none adequate") in inadequate.conclusion()

    def test_estimates_within_tolerances_are_said_where_they_are_sure(self) -> None:
        """A planted trim of half a tolerance was in JSON alone; what chance makes of so many is not said."""
        known = {"trim C_m0": (4e-5, 2e-6), "gyro_bias p": (3e-5, 2e-5), "trim C_n0": (1e-3, 2e-6)}
        errors = tuple(
            RecordError(name=name, value=value, std_error=error, units="1", tolerance=7e-5)
            for name, (value, error) in known.items()
        )
        said = "Errors of the record, significant and within 2.9 tolerances, the bound of so many: trim C_m0 "
        said += "4.00×10⁻⁵ ± 2.0×10⁻⁶."
        assert within_text(errors) == said
        assert within_text(errors[1:]) == ""

    def test_trouble_of_the_maximum_likelihood_is_part_of_the_answer(self) -> None:
        fit = MaximumLikelihood(
            status="iteration limit", iterations=30, log_likelihood=None, message="x. Starting points disagree: y"
        )
        row = graded().ranking[0].model_copy(update={"ml": fit, "intervals": ()})
        said = f"iteration limit, starting points disagree: {QUOTED}"
        troubled = graded().model_copy(update={"ranking": (row,), "collinear_groups": ()})
        assert troubled.conclusion().endswith(f"Maximum likelihood of damping: {said}.")
        marked = troubled.model_copy(update={"collinear_groups": (("C_b", "C_m0"),)})
        assert marked.conclusion().endswith(f"{said}, but no value that is marked *.")

    def test_rows_have_the_evidence(self) -> None:
        assert [row["log_evidence"] for row in graded().rows()] == [12.34, 0.0, None]
        assert list(graded().to_dataframe()["log_evidence"].dropna()) == [12.34, 0.0]

    def test_rows_have_the_names_of_the_page_and_all_of_the_probability(self) -> None:
        rows = graded().rows()
        assert [row["mechanism"] for row in rows] == ["damping", "baseline only", "other"]
        assert sum(row["probability"] for row in rows) == pytest.approx(1.0)

    def test_json_gives_it_all_back(self) -> None:
        withheld = graded(None, limits=(MechanismLimit(mechanism="damping", share_of_moment_95=NAN),))
        for comparison in (graded(), withheld):
            assert Comparison.from_json(comparison.to_json()) == comparison


def test_an_error_is_beyond_its_tolerance_by_how_many_there_are() -> None:
    """Of 53 that were drawn at their tolerances the largest exceeds 3.1 of these in one flight of ten."""
    error = RecordError(name="wind y", value=3.1, std_error=0.1, units="m/s", tolerance=1.0)
    small = error.model_copy(update={"value": 0.1})
    assert beyond_tolerances([error]) == [error]
    assert beyond_tolerances([error, *[small] * 52]) == []
    rng = np.random.default_rng(1)
    largest = np.max(np.abs(rng.standard_normal((4000, 53))), axis=1)
    assert np.mean(largest > beyond_level(53)) == pytest.approx(BEYOND_CHANCE, abs=0.005)


def test_a_flight_that_does_not_reach_an_event_is_said() -> None:
    comparison = graded()
    term = comparison.ranking[0].terms[0].model_copy(update={"value": 1.0, "std_error": 0.1, "units": "1"})
    idle = term.model_copy(update={"value": 0.0})
    intervals = [NetInterval(start_s=a, stop_s=a + 1.0, values=(each,)) for a, each in enumerate((idle, term, idle))]
    knots = tuple(Knot(time_s=at, mach=24.0 - at, flights_s=(at, None)) for at in (0.0, 1.0, 2.0, 3.0))
    both = (*knots[:2], knots[2].model_copy(update={"flights_s": (2.0, 1.5)}))
    for some, said in ((knots, "Mach 23.00 and 22.00"), (both, "Mach 23.00"), ((), "")):
        row = comparison.ranking[0].model_copy(update={"intervals": intervals, "knots": some})
        found = events_unreached(comparison.model_copy(update={"ranking": (row,)}))
        assert [f"changes at {said} is known from flight 1 alone: flight 2 does not" in text for text in found] == (
            [True] if said else []
        )


def test_every_flight_has_its_own_times_of_what_changes() -> None:
    """No time of one flight: Mach numbers, and a column of times for each flight."""
    comparison = graded()
    knots = [Knot(time_s=at, mach=24.0 - at, flights_s=(at + 5.0, own)) for at, own in ((1.0, 2.0), (2.0, None))]
    late = DerivedEstimate(name="damping knot", value=2.0, std_error=0.2, units="s")
    early = late.model_copy(update={"value": 1.0})
    width = late.model_copy(update={"name": "damping onset width", "value": 0.2})
    value = comparison.ranking[0].terms[0].model_copy(update={"value": 9.0, "std_error": 1.0, "region_s": (1.0, 2.0)})
    interval = NetInterval(start_s=1.0, stop_s=2.0, values=(value,))
    found = {"knots": knots, "derived": (late, early, width), "intervals": (interval,)}
    row = comparison.ranking[0].model_copy(update=found)
    about = {"flights": comparison.flights * 2, "reference_flight": 2, "ranking": (row, *comparison.ranking[1:])}
    joint = comparison.model_copy(update=about)
    table = knot_table(joint, row)
    assert [each["change"] for each in table.rows] == ["onset", "end"]
    assert [each["flight 1, s"] for each in table.rows] == ["6.00", "7.00"]
    assert [each["flight 2, s"] for each in table.rows] == ["2.00", "not reached"]
    assert [each["Mach"] for each in table.rows] == ["23", "22"]
    assert [each["sigma (flight 2)"] for each in table.rows] == ["0.2", "0.2"]
    shown = printed(joint)
    assert "region, s" not in shown
    assert line_of(shown, value.name)[-1] == "23.00–22.00"
    assert " acts from Mach" in " ".join(shown.replace("│", " ").split())
    assert any("each flight at its own times" in line for line in flight_texts(joint))
    assert not any("own times" in line for line in flight_texts(comparison))


def test_a_delay_in_a_table_has_its_error() -> None:
    value = graded().ranking[0].terms[0].model_copy(update={"delay_s": 0.12})
    delay = DerivedEstimate(name="lag delay", value=0.12, std_error=0.003, units="s")
    assert [row["delay, s"] for row in term_table("t", [value], derived=[delay]).rows] == ["0.1200 ± 0.003"]


def test_what_describes_and_is_no_cause_is_in_the_heading_as_that() -> None:
    """The heading does not name what the first sentence withdraws; far larger errors are no numbers."""
    comparison = graded("damping")
    row = comparison.ranking[0].model_copy(update={"prediction_ratio": 520.0})
    verdict = with_prediction_error(comparison.verdict, 520.0)
    poor = comparison.model_copy(update={"ranking": (row, *comparison.ranking[1:]), "verdict": verdict})
    assert "Verdict: damping ─" in printed(comparison)
    shown = printed(poor)
    assert "Verdict: undecided; damping describes the moments, no established cause ─" in shown
    assert ">1000 %" in shown
    assert "undecided; damping describes the moments, no established cause (explains" in poor.headline()


def test_what_was_only_corrected_is_warned_of_last() -> None:
    spikes = RecordFault("q", "spikes", 1.0, 2.0, "replaced by a cubic spline", False)
    shown = graded().model_copy(update={"warnings": ("tell-tale",), "record": RecordTrial(faults=(spikes,))})
    text = printed(shown)
    assert text.index("tell-tale") < text.index("cubic spline")


def test_every_process_and_key_is_in_the_manual() -> None:
    verdict, results = text("verdict"), generated("results")
    for each in (*moment_processes(), *record_processes()):
        (row,) = (row for row in verdict.splitlines() if row.startswith("|") and f"`{each.name}`" in row.split("|")[1])
        assert row.split("|")[2].strip() == each.family
        assert row.split("|")[4].strip() == str(each.splines)
    for key in (*ProcessEstimate.model_fields, *Explained.model_fields):
        assert f"| `{key}` | " in results
    assert isinstance(comparison_document(graded()).beside[0], Table)


def test_hypotheses_are_drawn_side_by_side_the_leader_on_top() -> None:
    (axes,) = plot_compare(graded()).axes
    rows = [row for row in graded().ranking if np.isfinite(row.held_out_gain)]
    assert len(rows) >= 2
    assert [label.get_text() for label in axes.get_yticklabels()] == [hypothesis(row.mechanism) for row in rows]
    held_out, evidence = (line.get_xdata() for line in axes.get_lines() if len(line.get_xdata()) == len(rows))
    assert list(held_out) == pytest.approx([row.held_out_gain for row in rows])
    assert list(evidence) == pytest.approx([row.log_evidence for row in rows])
    assert axes.yaxis_inverted()
