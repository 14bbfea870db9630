"""The manual: what it shows is what happens; every topic is there, in the terminal and as a page."""

from __future__ import annotations

import contextlib
import json
import re
import shlex
import shutil
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from typer.main import get_command

from brv_hypo import __all__ as public
from brv_hypo.cli.main import app
from brv_hypo.docs import GENERATED, notebooks, text, topics
from brv_hypo.docs.manual import site
from brv_hypo.errors import UsageError
from brv_hypo.mechanisms.conformance import sample_motion, uniform_time
from brv_hypo.mechanisms.contract import Mechanism, MomentProcess
from brv_hypo.mechanisms.registry import installed
from brv_hypo.model.term import theta_grid
from brv_hypo.report.comparison import comparison_document
from brv_hypo.report.document import Table, flat
from brv_hypo.report.trace import trace_document
from brv_hypo.simulation.config import AerodynamicsConfig
from tests.chains import compared_sticking, traced_trim
from tests.cli.conftest import brv_hypo
from tests.docs.filling import filled_in
from tests.docs.snippets import code_of, commands, execute, matches, snippets
from tests.shared_data import shared_file

__all__ = ["brv_hypo"]

QUICK = ("reference",)
"""Executed in every run; the others go through whole chains."""
LATER = {"start": "thorough", "record": "thorough", "loop": "slow", "mechanism": "thorough", "effect": "slow"}
LATER |= {"python": "thorough"}
EXECUTED = (*LATER, *QUICK)
TOPICS = ("start", "record", "verdict", "loop", "mechanism", "effect", "python", "reference", "theory", "validation")


@pytest.fixture(autouse=True)
def _no_plugin_files_afterwards():
    yield
    from brv_hypo.mechanisms import use_plugin_files

    use_plugin_files(())


@pytest.fixture(scope="module")
def demo_once(brv_hypo):
    """`brv_hypo`, which runs the demonstration once: it reads no file and writes none."""
    demo = cache(lambda: brv_hypo("demo", COLUMNS="80"))
    return lambda *arguments, **where: demo() if arguments == ("demo",) else brv_hypo(*arguments, **where)


@pytest.mark.parametrize(
    "topic", [*QUICK, *(pytest.param(topic, marks=getattr(pytest.mark, when)) for topic, when in LATER.items())]
)
def test_what_a_topic_shows_is_what_happens(topic, demo_once, tmp_path):
    assert execute(topic, tmp_path, demo_once) > 0


@pytest.mark.parametrize("topic", EXECUTED)
def test_what_a_topic_shows_can_be_read(topic, brv_hypo):
    """Commands have these options and arguments, code compiles, files are YAML: what it does is not tested."""
    shown = snippets(topic)
    for arguments in (arguments for each in shown if each.language == "console" for arguments, _ in commands(each)):
        done = brv_hypo(*arguments, "--help")
        assert done.returncode == 0, done.stderr
    for each in shown:
        if each.language == "python":
            compile(code_of(each), topic, "exec")
        elif each.language == "yaml":
            assert yaml.safe_load(each.body)


def shown_in_the_readme() -> list[list[str]]:
    """Arguments of every command in README's list, what it is for left out."""
    lines = (Path(__file__).parents[2] / "README.md").read_text().splitlines()
    listed = (line.split("  ")[0] for line in map(str.strip, lines) if line.startswith("brv-hypo "))
    return [shlex.split(command)[1:] for command in listed]


def test_the_commands_of_the_readme_can_be_read(brv_hypo):
    for arguments in shown_in_the_readme():
        done = brv_hypo(*(word for word in arguments if not word.startswith("[")), "--help")
        assert done.returncode == 0, done.stderr


