"""Each command does what the contract says, on small flights."""

from __future__ import annotations

import json
import re
import time
from dataclasses import replace

import numpy as np
import pytest

from brv_hypo import reconstruct
from brv_hypo.cli import session
from brv_hypo.flight import load_flight, read_tree
from brv_hypo.report.reconstruction import reconstruction_document
from tests.truth import load_truth

ROW_KEYS = "rank mechanism f_ratio cp prediction_error r2 bic log_likelihood n_terms n_effective terms ml"
STAGE = re.compile(r"\d+ s: .*")  # a line of a stage that takes longer than two seconds
TERM_KEYS = "name mechanism channel value std_error f_ratio units region_s delay_s"


def strict_json(text):
    """The value of a JSON text; NaN and infinity are no JSON."""
    return json.loads(text, parse_constant=lambda constant: pytest.fail(f"{constant} is not JSON"))


def test_a_stage_has_a_line_where_there_is_no_terminal_not_one_for_each_percent(capsys, monkeypatch):
    monkeypatch.setattr(session, "LINE_SECONDS", 0.01)
    with session.shown("flying", quiet=False) as report:
        for stage in ("flying", "landing"):
            for k in range(10):
                report(k / 10.0, stage)
                time.sleep(0.02)
    lines = capsys.readouterr().err.splitlines()
    assert [re.sub(r"^\d+ s: |, \d+% done$", "", line) for line in lines] == ["flying", "landing"]


class TestSimulate:
    def test_writes_a_record_with_its_truth(self, planted_file):
        flight = load_flight(planted_file)
        assert flight.samples == 301
        assert load_truth(planted_file)["planted"] == "bodyfixed"

    def test_the_seed_makes_the_flight(self, brv_hypo, brief_config, tmp_path):
        for name, seed in (("first.h5", 4), ("same.h5", 4), ("other.h5", 5)):
            assert brv_hypo("simulate", brief_config, "-o", name, "--seed", seed, cwd=tmp_path).returncode == 0
        first = load_flight(tmp_path / "first.h5")
        np.testing.assert_array_equal(load_flight(tmp_path / "same.h5").q, first.q)
        assert np.any(load_flight(tmp_path / "other.h5").q != first.q)

    def test_json_says_what_was_planted(self, planted):
        result = strict_json(planted[0].stdout)
        assert result["planted"] == ["bodyfixed"]
        assert result["planted_share"]["out_of_plane"] > 0.0
        assert result["mechanisms"][0]["terms"] == {"C_b cos(phi_b)": 8.0e-4, "C_b sin(phi_b)": -3.0e-4}

    def test_sizes_of_what_is_planted_and_drawn_are_printed(self, brv_hypo, brief_config, tmp_path):
        done = brv_hypo("simulate", brief_config, "--draw", 1, "-v", "--json", "f.json", "-o", "f.h5", cwd=tmp_path)
        assert "  sticking: eps 0.6, delay 0.12 s, from 0.2 s" in done.stdout
        errors = strict_json((tmp_path / "f.json").read_text())["errors"]
        assert re.search(rf"gyro_bias +q +{errors['gyro_bias']['q']:.3g} +rad/s", done.stdout)
        assert re.search(r"trim +C_m0 +\S+ +1 +\S+", done.stdout)
        assert "no instrument has noise" not in done.stderr

    def test_a_record_without_noise_is_warned_of(self, brv_hypo, tmp_path):
        text = "base: research_cone\nduration: 0.5\nsample_rate: 100.0\nstep: 0.01\ninstruments: {}\n"
        (tmp_path / "f.yaml").write_text(text)
        done = brv_hypo("simulate", "f.yaml", "-o", "f.h5", cwd=tmp_path)
        assert "no instrument has noise" in done.stderr

    @pytest.mark.thorough
    def test_a_vehicle_that_tumbles_is_warned_of(self, brv_hypo, tmp_path):
        text = "base: research_cone\nduration: 3.0\nmechanisms: [{mechanism: damping, terms: {C_damping: 150.0}}]\n"
        (tmp_path / "f.yaml").write_text(text)
        done = brv_hypo("simulate", "f.yaml", "-o", "f.h5", cwd=tmp_path)
        assert re.search(r"the vehicle tumbles: alpha is above 60 deg from [\d.]+ s on", done.stderr)

    def test_an_existing_flight_is_kept_unless_forced(self, brv_hypo, brief_config, tmp_path):
        target = tmp_path / "flight.h5"
        target.write_text("mine")
        assert brv_hypo("simulate", brief_config, "-o", target).returncode == 2
        assert target.read_text() == "mine"
        assert brv_hypo("simulate", brief_config, "-o", target, "--force").returncode == 0
        assert load_flight(target).samples == 51

    def test_an_unknown_configuration_ends_with_2_and_the_nearest(self, brv_hypo, tmp_path):
        done = brv_hypo("simulate", "research_cane", "-o", tmp_path / "f.h5")
        assert done.returncode == 2
        assert "research_cone" in done.stderr


