"""The console script: which commands there are, `mechanisms`, `config` and `docs` among them.

Commands import what they need when they run, so that `brv-hypo --help` is quick.
"""

from __future__ import annotations

import json
import keyword
import re
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from typer import Argument, Option

from brv_hypo.cli import analyses, flights
from brv_hypo.cli.session import Session, complete_installed, complete_topics, in_session, listen, ready
from brv_hypo.errors import UsageError
from brv_hypo.io.files import check_target, make_folder, whole_folder, write_whole
from brv_hypo.io.text import meant

if TYPE_CHECKING:
    from pydantic import BaseModel


mechanisms_app = typer.Typer(invoke_without_command=True, add_completion=False, rich_markup_mode=None)
ALONG = {
    "simulate": ("research_cone", "", "brv-hypo simulate {} -o flight.h5"),
    "study": ("study_planted", "studies", "brv-hypo study {} -o results"),
    "import": ("every_key", "maps", "brv-hypo import log.csv --map {} -o flight.h5"),
    "instruments": ("opportunity", "instruments", "brv-hypo compare flight.h5 --instruments {}"),
}
"""What new simulations, studies, maps and tolerances start from, as they need more than defaults: files that come along
with their comments, by name and folder; and the command that reads them."""
KINDS = ("compare", "trace", "reconstruct", "simulate", "study", "import")  # the commands that take settings
RESULTS = ("compare-result", "trace-result", "predict-result")  # what --json writes by a schema


@mechanisms_app.callback()
@in_session("json", "force", "plugin")
def listing(session: Session, context: typer.Context) -> None:
    """Without a command: list what is installed. Commands write or check a plugin."""
    if context.invoked_subcommand is not None:
        return
    session.claim()
    from brv_hypo.mechanisms import installed
    from brv_hypo.report.document import Texts
    from brv_hypo.report.listings import OF_KINDS, listing_data, listing_table, plantable_texts
    from brv_hypo.simulation import config_names, load_config

    found = installed()
    plantable = {name: tuple(sets) for name in config_names() if (sets := load_config(name).plantable)}
    kinds = Texts((OF_KINDS,), bullets=False), plantable_texts(plantable)
    session.show(listing_table(found, verbose=session.verbose), *kinds, conclusion="\n".join(found))
    if session.json is not None:  # which evaluates every mechanism
        session.write_json(listing_data(found, plantable))


@mechanisms_app.command("new")
@in_session()
def new_plugin(
    session: Session,
    name: Annotated[str, Argument(help="Name of the mechanism: lower case letters, digits and _.")],
    effect: Annotated[
        bool, Option("--effect", help="An effect on the record, of an instrument or the air, instead.")
    ] = False,
    process: Annotated[bool, Option("--process", help="A process of the moment instead.")] = False,
    directory: Annotated[
        Path, Option("-o", "--output", metavar="DIR", help="Directory to write the package into; made if need be.")
    ] = Path(),
) -> None:
    """Write a ready plugin package with its tests, to start from."""
    kind: PluginKind = "effect" if effect else "process" if process else "mechanism"
    written = write_plugin(name, directory, kind)
    part = {"effect": "components and perturb", "process": "shapes and splines", "mechanism": "the terms"}[kind]
    session.show(
        f"Wrote {written}. Next:\n  pip install -e '{written}[test]'\n  brv-hypo mechanisms check {name}\n"
        f"then replace {part} in {written}/brv_hypo_{name}.py by your own."
    )


PluginKind = Literal["mechanism", "effect", "process"]


