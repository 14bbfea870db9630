"""`brv-hypo docs`: the manual, in the terminal or as an offline page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from brv_hypo.cli import completion
from brv_hypo.cli.command import in_session
from brv_hypo.cli.session import Session

NAME = "brv-hypo-manual.html"


@in_session("force")
def docs(
    session: Session,
    topic: Annotated[
        str | None, typer.Argument(metavar="TOPIC", autocompletion=completion.topics, help="What to read about.")
    ] = None,
    notebooks: Annotated[
        Path | None, typer.Option("--notebooks", metavar="DIR", help="Write the two notebooks that come along.")
    ] = None,
    show: Annotated[bool, typer.Option("--open", help="Open the manual as a page in the browser.")] = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE.html", help="Write the manual as an offline page.")
    ] = None,
) -> None:
    """Read the manual; without a topic, the list of topics."""
    session.claim(output)
    from brv_hypo.docs import text

    if notebooks is not None:
        _write_notebooks(session, notebooks)
        return
    if topic is not None:
        text(topic)  # an unknown topic is refused whatever is to be done with it
    if show or output is not None:
        _as_page(session, topic, output, show)
        return
    from brv_hypo.docs.terminal import ManualText

    page = _topics() if topic is None else text(topic)
    session.tell(ManualText(page), conclusion=page)


def _topics() -> str:
    from brv_hypo.docs import topics

    lines = [f"- `{name}`: {title}" for name, title in topics().items()]
    return "\n".join(
        [
            "# The manual",
            "",
            "`brv-hypo docs TOPIC` shows one of",
            "",
            *lines,
            "",
            "`brv-hypo docs --open` opens all of it as a page.",
        ]
    )


def _write_notebooks(session: Session, folder: Path) -> None:
    from brv_hypo.docs import notebooks
    from brv_hypo.files.whole import check_target, make_folder, write_whole

    targets = {folder / name: content for name, content in notebooks().items()}
    for path in targets:
        check_target(path, overwrite=session.force)
    make_folder(folder)
    for path, content in targets.items():
        write_whole(path, content, overwrite=session.force)
    session.show(f"Wrote {', '.join(map(str, targets))}.")


def _as_page(session: Session, topic: str | None, output: Path | None, show: bool) -> None:
    """Write the manual, among the temporary files where no other was named, and open it if it is to be shown."""
    import tempfile
    import webbrowser

    from brv_hypo.docs.offline import manual_page
    from brv_hypo.files.whole import write_whole

    path = Path(tempfile.mkdtemp(prefix="brv-hypo-")) / NAME if output is None else output
    write_whole(path, manual_page(), overwrite=True)
    session.show(f"Wrote {path}.")
    if show and not webbrowser.open(f"{path.resolve().as_uri()}{'' if topic is None else f'#{topic}'}"):
        session.warn(f"no browser was found: open {path} yourself")
