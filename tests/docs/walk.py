"""The manual walked as a new user would, and timed: `python -m tests.docs.walk [--python PYTHON] [TASK ...]`.

Each task goes in an empty folder through the commands that the manual shows, by an installed program (`--python` of the
environment that has it; else this one), and fails where one of them does. Minutes are of the commands alone.
"""

from __future__ import annotations

import argparse
import os
import resource
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import yaml

from tests.docs.filling import filled_in
from tests.docs.snippets import Snippet, code_of, commands, snippets
from tests.shared_data import SHARED

ROOT = Path(__file__).resolve().parents[2]
FIGURES = ("--report", "page.html", "--figures", "figures")


@dataclass(frozen=True)
class Walk:
    """A folder, and the Python whose program is used there."""

    python: str
    folder: Path

    def typed(self, *arguments: str, exit_code: int = 0) -> None:
        """`brv-hypo` with these arguments."""
        self._run([self.python, "-m", "brv_hypo", *arguments], exit_code)

    def shown(self, lines: Sequence[str], last_exit_code: int = 0) -> None:
        """The commands of a page, of which the last ends with that code."""
        for number, line in enumerate(lines, start=1):
            program, *arguments = shlex.split(line)
            code = last_exit_code if number == len(lines) else 0
            if program == "brv-hypo":
                self.typed(*arguments, exit_code=code)
            else:
                self._run([self.python, *arguments], code)

    def topic(self, name: str) -> None:
        """Everything that a topic shows, in order; Python between two commands in one session."""
        for kind, together in groupby(snippets(name), _kind):
            page = list(together)
            if kind == "file":
                for each in page:
                    (self.folder / each.file).write_text(each.body)
            elif kind == "console":
                for arguments, _ in (command for each in page for command in commands(each)):
                    self.typed(*arguments)
            elif kind == "python":
                self._run([self.python, "-c", "".join(map(code_of, page))], 0)

    def measured(self, name: str, map_file: str, last_exit_code: int) -> None:
        """A measured flight from its tables on: the page's lines are filled in after the first command."""
        page = snippets("record")
        at = [k for k, each in enumerate(page) if (each.language, each.file) == ("sh", name)]
        first, *rest = (line for k in at for line in page[k].body.splitlines())
        self.shown([first])
        filled_in(self.folder / map_file, yaml.safe_load(page[at[0] + 1].body))
        self.shown(rest, last_exit_code)

    def _run(self, command: Sequence[str], exit_code: int) -> None:
        done = subprocess.run(command, cwd=self.folder, capture_output=True, text=True, check=False)
        if done.returncode != exit_code:
            sys.exit(f"{shlex.join(command)} ended with {done.returncode}: {done.stderr}")


def _kind(snippet: Snippet) -> str:
    return "file" if snippet.file and snippet.language != "sh" else snippet.language


def opportunity(walk: Walk) -> None:
    """Table, record, verdict, page, figures."""
    _copied(walk, "opportunity", "*.csv")
    walk.measured("opportunity", "opportunity_entry.map.yaml", 0)
    walk.typed("reconstruct", "opportunity_entry.h5", "--figures", "figures")


def rocket(walk: Walk) -> None:
    """Tables, record, motion, and an answer, which is that the record contradicts itself."""
    _copied(walk, "launch12", "*.csv")
    walk.measured("rocket", "imu.map.yaml", 1)


def accepted(walk: Walk) -> None:
    """The rocket all the same."""
    rocket(walk)
    walk.typed("compare", "launch12.h5", "--accept-record", *FIGURES)


def measured_loop(walk: Walk) -> None:
    """The loop on Opportunity's record, its repetitions left out."""
    _copied(walk, "opportunity", "*.h5")
    (shown,) = (snippet for snippet in snippets("loop") if snippet.language == "sh")
    walk.shown(shown.body.splitlines()[:-1])


def another_seed(walk: Walk) -> None:
    """A simulated flight, inspected and compared."""
    walk.typed("simulate", "research_cone", "--plant", "sticking", "--seed", "7", "-o", "flight.h5")
    walk.typed("inspect", "flight.h5")
    walk.typed("compare", "flight.h5", *FIGURES)


TASKS: dict[str, Callable[[Walk], None]] = {
    "demo": lambda walk: walk.typed("demo"),
    "opportunity": opportunity,
    "rocket": rocket,
    "accepted": accepted,
    "mechanism": lambda walk: walk.topic("mechanism"),
    "effect": lambda walk: walk.topic("effect"),
    "sisters": lambda walk: walk.topic("loop"),
    "loop": measured_loop,
    "seed": another_seed,
}


def _copied(walk: Walk, folder: str, pattern: str) -> None:
    for path in (SHARED / "data" / folder).glob(pattern):
        shutil.copy(path, walk.folder)


def main() -> None:
    """Walk the tasks, and print the minutes of each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tasks", nargs="*", choices=[*TASKS, []], default=[])
    parser.add_argument("--python", default=sys.executable)
    given = parser.parse_args()
    os.environ["COLUMNS"] = "80"
    for name in given.tasks or TASKS:
        with tempfile.TemporaryDirectory() as folder:
            begun, used = time.monotonic(), _processor_seconds()
            TASKS[name](Walk(given.python, Path(folder)))
            wall, work = time.monotonic() - begun, _processor_seconds() - used
            print(f"{name:12} {wall / 60.0:6.1f} min, of a processor {work / 60.0:5.2f} min", flush=True)


def _processor_seconds() -> float:
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


if __name__ == "__main__":
    main()