class TestInspect:
    def test_shows_channels_and_what_is_usable(self, brv_hypo, flight_file):
        done = brv_hypo("inspect", flight_file)
        assert done.returncode == 0, done.stderr
        for expected in ("dynamic_pressure", "rad/s", "usable: 0.00", "100 Hz", "100 kg"):
            assert expected in done.stdout

    def test_json_has_the_same_channels(self, brv_hypo, flight_file):
        result = strict_json(brv_hypo("inspect", flight_file, "--json", "-").stdout)
        assert result["schema"] == "brv-hypo/inspect/1"
        assert result["sample_rate"] == pytest.approx(100.0)
        assert {"p", "q", "r", "velocity"} <= {channel["name"] for channel in result["channels"]}

    def test_a_window_narrows_it(self, brv_hypo, flight_file):
        result = strict_json(brv_hypo("inspect", flight_file, "--start", 1, "--stop", 2, "--json", "-").stdout)
        assert result["samples"] == 101


class TestImport:
    @pytest.fixture
    def foreign(self, tmp_path):
        """A csv record with its map."""
        time = np.arange(200) / 100.0
        names = ("t", "wx", "wy", "wz", "fx", "fy", "fz", "v", "qinf")
        rates = [10.0 + 0.0 * time, np.sin(6.0 * time), np.cos(6.0 * time)]
        rest = [np.full_like(time, value) for value in (-20.0, 0.1, 0.2, 6000.0, 3e4)]
        lines = [",".join(f"{value:.9g}" for value in row) for row in zip(time, *rates, *rest, strict=True)]
        (tmp_path / "data.csv").write_text("\n".join([",".join(names), *lines]))
        channels = ("time", "p", "q", "r", "ax", "ay", "az", "velocity", "dynamic_pressure")
        units = ("s", "deg/s", "deg/s", "deg/s", "m/s^2", "m/s^2", "m/s^2", "m/s", "Pa")
        mapped = [
            f"  {channel}: {{column: {name}, units: {unit}}}"
            for channel, name, unit in zip(channels, names, units, strict=True)
        ]
        vehicle = [
            "  mass: {value: 100, units: kg}",
            "  ixx: {value: 1.5, units: kg*m^2}",
            "  iyy: {value: 10, units: kg*m^2}",
            "  reference_length: {value: 0.4, units: m}",
            "  reference_area: {value: 0.125, units: m^2}",
        ]
        (tmp_path / "map.yaml").write_text("\n".join(["channels:", *mapped, "vehicle:", *vehicle]))
        return tmp_path

    def test_brings_a_table_in_with_its_units(self, brv_hypo, foreign):
        done = brv_hypo("import", "data.csv", "--map", "map.yaml", "-o", "flight.h5", cwd=foreign)
        assert done.returncode == 0, done.stderr
        assert load_flight(foreign / "flight.h5").p[0] == pytest.approx(np.radians(10.0))

    def test_units_that_the_record_contradicts_are_warned_of_however_quiet_it_is(self, brv_hypo, foreign):
        mapping = foreign / "map.yaml"
        mapping.write_text(mapping.read_text().replace("units: Pa", "units: kPa"))
        done = brv_hypo("import", "data.csv", "--map", "map.yaml", "-o", "flight.h5", "-q", cwd=foreign)
        assert done.returncode == 0, done.stderr
        assert done.stderr.startswith("brv-hypo: warning: the record contradicts itself (units): drag of ")

    def test_a_map_of_a_missing_column_ends_with_2(self, brv_hypo, foreign):
        mapping = foreign / "map.yaml"
        mapping.write_text(mapping.read_text().replace("column: wx", "column: wq"))
        done = brv_hypo("import", "data.csv", "--map", "map.yaml", "-o", "flight.h5", cwd=foreign)
        assert done.returncode == 2
        assert "'wq'" in done.stderr
        assert not (foreign / "flight.h5").exists()


REGRESSION = "mechanisms: [damping]\nmaximum_likelihood: none\nknot_count: 3\nmax_terms: 2\nexact_terms: 2\n"


