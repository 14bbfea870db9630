"""`brv-hypo docs`: the manual in the terminal."""

from __future__ import annotations

from typing import Annotated

import typer

from brv_hypo.cli.command import in_session
from brv_hypo.cli.session import Session


@in_session()
def docs(
    session: Session,
    topic: Annotated[str | None, typer.Argument(metavar="TOPIC", help="What to read about.")] = None,
) -> None:
    """Read the manual; without a topic, the list of topics."""
    from rich.markdown import Markdown

    from brv_hypo.docs import text, topics

    if topic is None:
        lines = [f"- `{name}`: {title}" for name, title in topics().items()]
        page = "\n".join(["# The manual", "", "`brv-hypo docs TOPIC` shows one of", "", *lines])
    else:
        page = text(topic)
    session.tell(Markdown(page), conclusion=page)
