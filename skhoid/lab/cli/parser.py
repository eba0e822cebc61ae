"""The parser of all commands, and the text of ``skhoid --help``."""

from __future__ import annotations

from ..._version import __version__
from .arguments.compare import add_compare
from .arguments.completion import add_completion
from .arguments.demo import add_demo
from .arguments.diagnose import add_diagnose
from .arguments.experiment import add_experiment
from .arguments.identify import add_identify
from .arguments.report import add_report
from .arguments.simulate import add_simulate
from .arguments.study import add_study
from .arguments.workbench import add_workbench
from .commands import Parser

EXAMPLES = """\
examples:
  skhoid demo                hide effects in a simulated person, and find them
  skhoid diagnose run*.csv   what is missing? columns are guessed, and said
  skhoid identify run*.csv   the delay, the orders, and a linear model
  skhoid report run*.csv     the same as diagnose, as a page to keep
  skhoid simulate --remnant 0.1 --out runs.csv
  skhoid experiment recordings/     several people and conditions, on one page
  skhoid workbench run*.csv  fit, try effects and watch the error, in the browser
  skhoid compare model.joblib run*.csv
  skhoid study fig13 --replications 20
  skhoid completion bash

`skhoid COMMAND --help` has more. Without files, identify, diagnose and report
use bundled recordings, and experiment simulates one.
"""


def make_parsers() -> tuple[Parser, dict[str, Parser]]:
    """The parser of all commands, and those of each by name."""
    parser = Parser(
        prog="skhoid",
        description="Identify human operators from recorded control loops.",
        epilog=EXAMPLES,
    )
    parser.add_argument("--version", action="version", version=f"skhoid {__version__}")
    commands = parser.add_subparsers(
        dest="command", required=True, metavar="COMMAND", title="commands"
    )
    for add in (
        add_demo,
        add_identify,
        add_compare,
        add_diagnose,
        add_simulate,
        add_study,
        add_report,
        add_experiment,
        add_workbench,
        add_completion,
    ):
        add(commands)
    return parser, dict(commands.choices)