@pytest.fixture(scope="module")
def regression(tmp_path_factory):
    """A comparison by regression alone, for what the likelihood has no part in."""
    path = tmp_path_factory.mktemp("config") / "regression.yaml"
    path.write_text(REGRESSION)
    return path


@pytest.fixture(scope="module")
def compared(brv_hypo, planted_file, tmp_path_factory):
    """One comparison: the finished process, its JSON and its report."""
    folder = tmp_path_factory.mktemp("compared")
    files = ("--json", folder / "out.json", "--report", folder / "out.html")
    (folder / "few.yaml").write_text("knot_count: 5")
    chosen = ("--config", folder / "few.yaml", "--mechanisms", "bodyfixed")
    done = brv_hypo("compare", planted_file, *chosen, *files)
    assert done.returncode == 0, done.stderr
    return done, strict_json((folder / "out.json").read_text()), (folder / "out.html").read_text()


@pytest.fixture(scope="module")
def regressed(brv_hypo, nominal_file, tmp_path_factory):
    """A comparison by regression, with an option of its mechanism, and JSON on standard output."""
    path = tmp_path_factory.mktemp("regressed") / "config.yaml"
    path.write_text(REGRESSION + "options: {damping: {form: complete}}\n")
    return brv_hypo("compare", nominal_file, "--config", path, "--json", "-")


class TestCompare:
    def test_prints_the_ranking_and_the_verdict(self, compared):
        printed = compared[0].stdout
        for expected in (
            "mechanism",
            "F-ratio",
            "C_p",
            "pred. error",
            "ln evidence",
            "bodyfixed",
            "baseline only",
            "Verdict: ",
        ):
            assert expected in printed
        assert max(len(line) for line in printed.splitlines()) <= 100

    def test_json_follows_the_contract(self, compared):
        result = compared[1]
        assert result["schema"] == "brv-hypo/compare/1"
        assert {"path", "samples", "start_s", "stop_s", "sample_rate_hz"} <= set(result["flights"][0])
        assert {"method", "alpha_rms_sigma_rad", "phi_w_rms_sigma_rad", "warnings"} <= set(result["reconstruction"])
        assert set(result["seconds"]) == {"reconstruct", "select", "ml", "total"}
        for row in result["ranking"]:
            assert set(ROW_KEYS.split()) <= set(row)
            assert all(set(TERM_KEYS.split()) <= set(term) for term in row["terms"])
        assert all(set(TERM_KEYS.split()) <= set(term) for term in result["baseline"]["terms"])
        assert not {"series", "coefficients"} & set(result)

    def test_none_is_always_compared_and_ranks_count_from_one(self, compared):
        ranking = compared[1]["ranking"]
        assert {row["mechanism"] for row in ranking} == {"none", "bodyfixed"}
        assert [row["rank"] for row in ranking] == [1, 2]

    def test_probabilities_sum_to_one_over_the_hypotheses(self, compared):
        verdict = compared[1]["verdict"]
        assert sum(verdict["probability"].values()) == pytest.approx(1.0)
        assert set(verdict["probability"]) == {"none", "bodyfixed", "other"}
        assert set(verdict["equivalent"]) <= {"none", "bodyfixed"}
        assert verdict["winner"] in (None, *verdict["equivalent"])

    def test_the_report_opens_offline(self, compared):
        html = compared[2]
        assert html.count('id="library"') == 1
        assert len(html) < 1_500_000
        assert not re.findall(r"<(?:script|link|img)[^>]+(?:src|href)\s*=\s*[\"']?https?:", html)
        assert compared[1]["verdict"]["reason"] in html
        ids, named = re.findall(r'<h3 id="([^"]+)"', html), [row["mechanism"] for row in compared[1]["ranking"]]
        over_time = [f"coefficients-{name}" for name in named if f"coefficients-{name}" in ids]
        assert over_time
        assert html.count('class="chart"') == 21 + len(over_time)

    @pytest.mark.thorough
    def test_json_on_standard_output_is_alone_there(self, regressed):
        assert strict_json(regressed.stdout)["schema"] == "brv-hypo/compare/1"
        assert all(STAGE.fullmatch(line) for line in regressed.stderr.splitlines())

    @pytest.mark.slow
    def test_json_is_alone_whatever_libraries_print(self, brv_hypo_process, simulated_file, regression):
        done = brv_hypo_process("compare", simulated_file, "--config", regression, "--json", "-")
        assert strict_json(done.stdout)["schema"] == "brv-hypo/compare/1"
        assert all(STAGE.fullmatch(line) for line in done.stderr.splitlines())

    @pytest.mark.thorough
    def test_quiet_prints_title_and_outcome_in_one_line(self, brv_hypo, planted_file, regression, tmp_path):
        chosen = ("--config", regression, "--mechanisms", "bodyfixed")
        done = brv_hypo("compare", planted_file, *chosen, "-q", "--json", tmp_path / "out.json")
        (line,) = done.stdout.splitlines()
        title, _, sentence = line.partition(": ")[2].partition(": ")
        verdict = strict_json((tmp_path / "out.json").read_text())["verdict"]
        assert title.startswith(verdict["winner"] or verdict["outcome"])
        assert verdict["reason"].startswith(sentence[:60])

    @pytest.mark.thorough
    def test_verbose_shows_every_term(self, brv_hypo, nominal_file, regression):
        chosen = ("--config", regression, "--mechanisms", "damping,lag")
        done = brv_hypo("compare", nominal_file, *chosen, "-v")
        for expected in ("C_malpha", "C_damping", "sigma", "region, s", "delay, s", "1/rad", "s in all"):
            assert expected in done.stdout

    @pytest.mark.thorough
    def test_several_flights_are_fitted_jointly(self, brv_hypo, nominal_file, regression):
        files = (nominal_file, nominal_file)
        done = brv_hypo("compare", *files, "--config", regression, "--json", "-")
        assert done.returncode == 0, done.stderr
        assert len(strict_json(done.stdout)["flights"]) == 2

    @pytest.mark.thorough
    def test_a_configuration_sets_what_is_compared(self, regressed):
        row = next(row for row in strict_json(regressed.stdout)["ranking"] if row["mechanism"] == "damping")
        assert {term["channel"] for term in row["terms"]} <= {"both"}


