"""One killed write in every run, and all commands where there is time; `python -m tests.harness.kill` is the long
form.
"""

from __future__ import annotations

import pytest
import typer

from brv_hypo.cli.main import app
from tests.harness.kill.commands import COMMANDS, fly_inputs, write_inputs
from tests.harness.kill.run import Plan, Reference, judged, plans, reference

UNKNOWN = Reference(seconds=60.0, size=0, largest=0)
WRITING_OPTIONS = {"--json", "--output", "--report", "--write-mechanism", "--figures"}
RUNS, ON_FULL_DISK = 2 * len(COMMANDS), 6


def lines(command, above=()):
    """Every command of the program, as the words that call it."""
    for name, below in getattr(command, "commands", {}).items():
        yield (*above, name), below
        yield from lines(below, (*above, name))


def test_every_command_that_writes_is_killed():
    writing = {
        " ".join(words)
        for words, command in lines(typer.main.get_command(app))
        if any(WRITING_OPTIONS & set(option.opts) for option in command.params)
    }
    assert "compare" in writing
    assert writing <= {command.label for command in COMMANDS}


@pytest.mark.thorough
def test_a_command_killed_while_it_writes_leaves_the_old_file_or_the_new(tmp_path):
    write_inputs(tmp_path)
    command = next(command for command in COMMANDS if command.label == "import")
    result = judged(Plan(command, share=None, after=0.001, old=True, room=None), UNKNOWN, tmp_path)
    assert result.problem is None


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    write_inputs(folder)
    fly_inputs(folder)
    return folder


@pytest.mark.slow
def test_every_command_survives_its_kills(inputs):
    usual = {command.label: reference(command, inputs) for command in COMMANDS}
    results = [judged(plan, usual[plan.command.label], inputs) for plan in plans(RUNS, ON_FULL_DISK, seed=2)]
    assert [result for result in results if result.problem is not None] == []
    assert any(result.state == "killed while writing" for result in results)