@pytest.mark.thorough
def test_the_commands_of_the_readme_run_one_after_the_other(brv_hypo, tmp_path, monkeypatch):
    """On the table that the manual makes, with its map; NAME is a name, and what is in brackets may be left out.

    Of the table every other row of its first half: commands run on it as on the whole, which the topic's own test goes
    through.
    """
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda address: opened.append(address) or True)
    table = next(snippet for snippet in snippets("record") if "savetxt" in snippet.body)
    written = next(snippet for snippet in snippets("record") if snippet.file == "map.yaml")
    with contextlib.chdir(tmp_path):
        exec(table.body, {})
    head, *rows = (tmp_path / "log.csv").read_text().splitlines(keepends=True)
    (tmp_path / "data.csv").write_text("".join([head, *rows[:600:2]]))
    (tmp_path / written.file).write_text(written.body)
    shown = shown_in_the_readme()
    assert {arguments[0] for arguments in shown} >= {"import", "inspect", "compare", "trace", "simulate", "predict"}
    for arguments in shown:
        typed = ["blunting" if word == "NAME" else word for word in arguments if not word.startswith("[")]
        done = brv_hypo(*typed, cwd=tmp_path)
        assert done.returncode == 0, f"{typed}: {done.stderr}"
    assert opened
    assert (tmp_path / "report.html").is_file()


OF_MODULES = ("validation", "likelihood", "subset")
"""Topics that state options of `python -m` alone."""


def options_of(command: Any) -> set[str]:
    """The options of a command, and of the commands of a group."""
    own = {option for parameter in command.params for option in (*parameter.opts, "--help")}
    return own.union(*map(options_of, getattr(command, "commands", {}).values()))


@pytest.mark.parametrize("topic", ["README", *topics()])
def test_options_that_are_mentioned_exist(topic):
    """Between backticks: of the command that is named with them, or of any command."""
    page = (Path(__file__).parents[2] / "README.md").read_text() if topic == "README" else text(topic)
    code = re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", page, flags=re.DOTALL))
    for words in code:
        command = re.match(r"brv-hypo ([a-z]+)", words)
        options = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", words))
        if options and (command or (words.startswith("--") and topic not in OF_MODULES)):
            whole = get_command(app)
            known = options_of(whole.commands[command[1]] if command else whole)
            assert options <= known, words


