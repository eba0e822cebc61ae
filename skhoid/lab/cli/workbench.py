"""The command ``skhoid workbench``: a page in the browser, served by this machine alone."""

from __future__ import annotations

import argparse
from typing import Any

from ...io._paths import expand_paths
from ..workbench.choices import Choices
from ..workbench.serving import check_installed, opened_session, serve
from .arguments.shared import OF_CORE
from .options import pairs, refuse
from .search_output import wanted_effects


def workbench(options: argparse.Namespace) -> int:
    """Serve the workbench until Ctrl+C."""
    for core, names in OF_CORE.items():
        if core != options.core:
            refuse(options, names, f"needs --core {core}.")
    check_installed()
    paths = [path.absolute() for path in expand_paths(options.files)] if options.files else []
    choices = choices_of(options)
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


def choices_of(options: argparse.Namespace) -> Choices:
    """What the options say of columns and model."""
    roles = pairs(options.role, "--role", "NAME=ROLE, such as roll=motion")
    for name, role in ((options.input, "e"), (options.x, "x"), (options.target, "f_t")):
        if name is not None:
            roles.setdefault(name, role)
    named: dict[str, Any] = {
        "roles": roles,
        "output": options.output,
        "time": options.time,
        "run": options.run,
        "units": pairs(options.unit, "--unit", "NAME=UNIT, such as e=deg"),
    }
    named = {key: value for key, value in named.items() if value}
    if options.input is not None:  # then no other channel is guessed
        named["signals"] = False
    effects = wanted_effects(options)
    others = ["dt", "subject", "condition", "resample", "remove_means", "run_in", "core", "delay"]
    others += ["na", "nb", "nk", "display", "controlled_element", "max_effects", "lost_control"]
    return Choices(
        named=named,
        effects=None if effects == "all" else list(effects),
        **{name: getattr(options, name) for name in others},
    )
