"""The command ``skhoid workbench``: a page in the browser, served by this machine alone."""

from __future__ import annotations

import argparse
from typing import Any

from .parser import (
    add_command,
    add_debug,
    add_decimate,
    add_recording_options,
    add_search_options,
    read_roles,
    read_units,
    whole,
)

ABOUT = """\
explore recordings in the browser: fit, see where, try effects, by hand
Serve a page, to this machine alone, in which a model of your recordings is fitted, compared with
them and extended by hand: effects are tried and seen at once, found by a search, and kept as a
report and a script. What is done is kept in a folder, the session. It needs pip install
"skhoid[workbench]"."""
EXAMPLES = """\
examples:
  skhoid workbench                        choose files in the browser
  skhoid workbench run*.csv               columns are guessed, and can be corrected
  skhoid workbench run*.csv --display pursuit --session friday
  skhoid workbench --session friday       go on where it ended
  skhoid workbench run*.csv --no-browser --port 8765
"""


def add_workbench(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(commands, workbench, ABOUT, "[FILES] [OPTIONS]", EXAMPLES)
    add_recording_options(command)
    add_decimate(command.section("Preparation"))
    add_search_options(command.section("Search"))
    add = command.section("Server")
    text = "where all is kept, and gone on with (default: skhoid-workbench)"
    add("--session", metavar="FOLDER", help=text)
    add("--port", type=whole(1, 65535), metavar="N", help="port of 127.0.0.1 (default: a free one)")
    add("--no-browser", action="store_true", help="print the address only")
    add_debug(add)


def workbench(options: argparse.Namespace) -> int:
    """Serve the workbench until Ctrl+C."""
    from ...io import expand_paths
    from ..workbench.server import check_installed, opened_session, serve

    check_installed()
    paths = [path.absolute() for path in expand_paths(options.files)] if options.files else []
    choices = read_choices(options)
    session, kept = opened_session(options.session, paths, choices)
    serve(
        session,
        kept,
        paths,
        choices,
        port=options.port,
        browser=not options.no_browser,
        say=lambda line: print(line, flush=True),
    )
    print("The workbench has ended. To go on: skhoid workbench --session", session.path)
    return 0


def read_choices(options: argparse.Namespace) -> Any:
    """What the options say of columns and model."""
    from ..workbench.columns import Choices

    known = {} if options.input is None else {options.input: "e"}
    roles = {**known, **read_roles(options, known)}
    named: dict[str, Any] = {
        "roles": roles,
        "output": options.output,
        "time": options.time,
        "run": options.run,
        "units": read_units(options),
    }
    named = {key: value for key, value in named.items() if value}
    if options.input is not None:  # then no other channel is guessed
        named["signals"] = False
    others = ["dt", "subject", "condition", "resample", "remove_means", "run_in", "decimate"]
    others += ["core", "delay", "na", "nb", "nk", "display", "controlled_element"]
    others += ["max_effects", "lost_control", "time_limit", "exhaustive"]
    return Choices(
        named=named,
        effects=None if options.effects == ["all"] else options.effects,
        **{name: getattr(options, name) for name in others},
    )
