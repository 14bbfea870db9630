"""The snippets of a manual page, executed: commands with their output, Python, and the files that they need.

A fence `console` holds commands after "$ " and what they print, `python` code or a session (">>>"), and
`LANGUAGE FILE` the content of a file. "..." matches anything. Other fences are not executed.
"""

from __future__ import annotations

import contextlib
import doctest
import re
import shlex
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from brv_hypo.docs import text

_FENCE = re.compile(r"^```(?P<info>[^\n]*)\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL)
_CONTINUED = re.compile(r" \\\n +")
COMMANDS = ("console", "sh")
"""Languages of fences in which a line that ends with a backslash goes on in the next."""
_OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


@dataclass(frozen=True)
class Snippet:
    """A fence: its language, the file that it is to be written to ("" for none), and its content."""

    language: str
    file: str
    body: str


def snippets(topic: str) -> list[Snippet]:
    """Every fence of a topic, in order."""
    found = []
    for fence in _FENCE.finditer(text(topic)):
        language, _, file = fence["info"].strip().partition(" ")
        body = _CONTINUED.sub(" ", fence["body"]) if language in COMMANDS else fence["body"]
        found.append(Snippet(language, file, body))
    return found


def commands(snippet: Snippet) -> Iterator[tuple[list[str], str]]:
    """The arguments of each `brv-hypo` command of a console, and what it is to print."""
    for part in re.split(r"^\$ ", snippet.body, flags=re.MULTILINE)[1:]:
        line, _, expected = part.partition("\n")
        program, *arguments = shlex.split(line)
        assert program == "brv-hypo", f"the manual shows '{line}'"
        yield arguments, expected


def code_of(snippet: Snippet) -> str:
    """The code of a `python` fence, a session's without prompts and output."""
    if ">>>" not in snippet.body:
        return snippet.body
    return "".join(example.source for example in doctest.DocTestParser().get_examples(snippet.body))


def matches(expected: str, printed: str) -> bool:
    """Whether what was printed is what is shown, white space aside."""
    return doctest.OutputChecker().check_output(_squeezed(expected), _squeezed(printed), _OPTIONS)


def execute(topic: str, folder: Path, run: Callable[..., object]) -> int:
    """Execute a topic's snippets in order in a folder; the number executed. AssertionError where output differs."""
    names: dict[str, object] = {}
    count = 0
    for snippet in snippets(topic):
        if snippet.language == "sh":  # on data that do not come along: test_manual.py
            continue
        if snippet.file:
            (folder / snippet.file).write_text(snippet.body)
        elif snippet.language == "console":
            for arguments, expected in commands(snippet):
                done = run(*arguments, cwd=folder, COLUMNS="80")
                assert done.returncode == 0, f"{arguments}: {done.stderr}"
                assert matches(expected, done.stdout), f"{arguments} printed\n{done.stdout}\nshown is\n{expected}"
                count += 1
        elif snippet.language == "python":
            count += _python(snippet.body, names, folder, topic)
    return count


def _python(body: str, names: dict[str, object], folder: Path, topic: str) -> int:
    with contextlib.chdir(folder):
        if ">>>" not in body:
            exec(compile(body, topic, "exec"), names)
            return 1
        session = doctest.DocTestParser().get_doctest(body, names, topic, None, None)
        said: list[str] = []
        result = doctest.DocTestRunner(optionflags=_OPTIONS).run(session, out=said.append, clear_globs=False)
        names.update(session.globs)
    assert result.failed == 0, "".join(said)
    return result.attempted


def _squeezed(printed: str) -> str:
    """Text without the white space at ends of lines and between words, and without empty lines."""
    lines = (" ".join(line.split()) for line in printed.splitlines())
    return "\n".join(line for line in lines if line) + "\n"