def plain(shown: str) -> float:
    """A number as it is printed, powers of ten included."""
    mantissa, _, raised = shown.partition("×10")
    return float(mantissa) * 10.0 ** int(raised.translate(str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")) or "0")


@pytest.mark.thorough
def test_the_ranking_that_the_manual_shows_is_that_of_the_demo(demo_once):
    """Rank, name and terms; criteria and ln evidence nearly, for other processors."""
    (shown,) = (each for each in snippets("verdict") if each.body.startswith("rank mechanism"))
    number = r"(\S+)(?: %)?"
    rows = re.compile(
        rf"^ +(\d) +([a-z][a-z ]*?) +(\d+) +{number} +{number} +{number} +{number} +[<>]\d+ %[ •]*$", re.MULTILINE
    )
    printed = {row[:3]: row[3:] for row in rows.findall(demo_once("demo").stdout)}
    quoted = rows.findall(shown.body)
    assert len(quoted) == 3
    for rank, name, terms, *values in quoted:
        for said, found in zip(values, printed[rank, name, terms], strict=True):
            assert said == found or plain(said) == pytest.approx(plain(found), rel=0.02), name


SHARES = re.compile(r"inplane`?,? (\d+) % \((\d+) to (\d+) %\)")
"""What the leader explains of Opportunity's entry, %."""


@pytest.mark.slow
@pytest.mark.shared
def test_the_loop_on_the_measured_entry_runs_as_in_the_manual(brv_hypo, tmp_path):
    (shown,) = (snippet for snippet in snippets("loop") if snippet.language == "sh")
    shutil.copy(shared_file("data/opportunity/opportunity_entry.h5"), tmp_path)
    command, variants = shown.body.splitlines()
    assert variants.startswith("python -m tests.studies.loop.variants opportunity_entry.h5")
    done = brv_hypo(*shlex.split(command)[1:], cwd=tmp_path, COLUMNS="80")
    assert done.returncode == 0, done.stderr
    assert "dynamic pressure keeps a fixed proportion" in done.stdout
    assert json.loads((tmp_path / "model.json").read_text())["steps"]


@pytest.mark.thorough
@pytest.mark.shared
@pytest.mark.parametrize(
    ("name", "folder", "guessed", "last", "outcome"),
    [
        (
            "opportunity",
            "opportunity",
            "opportunity_entry.map.yaml",
            "inspect",
            (0, ["1283 samples", "samples a cycle"]),
        ),
        pytest.param(
            "opportunity",
            "opportunity",
            "opportunity_entry.map.yaml",
            "compare",
            (0, ["Verdict: undecided", "inplane has the largest evidence"]),
            marks=pytest.mark.slow,
        ),
        ("rocket", "launch12", "imu.map.yaml", "compare", (1, ["Degraded", "record fault"])),
    ],
)
def test_measured_flights_go_from_tables_to_an_answer_as_in_the_manual(
    brv_hypo, tmp_path, name, folder, guessed, last, outcome
):
    """Commands of the manual in turn, to the `last`; after the first, the lines that it says to fill in are."""
    for path in shared_file(f"data/{folder}").glob("*.csv"):
        shutil.copy(path, tmp_path)
    page = snippets("record")
    at = [index for index, snippet in enumerate(page) if (snippet.language, snippet.file) == ("sh", name)]
    lines = [line for index in at for line in page[index].body.splitlines()]
    lines = lines[: 1 + next(k for k, line in enumerate(lines) if line.startswith(f"brv-hypo {last} "))]
    printed = ""
    for count, line in enumerate(lines):
        done = brv_hypo(*shlex.split(line)[1:], cwd=tmp_path, COLUMNS="80")
        assert done.returncode == (outcome[0] if count == len(lines) - 1 else 0), done.stderr
        printed += " ".join(done.stdout.replace("│", " ").split())
        if count == 0:
            filled_in(tmp_path / guessed, yaml.safe_load(page[at[0] + 1].body))
    assert all(expected in printed for expected in outcome[1])
    if (name, last) == ("opportunity", "compare"):
        assert (tmp_path / "compare.html").stat().st_size < 1_500_000
        quoted = SHARES.findall(re.sub(r"\s+", " ", text("verdict") + text("loop")))
        assert len(quoted) == 2
        (found,) = SHARES.findall(printed)
        assert np.abs(np.array(quoted, dtype=float) - np.array(found, dtype=float)).max() <= 3.0


def test_every_topic_with_something_to_execute_is_executed():
    languages = {topic: {snippet.language for snippet in snippets(topic)} for topic in topics()}
    kernels = {"likelihood", "subset"}  # executed with the tests of each kernel
    assert {topic for topic, used in languages.items() if used & {"console", "python"}} == {*EXECUTED, *kernels}


@pytest.mark.parametrize("topic", topics())
def test_drawings_and_equations_are_whole_at_80_columns(topic):
    """A terminal breaks wider lines, and of a drawing leaves nothing to see."""
    drawn = [line for snippet in snippets(topic) if snippet.language == "text" for line in snippet.body.splitlines()]
    assert [line for line in drawn if len(line) > 78] == []


@pytest.mark.parametrize("topic", topics())
def test_no_table_is_cut_at_80_columns(topic, brv_hypo):
    printed = brv_hypo("docs", topic, COLUMNS="80").stdout.splitlines()
    assert [line for line in printed if "…" in line or len(line) > 80] == []


def test_topics_are_in_reading_order():
    assert tuple(topics())[: len(TOPICS)] == TOPICS
    assert all(re.match(r"# \S", text(topic)) for topic in topics())


def test_the_functions_are_a_topic_like_others(brv_hypo):
    assert "functions" in brv_hypo("docs").stdout
    assert "brv_hypo.compare(flights" in brv_hypo("docs", "functions").stdout
    assert "prediction_ratio" in brv_hypo("docs", "results").stdout


def test_an_unknown_topic_is_refused_with_the_nearest():
    with pytest.raises(UsageError, match="is 'verdict' meant"):
        text("verdikt")


def test_the_reference_names_every_command_and_option_that_many_share():
    page = text("reference")
    names = {command.name for command in app.registered_commands} | {group.name for group in app.registered_groups}
    assert {name for name in names if f"| `{name}" not in page} == set()


@pytest.mark.parametrize("topic", TOPICS)
def test_links_and_commands_that_a_topic_mentions_exist(topic):
    names = {command.name for command in app.registered_commands} | {group.name for group in app.registered_groups}
    mentioned = set(re.findall(r"`brv-hypo ([a-z]+)", text(topic)))
    assert mentioned <= names


@pytest.fixture(scope="module")
def pages():
    return site()


HOSTED = Path(__file__).parents[2] / ".github" / "manual"


def test_every_coefficient_is_in_the_glossary() -> None:
    """As tables of results name them, but for the powers of Mach and Reynolds number."""
    glossary, missing = text("glossary"), set[str]()
    motion = sample_motion(uniform_time())
    for item in (entry.item for entry in installed().values()):
        if isinstance(item, Mechanism) and not isinstance(item, MomentProcess):
            names = {term.name.partition("^")[0] for term in item.terms(motion, dict(theta_grid(item)[0]))}
            missing |= {name for name in names if name not in glossary}
    aerodynamics = {name for name in AerodynamicsConfig.model_fields if name not in glossary}
    assert missing | aerodynamics | ({"roll_rate_mag", "plantable"} - set(re.findall(r"\w+", glossary))) == set()


def test_the_words_of_every_table_are_in_the_manual() -> None:
    manual = set(re.findall(r"[\w,.²]+", " ".join(text(topic) for topic in topics() if topic != "changelog")))
    documents = (comparison_document(compared_sticking()), trace_document(traced_trim()))
    for block in (one for each in documents for one in flat((*each.ahead, *each.beside, *each.blocks))):
        headings = block.headings if isinstance(block, Table) else ()
        words = {word for heading in headings for word in re.findall(r"[\w,.²]+", heading.removesuffix(", s"))}
        assert {word for word in words if word not in manual and f"{word}," not in manual} == set()


class TestPages:
    def test_each_topic_and_notebook_has_a_page_that_needs_no_network(self, pages):
        books = [name.removesuffix(".ipynb") for name in notebooks()]
        assert [name for name in pages if name.endswith(".html")] == [
            f"{name}.html" for name in (*topics(), *books, *GENERATED)
        ]
        assert not [name for name, page in pages.items() if re.search(r"(?:src|href)\s*=\s*[\"']?https?:", page)]

    def test_every_link_leads_to_a_page_and_a_section(self, pages):
        anchors = {name: {"", *re.findall(r' id="([^"]*)"', page)} for name, page in pages.items()}
        for name, page in ((name, page) for name, page in pages.items() if name.endswith(".html")):
            links = re.findall(r'(?:href|src)="(?!data:)([^"#]*)#?([^"]*)"', page)
            assert len(links) > len(topics())
            assert [(to, at) for to, at in links if at not in anchors.get(to or name, ())] == [], name

    def test_the_contents_list_every_section_of_the_page(self, pages):
        for page in (page for name, page in pages.items() if name.endswith(".html")):
            contents = "".join(re.findall("<aside.*?</aside>", page, re.DOTALL))
            assert re.findall(r'href="#([^"]*)"', contents) == re.findall(r'<h2 id="([^"]*)"', page)

    def test_the_search_knows_every_section(self, pages):
        found = re.search(r"^const sections = (.*);$", pages["manual.js"], re.MULTILINE)
        sections = json.loads(found[1])
        assert {page for page, *_ in sections} == {name.removesuffix(".html") for name in pages if "html" in name}
        assert all(anchor in pages[f"{page}.html"] for page, anchor, *_ in sections)
        assert len({(page, anchor) for page, anchor, *_ in sections}) == len(sections)
        assert not [text for *_, text in sections if "base64" in text or "<p>" in text]

    def test_files_are_shown_under_their_names(self, pages, brv_hypo):
        assert '<p class="file">sister.yaml</p>\n<pre>' in pages["loop.html"]
        assert "sister.yaml:" in brv_hypo("docs", "loop").stdout.splitlines()
        assert ">opportunity</p>" not in pages["record.html"]  # a name of commands that belong together, no file

    def test_a_topic_that_is_named_is_a_link(self, pages):
        assert '<a href="theory.html"><code>brv-hypo docs theory</code></a>' in pages["start.html"]

    def test_functions_have_signature_and_sections(self, pages):
        page = pages["functions.html"]
        assert all(f'<h2 id="{name}">' in page for name in (*public, "best_subsets", "fit", "save"))
        assert page.count("<strong>Parameters</strong>") >= len(public) + 2
        assert "<li><code>max_terms, n_best</code> int<br />" in page
        assert "brv_hypo.load_flight(path, *, start=None, stop=None, instruments=None)" in page

    def test_notebooks_are_shown_with_their_outputs(self, pages):
        page = pages["planted_mechanism.html"]
        assert all(shown in page for shown in ('src="data:image/png;base64,', '<div class="output">', "UsageError - "))

    def test_the_hosted_manual_has_the_same_pages(self, pages):
        listed = re.findall(r"^   ([\w/]+)$", (HOSTED / "index.rst").read_text(), re.MULTILINE)
        assert [f"{name.rpartition('/')[2]}.html" for name in listed] == [name for name in pages if "html" in name]
        named = re.findall(r"auto(?:function|method):: ([\w.]+)", (HOSTED / "functions.rst").read_text())
        own = re.findall(r'<h2 id="(\w+)">', pages["functions.html"])
        assert sorted(name.rpartition(".")[2] for name in named) == sorted(own)

    def test_the_command_writes_them(self, pages, brv_hypo, tmp_path):
        done = brv_hypo("docs", "-o", "manual", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        written = {path.name: path.read_text() for path in (tmp_path / "manual").iterdir()}
        assert written == {**pages, "index.html": pages["start.html"]}
        assert brv_hypo("docs", "-o", "manual", cwd=tmp_path).returncode == 2

    @pytest.mark.parametrize(
        ("topic", "expected"),
        [((), "start"), (("loop",), "loop"), (("own_csv",), "own_csv"), (("functions",), "functions")],
    )
    def test_open_shows_the_page(self, topic, expected, brv_hypo, tmp_path, monkeypatch, pages):
        opened = []
        monkeypatch.setattr("webbrowser.open", lambda address: opened.append(address) or True)
        monkeypatch.setattr("brv_hypo.docs.manual.site", lambda: pages)
        monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
        done = brv_hypo("docs", *topic, "--open", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert opened[0].startswith("file://")
        assert opened[0].endswith(f"/manual/{expected}.html")

    def test_an_unknown_page_is_refused(self, brv_hypo, tmp_path):
        done = brv_hypo("docs", "verdikt", "-o", "manual", cwd=tmp_path)
        assert done.returncode == 2
        assert "is 'verdict' meant" in done.stderr
        assert not (tmp_path / "manual").exists()


class TestSnippets:
    def test_dots_match_anything(self):
        assert matches("a ... c\n...\nend\n", "a b c\nmore\nlines\nend\n")
        assert not matches("a ... c\n", "a b d\n")

    def test_white_space_does_not_count(self):
        assert matches("a   b\n", "a b  \n\n")


@pytest.mark.parametrize("topic", sorted(topics()))
def test_commands_and_files_are_not_broken_at_80_columns(topic):
    """The terminal sets code one column in; what it breaks cannot be copied."""
    for fence in re.finditer(r"^```(\w+)[^\n]*\n(.*?)^```$", text(topic), re.MULTILINE | re.DOTALL):
        if fence[1] in ("console", "sh", "yaml"):
            assert all(len(line) <= 78 for line in fence[2].splitlines()), fence[2]