class TestMechanisms:
    def test_lists_name_package_and_claims(self, brv_hypo):
        done = brv_hypo("mechanisms")
        assert "sticking" in done.stdout
        assert "brv-hypo" in done.stdout
        assert "wind-fixed" in done.stdout

    def test_lists_what_a_simulation_plants(self, brv_hypo, tmp_path):
        shown = brv_hypo("mechanisms", "-v", "--json", "list.json", cwd=tmp_path).stdout
        assert re.search(r"research_cone: sticking, lag, bodyfixed", shown)
        assert "C_b cos(phi_b), C_b sin(phi_b)" in " ".join(shown.split())
        assert "theta delay (s)" in " ".join(shown.split())
        found = strict_json(brv_hypo("mechanisms", "--json", "-").stdout)
        planted = {each["name"]: each["planted"] for each in found["mechanisms"]}
        assert planted["gyro_drift"][0] == "p 0 (rad/s)"
        assert "magnus" in found["plantable"]["research_cone"]

    def test_check_reports_every_check(self, brv_hypo):
        result = strict_json(brv_hypo("mechanisms", "check", "lag", "--json", "-").stdout)
        assert result["passed"] is True
        assert {"is_elementwise", "flags_its_delays"} <= {check["check"] for check in result["checks"]}

    def test_new_writes_into_the_directory_given(self, brv_hypo, tmp_path):
        done = brv_hypo("mechanisms", "new", "ablation", "-o", tmp_path)
        assert done.returncode == 0
        assert (tmp_path / "brv-hypo-ablation" / "pyproject.toml").exists()
        assert "brv-hypo mechanisms check ablation" in done.stdout