def write_plugin(name: str, parent: Path, kind: PluginKind = "mechanism") -> Path:
    """A plugin package for the mechanism, record effect or process `name`, in a new directory in `parent`.
    Returns the directory, `brv-hypo-<name>`. Raises UsageError for a name that cannot be one, or where it exists.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or keyword.iskeyword(name) or name == "none":
        raise UsageError(
            f"'{name}' cannot name a mechanism: expected lower case letters, digits and _, a letter first, "
            "and neither 'none' nor a word of Python. For example 'uneven_ablation'."
        )
    words, module, distribution = name.replace("_", " "), f"brv_hypo_{name}", f"brv-hypo-{name.replace('_', '-')}"
    is_effect, compare = kind == "effect", f"brv-hypo compare flight.h5 --mechanisms {name},sticking"
    what, use = ("record effect", "brv-hypo trace flight.h5") if is_effect else (kind, compare)
    values = {"name": name, "module": module, "distribution": distribution, "title": words, "what": what, "use": use}
    values |= {"klass": words.title().replace(" ", ""), "topic": "effect" if is_effect else "mechanism"}
    parts = {f"{kind}.py": f"{module}.py", f"test_{kind}.py": f"tests/test_{module}.py"}
    make_folder(parent)
    with whole_folder(parent / distribution) as folder:
        (folder / "tests").mkdir()
        for template in ("pyproject.toml", "README.md", *parts):
            text = (files("brv_hypo.mechanisms") / "template" / f"{template}.tmpl").read_text(encoding="utf-8")
            (folder / parts.get(template, template)).write_text(Template(text).substitute(values), encoding="utf-8")
    return parent / distribution


@mechanisms_app.command("check")
@in_session("json", "force", "plugin")
def check(
    session: Session,
    name: Annotated[str, Argument(autocompletion=complete_installed, help="Name of an installed mechanism or effect.")],
) -> None:
    """Run the conformance kit on an installed mechanism or effect."""
    session.claim()
    from brv_hypo.mechanisms import find_installed
    from brv_hypo.mechanisms.conformance import conformance
    from brv_hypo.report.listings import conformance_table

    outcomes = conformance(find_installed(name))
    failed = [outcome.check for outcome in outcomes if not outcome.passed]
    passed = f"'{name}' passes {len(outcomes) - len(failed)} of {len(outcomes)} checks."
    session.show(conformance_table(name, outcomes), conclusion=passed)
    known = {"schema": "brv-hypo/conformance/1", "mechanism": name, "passed": not failed}
    session.write_json({**known, "checks": [asdict(outcome) for outcome in outcomes]})
    if failed:
        session.warn(f"'{name}' fails {len(failed)} of {len(outcomes)} checks: {', '.join(failed)}")
        raise typer.Exit(1)
    session.show(passed)


config_app = typer.Typer(no_args_is_help=True, add_completion=False, rich_markup_mode=None)


@config_app.callback()
def config() -> None:
    """Write a commented file of settings, or print a JSON schema."""


@config_app.command("new")
@in_session("force")
def new_settings(
    session: Session,
    kind: Annotated[
        str,
        Argument(help=f"The command that reads the file: {', '.join(KINDS)}; or the name of a file that comes along."),
    ],
    output: Annotated[
        Path | None, Option("-o", "--output", metavar="FILE.yaml", help="File to write; KIND.yaml if left out.")
    ] = None,
) -> None:
    """Write a commented file of settings, to change and use."""
    from brv_hypo.settings import commented
    from brv_hypo.simulation import config_names, config_path

    path = Path(f"{kind}.yaml") if output is None else output
    folders = {name: (folder, use) for _, folder, use in ALONG.values() for name in config_names(folder)}
    name = ALONG[kind][0] if kind in ALONG else kind
    if name in folders:
        folder, use = folders[name]
        text = config_path(name, folder).read_text(encoding="utf-8")
    else:
        model = _model(kind, KINDS, folders)
        text, use = commented(model, f"Settings of `brv-hypo {kind}`"), f"brv-hypo {kind} flight.h5 --config {{}}"
    session.claim(path)
    write_whole(path, text, overwrite=session.force)
    session.show(f"Wrote {path}. Use it with:\n  {use.format(path)}")


@config_app.command("schema")
@in_session()
def schema(
    session: Session,
    kind: Annotated[str, Argument(help=f"Settings of a command, or a result: {', '.join(KINDS + RESULTS)}.")],
) -> None:
    """Print the JSON schema of settings or of a result."""
    model = _model(kind, KINDS + RESULTS)
    found = model.model_json_schema(by_alias=True, mode="serialization" if kind in RESULTS else "validation")
    typer.echo(json.dumps(found, indent=2))


def _model(kind: str, known: Sequence[str], files: Iterable[str] = ()) -> type[BaseModel]:
    """The model of settings or of a result; UsageError where the kind is neither known nor one of some files."""
    if kind not in known:
        every = (*known, *files)
        raise UsageError(f"'{kind}' has no settings here ({meant(kind, every, 'known are ' + ', '.join(every))})")
    from brv_hypo.comparison import CompareConfig, Comparison
    from brv_hypo.importing.record_map import RecordMap
    from brv_hypo.motion import ReconstructionConfig
    from brv_hypo.prediction import Prediction
    from brv_hypo.simulation.config import SimulationConfig
    from brv_hypo.study.config import StudyConfig
    from brv_hypo.tracing import Trace, TraceConfig

    settings = (CompareConfig, TraceConfig, ReconstructionConfig, SimulationConfig, StudyConfig, RecordMap)
    models: tuple[type[BaseModel], ...] = (*settings, Comparison, Trace, Prediction)
    return dict(zip(KINDS + RESULTS, models, strict=True))[kind]


@in_session("force")
def docs(
    session: Session,
    topic: Annotated[
        str | None, Argument(metavar="TOPIC", autocompletion=complete_topics, help="What to read about.")
    ] = None,
    notebooks: Annotated[
        Path | None, Option("--notebooks", metavar="DIR", help="Write the notebooks of the gallery.")
    ] = None,
    show: Annotated[bool, Option("--open", help="Open the manual in the browser, at the topic.")] = False,
    output: Annotated[
        Path | None, Option("-o", "--output", metavar="DIR", help="Write the manual as offline pages.")
    ] = None,
) -> None:
    """Read the manual; without a topic, the list of topics."""
    from brv_hypo.docs import GENERATED, text, topics

    if notebooks is not None:
        _write_notebooks(session, notebooks)
    elif show or output is not None:
        _as_pages(session, topic, output, show)
    else:
        from brv_hypo.docs.manual import ManualText, generated

        known = {**topics(), **GENERATED}
        listed = "\n".join(f"- `{name}`: {title}" for name, title in known.items())
        page = (
            f"# The manual\n\n`brv-hypo docs TOPIC` shows one of\n\n{listed}\n\n"
            "`brv-hypo docs --open` opens it as pages, with a gallery."
        )
        if topic is not None:
            page = generated(topic) if topic in GENERATED else text(topic)
        session.show(ManualText(page), conclusion=page)


def _write_notebooks(session: Session, folder: Path) -> None:
    from brv_hypo.docs import notebooks

    contents = notebooks()
    for name in contents:
        check_target(folder / name, overwrite=session.force)
    make_folder(folder)
    for name, content in contents.items():
        write_whole(folder / name, content, overwrite=session.force)
    session.show(f"Wrote {len(contents)} notebooks to {folder}.")


def _as_pages(session: Session, topic: str | None, output: Path | None, show: bool) -> None:
    """Write the manual, among the temporary files where no place was named, and open it if it is to be shown."""
    import tempfile
    import webbrowser

    from brv_hypo.docs import text
    from brv_hypo.docs.manual import FIRST, site

    pages, name = site(), f"{topic or FIRST}.html"
    pages |= {"index.html": pages[f"{FIRST}.html"]}
    if name not in pages:
        text(topic or "")  # refused, with the topics there are
    folder = Path(tempfile.mkdtemp(prefix="brv-hypo-")) / "manual" if output is None else output
    with whole_folder(folder) as partial:
        for file, content in pages.items():
            (partial / file).write_text(content, encoding="utf-8")
    session.show(f"Wrote {folder / name}.")
    if show and not webbrowser.open((folder / name).resolve().as_uri()):
        session.warn(f"no browser was found: open {folder / name} yourself")


app = typer.Typer(
    name="brv-hypo",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from brv_hypo import __version__

        typer.echo(f"brv-hypo {__version__}")
        raise typer.Exit


@app.callback()
def program(
    version: Annotated[
        bool, Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Which mechanism explains the moments that a spinning entry body flew through?"""


_FLYING = (flights.demo, flights.simulate, flights.reconstruct)
_JUDGING = (analyses.compare, analyses.trace, analyses.predict, analyses.study)
for _command in (*_FLYING, *_JUDGING, flights.inspect, flights.import_, docs):
    app.command(_command.__name__.rstrip("_"))(_command)
app.add_typer(mechanisms_app, name="mechanisms")
app.add_typer(config_app, name="config")


def run() -> None:
    """Run the command line; the process ends with the contract's exit code."""
    ready()
    listen()
    app(prog_name="brv-hypo")