class TestReconstruct:
    def test_writes_the_histories_with_their_units(self, brv_hypo, planted_file, tmp_path):
        done = brv_hypo("reconstruct", planted_file, "-o", "motion.h5", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        written = read_tree(tmp_path / "motion.h5").datasets
        assert written["alpha"].units == "rad"
        assert written["alpha"].values.shape == load_flight(planted_file).time.shape
        assert "windward meridian" in done.stdout
        assert done.stdout.endswith("Wrote motion.h5.\n")

    @pytest.mark.parametrize("method", ["joint", "velocity", "rates"])
    def test_each_method_can_be_chosen(self, brv_hypo, planted_file, method):
        done = brv_hypo("reconstruct", planted_file, "--method", method, "--json", "-")
        assert done.returncode == 0, done.stderr
        assert strict_json(done.stdout)["reconstruction"]["method"] == method

    def test_it_says_what_it_wrote(self, brv_hypo, planted_file, tmp_path):
        done = brv_hypo("reconstruct", planted_file, "--report", "out.html", "--json", "out.json", cwd=tmp_path)
        assert "Wrote out.html." in done.stdout
        assert "Wrote out.json." in done.stdout

    def test_a_name_of_another_format_is_refused_before_the_work(self, brv_hypo, planted_file, tmp_path):
        done = brv_hypo("reconstruct", planted_file, "-o", "motion.csv", cwd=tmp_path)
        assert (done.returncode, "Give motion.h5" in done.stderr, [*tmp_path.iterdir()]) == (2, True, [])

    def test_the_conclusion_says_why_a_motion_is_degraded(self, planted_file):
        found = replace(reconstruct(planted_file, method="rates"), status="degraded", warnings=("too few samples",))
        conclusion = reconstruction_document(found).conclusion
        assert conclusion.startswith("motion of the instruments alone (rates method), known to")
        assert conclusion.endswith("and say how far. Degraded: too few samples")

    def test_the_report_opens_offline(self, brv_hypo, planted_file, tmp_path):
        done = brv_hypo("reconstruct", planted_file, "--report", "out.html", "-q", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert (tmp_path / "out.html").read_text().count('class="chart"') == 9

    def test_an_existing_motion_file_is_kept(self, brv_hypo, planted_file, tmp_path):
        (tmp_path / "motion.h5").write_text("mine")
        assert brv_hypo("reconstruct", planted_file, "-o", "motion.h5", cwd=tmp_path).returncode == 2
        assert (tmp_path / "motion.h5").read_text() == "mine"


def test_import_guesses_a_map_and_says_what_it_is_unsure_of(brv_hypo, tmp_path):
    rows = [f"{0.01 * i:.2f},{i % 7}.5,{i % 5}.5" for i in range(60)]
    (tmp_path / "log.csv").write_text("\n".join(["t_s,p,ax_g", *rows]))
    done = brv_hypo("import", "--guess", "log.csv", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "no column was found for q" in done.stdout
    assert "units of p are not stated" in done.stdout
    assert "# UNSURE" in (tmp_path / "log.map.yaml").read_text()
    again = brv_hypo("import", "--guess", "log.csv", cwd=tmp_path)
    assert (again.returncode, "--force" in again.stderr) == (2, True)


def test_import_takes_either_a_map_or_a_guess(brv_hypo, tmp_path):
    (tmp_path / "log.csv").write_text("t_s\n1\n")
    for arguments in ((), ("--guess", "--map", "map.yaml")):
        done = brv_hypo("import", "log.csv", *arguments, cwd=tmp_path)
        assert done.returncode == 2
        assert "either --map" in done.stderr


@pytest.mark.parametrize(
    ("command", "picture"),
    [
        (("compare",), "probability.svg"),
        (("compare",), "moments.png"),
        (("trace",), "residuals.png"),
        (("reconstruct",), "rates.png"),
        (("predict", "--model", "model.json"), "band.svg"),
    ],
)
def test_an_existing_picture_is_refused_before_any_work(brv_hypo, tmp_path, command, picture):
    """Not even the flight, which is none, has been read."""
    (tmp_path / "none.h5").write_text("no flight")
    (tmp_path / "model.json").write_text("{}")
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / picture).write_text("mine")
    done = brv_hypo(command[0], "none.h5", *command[1:], "--figures", "figures", cwd=tmp_path)
    assert done.returncode == 2
    assert f"{picture} exists already" in done.stderr
    forced = brv_hypo(command[0], "none.h5", *command[1:], "--figures", "figures", "--force", cwd=tmp_path)
    assert f"{picture} exists already" not in forced.stderr
    assert (tmp_path / "figures" / picture).read_text() == "mine"


@pytest.mark.parametrize("group", [(), ("config",), ("mechanisms",)])
def test_help_says_in_full_what_commands_do_at_80_columns(brv_hypo, group):
    listed = brv_hypo(*group, "--help", COLUMNS="80").stdout.partition("Commands:")[2]
    lines = listed.strip().splitlines()
    assert len(lines) > 1
    assert all(line.endswith(".") and not line.endswith("...") for line in lines), listed


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        ("comp", ["compare"]),
        ("docs ver", ["verdict"]),
        ("simulate res", ["research_cone"]),
        ("study study_p", ["study_planted"]),
        ("compare --instruments ta", ["tactical"]),
        ("compare --mechanisms la", ["lag"]),
        ("compare --mechanisms lag,sticking+bo", ["lag,sticking+bodyfixed"]),
        ("mechanisms check gyro_s", ["gyro_scale"]),
    ],
)
def test_a_shell_completes_names(brv_hypo, typed, expected):
    words = ["brv-hypo", *typed.split()]
    shell = {"_BRV_HYPO_COMPLETE": "complete_bash", "COMP_WORDS": " ".join(words), "COMP_CWORD": str(len(words) - 1)}
    assert brv_hypo(**shell).stdout.split() == expected
